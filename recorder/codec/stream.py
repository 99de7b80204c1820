"""The marker-framed stream: images one after another, found by their markers alone (report 3.2.7.1)."""

from collections.abc import Iterator
from mmap import mmap
from typing import Any

from numpy.typing import NDArray

from recorder import kernels

Buffer = bytes | bytearray | memoryview | mmap | NDArray[Any]
"""Any contiguous bytes."""

_END = 0xE9


def walk(buffer: Buffer) -> Iterator[slice]:
    """Every ``FF E8 … FF E9`` of a stream or of any file that holds images in one piece, in order.

    Looks at markers only: a slice may be two bytes that look alike with whatever stands between;
    ``read_header`` tells. An image whose end is missing is passed over, and the next one found.
    The buffer is not held between two slices: it may grow or be cut meanwhile.

    Raises:
        ValueError: elements that are no bytes, or in several dimensions: slices count bytes.
    """
    with _view(buffer) as view:
        if view.ndim != 1 or view.itemsize != 1:
            raise ValueError(f"a stream is 1-D, of single bytes, not {view.ndim}-D of {view.itemsize} bytes")
    start: int | None = None
    at = kernels.find_marker(buffer, 0)
    while at < len(buffer):
        if not _is_end(buffer, at):
            start = at
        elif start is not None:
            yield slice(start, at + 2)
            start = None
        at = kernels.find_marker(buffer, at + 2)


def _is_end(buffer: Buffer, marker: int) -> bool:
    with _view(buffer) as view, view.cast("B") as octets:
        return octets[marker + 1] == _END


def _view(buffer: Any) -> memoryview:
    """Typed loosely: a type checker knows arrays as buffers only from Python 3.12 on."""
    return memoryview(buffer)
