"""What a damaged file still holds, and what it no longer does."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from recorder.codec.felics import FelicsHeader, decode, read_header
from recorder.codec.frame_stream import HEAD_SIZE, StreamFrame
from recorder.codec.stream import Stretch, stretches
from recorder.codec.stream_file import StreamFile
from recorder.errors import CodecError

_HEADER_BEGINS = 5
"""Bytes up to and with version, model and bit depth."""
_STUFFED_SIZE = 1 << 16
_STUFFED_MIN = 4
"""So many ``FF 00`` and no other ``FF`` in the bytes at a marker: by chance once in 2³²."""


@dataclass(frozen=True, slots=True)
class Gap:
    """Bytes that are no intact image."""

    offset: int
    """Of the first byte in the file."""
    size: int
    error: CodecError | None
    """Why the image here is lost, with an offset from the gap's own; None: nothing tells of an image."""


def salvage(path: Path | str) -> Iterator[StreamFrame | Gap]:
    """Everything in a file, in order: its intact images, decoded once to be sure, and the gaps between them.

    Each piece begins where the one before ended, and all together are the file, so every loss is stated.
    An image is cut off where another begins (a second ``FF E8`` before an ``FF E9``), and what only looks
    like a marker hides no image behind it. Damage counts as a lost image if its header is sound or begins as
    one, or if it is stuffed as images are; one image may leave several such gaps. Other bytes have ``error``
    None: in an MCAP segment they are its other records, in a bare stream they are lost too. The file is
    scanned once and each image decoded once.

    Raises `UsageError` for a path that is no readable file, `StorageError` for a disk that fails.
    """
    file = StreamFile(Path(path).absolute())
    try:
        told = 0
        for stretch in stretches(file.markers(), file.size):
            piece = _judge(file, stretch)
            if piece is None:
                continue
            if told < stretch.start:
                yield Gap(told, stretch.start - told, None)
            yield piece
            told = stretch.end
        if told < file.size:
            yield Gap(told, file.size - told, None)
    finally:
        file.close()


def _judge(file: StreamFile, stretch: Stretch) -> StreamFrame | Gap | None:
    """The intact image that a stretch is, or the lost one that it was; None: neither."""
    start, size = stretch.start, stretch.end - stretch.start
    if size < _HEADER_BEGINS:
        return None
    if not stretch.opened:
        tail = max(start, stretch.end - _STUFFED_SIZE)
        if stretch.closed and _is_stuffed(file.read(tail, stretch.end - tail)):
            return Gap(start, size, CodecError("an image without its beginning: no FF E8", offset=0))
        return None
    head = file.read(start, min(size, HEAD_SIZE))
    try:
        header = read_header(head)
        if not stretch.closed:
            raise CodecError("cut off: no FF E9", offset=size)
        if size > _longest(header):
            raise CodecError("longer than its header says", offset=_longest(header))
        data = file.read(start, size)
        decode(data)
        return StreamFrame(start, header, data)
    except CodecError as error:
        was_image = _begins_like_a_header(head) or _is_stuffed(file.read(start, min(size, _STUFFED_SIZE)))
        return Gap(start, size, error) if was_image else None


def _longest(header: FelicsHeader) -> int:
    """Bytes that an image of this header has at most, all of them stuffed: no more is read at once."""
    return HEAD_SIZE + 2 * sum(header.stream_lengths)


def _begins_like_a_header(head: bytes) -> bool:
    if len(head) < _HEADER_BEGINS:  # the file has shrunk
        return False
    version, model, depth = head[2:_HEADER_BEGINS]
    return version == 1 and model <= 2 and 1 <= depth <= 16


def _is_stuffed(data: bytes) -> bool:
    """Whether every FF but those of the markers has its 00, and there are enough of them to tell."""
    inside = data.removeprefix(b"\xff\xe8").removesuffix(b"\xff\xe9").removesuffix(b"\xff")
    return inside.count(b"\xff") == inside.count(b"\xff\x00") >= _STUFFED_MIN
