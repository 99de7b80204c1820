"""The marker-framed stream: images one after another, found by their markers alone (report 3.2.7.1)."""

from collections.abc import Iterable, Iterator
from mmap import mmap
from typing import Any, NamedTuple

from numpy.typing import NDArray

from recorder import kernels

Buffer = bytes | bytearray | memoryview | mmap | NDArray[Any]
"""Any contiguous bytes."""

MARKER_SIZE = 2
_END = 0xE9


class Marker(NamedTuple):
    """An ``FF E8`` or an ``FF E9``, or two bytes that look like one."""

    offset: int
    is_end: bool


class Stretch(NamedTuple):
    """What lies between two places where a stream is cut: before each ``FF E8`` and behind each ``FF E9``."""

    start: int
    end: int
    opened: bool
    """It begins with ``FF E8``."""
    closed: bool
    """It ends with ``FF E9``."""


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
    for stretch in stretches(markers(buffer), len(buffer)):
        if stretch.opened and stretch.closed:
            yield slice(stretch.start, stretch.end)


def markers(buffer: Buffer) -> Iterator[Marker]:
    """Every marker, in order."""
    at = kernels.find_marker(buffer, 0)
    while at < len(buffer):
        yield Marker(at, _is_end(buffer, at))
        at = kernels.find_marker(buffer, at + MARKER_SIZE)


def stretches(markers: Iterable[Marker], size: int) -> Iterator[Stretch]:
    """Cut ``size`` bytes at their markers. Every byte is in one stretch; none is empty."""
    start, opened = 0, False
    for offset, is_end in markers:
        end = offset + MARKER_SIZE if is_end else offset
        if end > start:
            yield Stretch(start, end, opened, is_end)
        start, opened = end, not is_end
    if size > start:
        yield Stretch(start, size, opened, False)


def _is_end(buffer: Buffer, marker: int) -> bool:
    with _view(buffer) as view, view.cast("B") as octets:
        return octets[marker + 1] == _END


def _view(buffer: Any) -> memoryview:
    """Typed loosely: a type checker knows arrays as buffers only from Python 3.12 on."""
    return memoryview(buffer)
