"""Aravis behind one door: loading it, opening a camera, its errors as ours, its buffers without a copy.

Aravis (LGPL) is reached by GObject introspection and is an extra; nothing here needs it until a
camera is opened.
"""

import ctypes
import ipaddress
import socket
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recorder.errors import DeviceAbsent, DeviceBusy, DeviceError, DeviceLost

GVCP_PORT = 3956


@lru_cache(maxsize=1)
def aravis() -> Any:
    """The introspected library. Raises `DeviceError` where it is not installed."""
    try:
        import gi  # noqa: PLC0415 - an extra

        gi.require_version("Aravis", "0.8")
        from gi.repository import Aravis  # noqa: PLC0415
    except (ImportError, ValueError) as error:
        raise DeviceError(
            "Aravis is not installed", todo="apt install gir1.2-aravis-0.8 and pip install recorder[aravis]"
        ) from error
    return Aravis


@contextmanager
def translated(where: str) -> Iterator[None]:
    """Raise what Aravis raises as one of our errors, its own as the cause.

    `DeviceLost` for no answer, `DeviceBusy` for no right to write, else `DeviceError`.
    """
    from gi.repository import GLib  # noqa: PLC0415 - there once aravis() succeeded

    codes = aravis().DeviceError
    try:
        yield
    except GLib.Error as error:
        domain = aravis().device_error_quark()
        if error.matches(domain, codes.TIMEOUT):
            raise DeviceLost("no answer", where=where, todo="check its power and its cable") from error
        busy = codes.NOT_CONTROLLER, codes.PROTOCOL_ERROR_ACCESS_DENIED, codes.PROTOCOL_ERROR_BUSY
        if any(error.matches(domain, code) for code in busy):
            raise _busy(where) from error
        raise DeviceError(str(error.message), where=where) from error


def open_camera(target: str, where: str) -> Any:
    """Take control of a camera.

    Args:
        target: an IPv4 address; a serial number or Aravis' device id; or empty for the first found.
        where: what errors name.

    A GigE Vision camera is always opened by its address, from the interface that the kernel would
    use: opened by id it may be told to stream to another interface, where nothing arrives.

    Raises:
        DeviceAbsent: nothing answers, or nothing of that name does.
        DeviceBusy: another program controls it.
    """
    library = aravis()
    address = target if _is_address(target) else None
    if address is None:
        index = _discover(target, where)
        if library.get_device_protocol(index) != "GigEVision":
            with translated(where):
                return library.Camera.new(library.get_device_id(index))
        address = library.get_device_address(index)
    return library.Camera.new_with_device(_open_gige(address, where))


def release(error: BaseException) -> None:
    """Clear what the traceback of an error holds, of its causes too.

    A local variable in there would keep Aravis' object alive, and the camera ours, for as long as
    somebody keeps the error.
    """
    one: BaseException | None = error
    while one is not None:
        traceback.clear_frames(one.__traceback__)
        one = one.__cause__ or one.__context__


def buffer_bytes(buffer: Any) -> NDArray[np.uint8]:
    """What an `ArvBuffer` holds, as a view: valid until the buffer goes back to its stream."""
    size = ctypes.c_size_t()
    # The binding's own get_data copies; a GObject's hash is its address.
    data = _get_data()(hash(buffer), ctypes.byref(size))
    if not data or not size.value:
        return np.empty(0, np.uint8)
    return np.ctypeslib.as_array((ctypes.c_uint8 * size.value).from_address(data))


@lru_cache(maxsize=1)
def _get_data() -> Any:
    function = ctypes.CDLL("libaravis-0.8.so.0").arv_buffer_get_data
    function.restype = ctypes.c_void_p
    function.argtypes = [ctypes.c_void_p, ctypes.POINTER(ctypes.c_size_t)]
    return function


def _open_gige(address: str, where: str) -> Any:
    from gi.repository import Gio  # noqa: PLC0415

    absent = DeviceAbsent("no camera answers", where=where, todo="check its power, its cable and its address")
    try:
        local = _local_address(address)
    except OSError as error:
        raise absent from error
    try:
        with translated(where):
            device = aravis().GvDevice.new(
                Gio.InetAddress.new_from_string(local), Gio.InetAddress.new_from_string(address)
            )
    except DeviceLost as error:
        raise absent from error.__cause__
    if not device.is_controller():  # it could be read, but not be taken
        raise _busy(where)
    return device


def _discover(target: str, where: str) -> int:
    """Broadcast on all interfaces; the index of the first device that is meant."""
    library = aravis()
    library.update_device_list()
    found = []
    for index in range(library.get_n_devices()):
        serial, identity = library.get_device_serial_nbr(index), library.get_device_id(index)
        if target in ("", serial, identity):
            return index
        found.append(str(serial or identity))
    if found:
        told, todo = f"not found among {', '.join(found)}", "check its power and cable, or the serial number"
    else:
        told, todo = "no camera was found", "check its power and cable, or give its address"
    raise DeviceAbsent(told, where=where, todo=todo)


def _busy(where: str) -> DeviceBusy:
    return DeviceBusy(
        "another program controls the camera",
        where=where,
        todo="end it; after a crash the camera frees itself within seconds",
    )


def _is_address(target: str) -> bool:
    try:
        ipaddress.IPv4Address(target)
    except ValueError:
        return False
    return True


def _local_address(address: str) -> str:
    """Of the interface that leads to ``address``; nothing is sent."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect((address, GVCP_PORT))
        return str(probe.getsockname()[0])
