from mmap import mmap
from typing import Any

import numpy as np
from numpy.typing import NDArray

_Buffer = bytes | bytearray | memoryview | mmap | NDArray[Any]
_Image = NDArray[np.uint8] | NDArray[np.uint16]

class FormatError(ValueError):
    """Bytes that are not a sound FELICS image; ``args`` are what is wrong and the offset of the byte."""

    args: tuple[str, int]

def felics_encode(image: _Image, depth: int, model: int, table: bytes, threads: int = 1) -> bytes:
    """One image of C-contiguous (H, W) pixels; ``table`` is the model's or empty. Raises ValueError."""

def felics_encode_into(
    image: _Image, out: NDArray[np.uint8], depth: int, model: int, table: bytes, threads: int = 1
) -> int:
    """felics_encode into an array of at least felics_largest_encoding bytes; returns the bytes written."""

def felics_train(image: _Image, depth: int, model: int) -> bytes:
    """The model's table for this image: what encoding without one would use. Raises ValueError."""

def felics_largest_encoding(width: int, height: int, depth: int) -> int:
    """How many bytes an image of this shape takes at most. Raises ValueError."""

def felics_usual_table(depth: int) -> bytes:
    """The fixed k of each of the 17 contexts."""

def felics_header(data: _Buffer) -> tuple[int, int, int, int, int, int, int, bytes, tuple[int, ...]]:
    """Version, model, depth, mask, width, height, checksum, table, stream lengths. Raises FormatError."""

def felics_shape(data: _Buffer) -> tuple[int, int]:
    """(H, W) of an image whose frame, header and lengths agree. Raises FormatError."""

def felics_decode_into(data: _Buffer, out: NDArray[np.uint16]) -> None:
    """Decodes into a C-contiguous array. Raises FormatError, or ValueError for one of another shape."""

def instruction_set() -> str:
    """ "scalar", "avx2" or "avx512": what RECORDER_KERNELS names, or the processor's best."""

def find_marker(data: _Buffer, start: int) -> int:
    """The position of the next FF E8 or FF E9 at or after ``start``, or the length of the data."""

def crc32c(data: _Buffer) -> int:
    """CRC-32C (Castagnoli) of the bytes, with the processor's instruction where there is one."""

def crc32c_portable(data: _Buffer) -> int:
    """The same from tables."""

def unpack_mono10p(data: _Buffer, out: NDArray[np.uint16]) -> None:
    """GenICam Mono10p (10 bits a pixel, least significant bit first) into ``out``, of any C-contiguous shape.

    ``data`` has exactly ``ceil(10 * out.size / 8)`` bytes. Raises ValueError otherwise.
    """
