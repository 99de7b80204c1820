"""Serves one GigE Vision camera: Aravis' fake one, with our description and our pixels."""

import ctypes
import socket
import tempfile
from functools import lru_cache
from typing import Any

import numpy as np

from recorder.errors import DeviceError
from recorder.simulation.gige_description import describe, start_values
from recorder.simulation.gige_pixels import BIT_DEPTHS, PIXEL_FORMAT_CODES, PixelSource, packed_bytes

_GVCP_PORT = 3956
_WIDTH, _HEIGHT, _SENSOR_HEIGHT, _SENSOR_WIDTH = 0x100, 0x104, 0x118, 0x11C
_PIXEL_FORMAT, _PERIOD_US = 0x128, 0x138
_STREAM_PORT, _PACKET_SIZE = 0x0D00, 0x0D04

_FORMAT_NAMES = {code: name for name, code in PIXEL_FORMAT_CODES.items() if name in BIT_DEPTHS}

_FILL = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32
)


class GigeCamera:
    """Serves one camera from construction on, in a thread of Aravis, until the process ends."""

    def __init__(
        self,
        *,
        address: str,
        serial: str,
        source: PixelSource,
        width: int,
        height: int,
        pixel_format: str,
        formats: list[str],
        rate_hz: float,
        packet_bytes: int,
        loss: float,
    ) -> None:
        library = aravis()
        _claim(address)
        # Aravis maps the description into memory at once: a process that is killed leaves no file.
        with tempfile.NamedTemporaryFile("w", suffix=".xml", encoding="utf-8") as description:
            description.write(describe(library, formats))
            description.flush()
            self._server = library.GvFakeCamera(
                **{
                    "interface-name": address,
                    "serial-number": serial,
                    "genicam-filename": description.name,
                    "gvsp-lost-ratio": loss,
                }
            )
        if not self._server.is_running():
            raise DeviceError(
                "no interface has this address", where=address, todo=f"ip addr add {address}/8 dev lo"
            )
        self._camera = self._server.get_fake_camera()
        for register, value in (
            (_SENSOR_WIDTH, width),
            (_SENSOR_HEIGHT, height),
            (_WIDTH, width),
            (_HEIGHT, height),
            (_PIXEL_FORMAT, PIXEL_FORMAT_CODES[pixel_format]),
            (_PERIOD_US, round(1e6 / rate_hz)),
            (_PACKET_SIZE, packet_bytes),
            *start_values(),
        ):
            self._camera.write_register(register, value)
        self._source, self._stream_port, self._number = source, 0, 0
        # The introspection binding would free the closure after the call, so it goes by ctypes.
        self._library = _library()
        self._callback = _FILL(self._fill)
        self._library.arv_fake_camera_set_fill_pattern(hash(self._camera), self._callback, None)

    def _fill(self, buffer: int, _data: int, _exposure: int, _gain: int, code: int) -> None:
        """Called by Aravis' thread for every image, with a buffer to fill."""
        port = self._camera.read_register(_STREAM_PORT)[1]
        if port != self._stream_port:  # a new client: play from the start
            self._stream_port, self._number = port, 0
        name = _FORMAT_NAMES.get(code)
        if name is not None:
            width = self._library.arv_buffer_get_image_width(buffer)
            height = self._library.arv_buffer_get_image_height(buffer)
            # Aravis has seen to it that the image fits; the length it tells is that of received data.
            data = self._library.arv_buffer_get_data(buffer, ctypes.byref(ctypes.c_size_t()))
            image = ctypes.c_uint8 * packed_bytes(width * height, name)
            out = np.ctypeslib.as_array(image.from_address(data))
            self._source.fill(out, self._number, name, width, height)
        self._number += 1


def _claim(address: str) -> None:
    """Raises `DeviceError` if another camera serves here: Aravis would share its port and steal from it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((address, _GVCP_PORT))
        except OSError as error:
            raise DeviceError(
                f"cannot serve a camera at UDP port {_GVCP_PORT} ({error.strerror})",
                where=address,
                todo="one camera an address: end the other one",
            ) from error


@lru_cache(maxsize=1)
def aravis() -> Any:
    """The introspected library. Raises `DeviceError` where it is not installed."""
    try:
        import gi  # noqa: PLC0415 - an extra, asked for only when a camera is to be served

        gi.require_version("Aravis", "0.8")
        from gi.repository import Aravis  # noqa: PLC0415
    except (ImportError, ValueError) as error:
        raise DeviceError(
            "Aravis is not installed", todo="apt install gir1.2-aravis-0.8 and pip install recorder[aravis]"
        ) from error
    return Aravis


def _library() -> ctypes.CDLL:
    library = ctypes.CDLL("libaravis-0.8.so.0")
    library.arv_buffer_get_data.restype = ctypes.c_void_p
    library.arv_buffer_get_data.argtypes = [ctypes.c_void_p, ctypes.POINTER(ctypes.c_size_t)]
    for size in (library.arv_buffer_get_image_width, library.arv_buffer_get_image_height):
        size.restype, size.argtypes = ctypes.c_int, [ctypes.c_void_p]
    library.arv_fake_camera_set_fill_pattern.restype = None
    library.arv_fake_camera_set_fill_pattern.argtypes = [ctypes.c_void_p, _FILL, ctypes.c_void_p]
    return library
