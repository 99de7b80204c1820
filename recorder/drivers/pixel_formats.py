"""From a camera's bytes to right-aligned 16-bit pixels, by GenICam's names."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorder.kernels import unpack_mono10p
from recorder.samples import Pixels

Bytes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class PixelFormat:
    """One entry of the Pixel Format Naming Convention that we can record."""

    name: str
    code: int
    """As the leader of each image says it; bits 16 to 23 are the bits a pixel takes on the wire."""
    bit_depth: int
    _unpack: Callable[[Bytes, Pixels], None]

    @property
    def has_spare_bits(self) -> bool:
        """True if the wire could carry values above ``bit_depth``."""
        return self.code >> 16 & 0xFF > self.bit_depth

    def wire_bytes(self, width: int, height: int) -> int:
        """The length of an image on the wire: packed formats run on over row ends."""
        return -(-width * height * (self.code >> 16 & 0xFF) // 8)

    def pixels(self, data: Bytes, width: int, height: int) -> Pixels:
        """A copy of an image of `wire_bytes` bytes, H x W."""
        pixels = np.empty((height, width), np.uint16)
        self._unpack(data, pixels)
        return pixels


def _widen(data: Bytes, out: Pixels) -> None:
    out[...] = data.reshape(out.shape)


def _copy(data: Bytes, out: Pixels) -> None:
    out[...] = data.view("<u2").reshape(out.shape)


PREFERENCE = (
    PixelFormat("Mono10p", 0x010A0046, 10, unpack_mono10p),
    PixelFormat("Mono10", 0x01100003, 10, _copy),
    PixelFormat("Mono12", 0x01100005, 12, _copy),
    PixelFormat("Mono16", 0x01100007, 16, _copy),
    PixelFormat("Mono8", 0x01080001, 8, _widen),
)
"""What "auto" takes first: ten bits are what the rails need, and packed they load the link least."""

BY_NAME = {format_.name: format_ for format_ in PREFERENCE}
BY_CODE = {format_.code: format_ for format_ in PREFERENCE}
