"""What the GigE Vision twin's sensor sees, and how PixelFormat packs it on the wire.

A source fills image ``number``, counted from 0 at the start of a stream, into the bytes that
will be sent. It does so for every frame of a 60 Hz camera, so nothing is computed twice.
"""

from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from recorder.errors import SourceError

BIT_DEPTHS = {"Mono8": 8, "Mono10": 10, "Mono10p": 10, "Mono12": 12, "Mono16": 16}
"""The formats that the twin can fill, by GenICam's names."""

PIXEL_FORMAT_CODES = {
    "Mono8": 0x01080001,
    "Mono10": 0x01100003,
    "Mono10p": 0x010A0046,
    "Mono12": 0x01100005,
    "Mono16": 0x01100007,
    "RGB8": 0x02180014,
}
"""Pixel Format Naming Convention; RGB8 is there to be refused."""

ID_PIXELS = 4
"""The first pixels of the built-in pattern hold the image number, 8 bits each, highest first."""


_PACKED_BYTES = 1 << 29
"""Of Mono10p frames, kept after the first round: packing one takes a third of a period at 60 Hz."""

Bytes = NDArray[np.uint8]


class PixelSource(Protocol):
    """Where the images come from."""

    def fill(self, out: Bytes, number: int, pixel_format: str, width: int, height: int) -> None: ...


def pattern(number: int, width: int, height: int, bit_depth: int) -> NDArray[np.uint16]:
    """The built-in image ``number``: a noisy slope that scrolls by a row an image.

    H x W, no two consecutive images share a row in place; `pattern_number` reads the number back.
    """
    image = np.roll(_slope(width, height, bit_depth), -(number % height), axis=0)
    image[0] = _first_row(number, width, bit_depth)
    return image


def pattern_number(pixels: NDArray[np.uint16]) -> int:
    """The number that `pattern` wrote into an image."""
    return int.from_bytes(bytes(int(value) for value in pixels[0, :ID_PIXELS]), "big")


def pack(pixels: NDArray[np.uint16], pixel_format: str) -> Bytes:
    """Pixels as the wire carries them, flat. Mono10p is LSB first and runs on over row ends."""
    out = np.empty(packed_bytes(pixels.size, pixel_format), np.uint8)
    _pack_into(out, pixels, pixel_format)
    return out


def packed_bytes(pixels: int, pixel_format: str) -> int:
    """Bytes on the wire of so many pixels."""
    return -(-pixels * (PIXEL_FORMAT_CODES[pixel_format] >> 16 & 0xFF) // 8)


class Pattern:
    """The built-in pattern, cheap: the slope is packed once, twice over, and an image is a window of it."""

    def fill(self, out: Bytes, number: int, pixel_format: str, width: int, height: int) -> None:
        depth = BIT_DEPTHS[pixel_format]
        row = packed_bytes(width, pixel_format)
        if row * height != len(out):  # rows do not end with a byte
            _pack_into(out, pattern(number, width, height, depth), pixel_format)
            return
        start = number % height * row
        out[:] = _doubled_slope(width, height, pixel_format)[start : start + height * row]
        _pack_into(out[:row], _first_row(number, width, depth), pixel_format)


class LeftAligned:
    """A fault: Mono10 and Mono12 in the upper bits of their sixteen, which GenICam forbids."""

    def __init__(self, source: PixelSource) -> None:
        self._source = source

    def fill(self, out: Bytes, number: int, pixel_format: str, width: int, height: int) -> None:
        self._source.fill(out, number, pixel_format, width, height)
        if pixel_format in {"Mono10", "Mono12"}:
            shifted = out.view("<u2")
            shifted <<= 16 - BIT_DEPTHS[pixel_format]


class Stack:
    """Frames of a file, played in a loop.

    Args:
        path: a ``.npy`` of uint16, N x H x W, or a folder of 8- or 16-bit grey images in the
            order of their names. The values are taken as they are.

    Raises `SourceError` for anything else.
    """

    def __init__(self, path: Path) -> None:
        self.frames = _load(path)
        self.height, self.width = self.frames.shape[1:]
        self.bit_depth = max(int(frame.max()) for frame in self.frames).bit_length()

        self._packed: dict[tuple[int, int, int], Bytes] = {}

    def fits(self, pixel_format: str) -> bool:
        """False if the frames hold more than the format can carry."""
        return self.bit_depth <= BIT_DEPTHS.get(pixel_format, 0)

    def fill(self, out: Bytes, number: int, pixel_format: str, width: int, height: int) -> None:
        index = number % len(self.frames)
        frame = self.frames[index, :height, :width]
        if pixel_format != "Mono10p":
            _pack_into(out, frame, pixel_format)
            return
        key = index, width, height
        packed = self._packed.get(key)
        if packed is None:
            packed = pack(frame, pixel_format)
            if len(out) * len(self._packed) < _PACKED_BYTES:
                self._packed[key] = packed
        out[:] = packed


def _load(path: Path) -> NDArray[np.uint16]:
    frames: NDArray[Any]
    try:
        frames = _read_folder(path) if path.is_dir() else np.load(path, mmap_mode="r")
    except (OSError, ValueError) as error:
        raise SourceError(f"no frames to play ({error})", where=str(path)) from error
    if frames.ndim != 3 or frames.dtype != np.uint16 or not frames.size:
        told = f"frames are {frames.dtype} {frames.shape}, wanted uint16 (N, H, W)"
        raise SourceError(told, where=str(path))
    return frames


def _read_folder(path: Path) -> NDArray[Any]:
    import cv2  # noqa: PLC0415 - only a folder needs it

    images = [cv2.imread(str(file), cv2.IMREAD_UNCHANGED) for file in sorted(path.iterdir())]
    stack: NDArray[np.uint16] = np.stack([image for image in images if image is not None]).astype(np.uint16)
    return stack


def _pack_into(out: Bytes, pixels: NDArray[np.uint16], pixel_format: str) -> None:
    if pixel_format == "Mono8":
        out.reshape(pixels.shape)[...] = pixels
    elif pixel_format != "Mono10p":
        out.view("<u2").reshape(pixels.shape)[...] = pixels
    else:
        flat = pixels.reshape(-1)
        whole = len(flat) // 4 * 4
        _pack_fours(out[: whole // 4 * 5].reshape(-1, 5), flat[:whole].reshape(-1, 4))
        if whole < len(flat):
            last, group = np.zeros((1, 4), np.uint16), np.empty((1, 5), np.uint8)
            last[0, : len(flat) - whole] = flat[whole:]
            _pack_fours(group, last)
            out[whole // 4 * 5 :] = group[0, : len(out) - whole // 4 * 5]


def _pack_fours(out: Bytes, pixels: NDArray[np.uint16]) -> None:
    """Four pixels into five bytes: as one number of 40 bits, its bytes but the upper three."""
    group = pixels[:, 3].astype("<u8")
    for column in (2, 1, 0):
        group <<= np.uint64(10)
        group |= pixels[:, column]
    out[...] = group.view(np.uint8).reshape(-1, 8)[:, :5]


@lru_cache(maxsize=4)
def _slope(width: int, height: int, bit_depth: int) -> NDArray[np.uint16]:
    """A diagonal slope over 7/8 of the range, and noise over the rest."""
    x = np.arange(width, dtype=np.uint32)
    y = np.arange(height, dtype=np.uint32)[:, None]
    top = (1 << bit_depth) - 1
    slope = (x + y) * (top * 7 // 8) // (width + height)
    noise = (x * 2654435761 ^ y * 2246822519) * 3266489917 >> 16 & 0xFFFF  # wraps at 32 bits: a hash
    return (slope + noise * (top // 8) // 0xFFFF).astype(np.uint16)


@lru_cache(maxsize=4)
def _doubled_slope(width: int, height: int, pixel_format: str) -> Bytes:
    packed = pack(_slope(width, height, BIT_DEPTHS[pixel_format]), pixel_format)
    return np.concatenate([packed, packed])


def _first_row(number: int, width: int, bit_depth: int) -> NDArray[np.uint16]:
    row = (np.arange(width, dtype=np.uint64) * 3 + number * 5) & ((1 << bit_depth) - 1)
    row[:ID_PIXELS] = list((number & 0xFFFFFFFF).to_bytes(ID_PIXELS, "big"))[:width]
    return row.astype(np.uint16)
