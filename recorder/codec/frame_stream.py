"""The images of a marker-framed file, each at hand by its number."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, overload

import numpy as np
from numpy.typing import NDArray

from recorder.codec.felics import FelicsHeader, decode, read_header
from recorder.codec.stream import Stretch, stretches
from recorder.codec.stream_file import StreamFile
from recorder.errors import CodecError

HEAD_SIZE = 4096
"""No header is longer, stuffed."""


@dataclass(frozen=True, slots=True, eq=False)
class StreamFrame:
    """One image and where it stood."""

    offset: int
    """Of its first byte in the file."""
    header: FelicsHeader
    data: bytes
    """From ``FF E8`` to ``FF E9``."""

    @property
    def pixels(self) -> NDArray[np.uint16]:
        """(H, W), decoded at each access. Raises `CodecError` if the image is damaged behind its header."""
        return decode(self.data)


class FrameStream(Sequence[StreamFrame]):
    """The images of any file that holds each in one piece: a stream, an MCAP segment, a damaged file.

    Opening scans the file for markers, 4 GiB in about a second; an image is what has both markers and a
    header of the right checksum. What is damaged behind its header is listed, and raises when it is decoded;
    what is cut off or has a damaged header is not listed: ``salvage`` tells of those. Frames may differ in
    shape and depth.

    The index is that of the file at opening: what is appended later is not seen, and a frame that is no
    longer there raises `CodecError`. Slices are views on the same file, and `close` is for all of them.
    Pickled with its index, and opened again by its path.

    Raises `UsageError` for a path that is no readable file, `StorageError` for a disk that fails.
    """

    def __init__(self, path: Path | str) -> None:
        self._file = StreamFile(Path(path).absolute())
        found = [
            (stretch.start, stretch.end - stretch.start)
            for stretch in stretches(self._file.markers(), self._file.size)
            if _is_image(self._file, stretch)
        ]
        self._index: NDArray[np.int64] = np.array(found, np.int64).reshape(-1, 2)

    @property
    def path(self) -> Path:
        """Absolute."""
        return self._file.path

    @property
    def size(self) -> int:
        """Bytes of the file at opening."""
        return self._file.size

    @property
    def offsets(self) -> list[int]:
        """Where each image begins in the file; no image is read."""
        return [int(offset) for offset in self._index[:, 0]]

    @property
    def sizes(self) -> list[int]:
        """Bytes of each image, from marker to marker; no image is read."""
        return [int(size) for size in self._index[:, 1]]

    def __len__(self) -> int:
        return len(self._index)

    @overload
    def __getitem__(self, index: int) -> StreamFrame: ...
    @overload
    def __getitem__(self, index: slice) -> "FrameStream": ...
    def __getitem__(self, index: int | slice) -> "StreamFrame | FrameStream":
        """Raises IndexError, and `CodecError` for a frame that is no longer what it was at opening."""
        if isinstance(index, slice):
            return _view(self._file, self._index[index])
        return self._load(self._index[index])

    def __iter__(self) -> Iterator[StreamFrame]:
        return (self._load(entry) for entry in self._index)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        return _reopen, (self.path, self._index)

    def close(self) -> None:
        """Let go of the file; safe twice. Frames that were read stay."""
        self._file.close()

    def _load(self, entry: NDArray[np.int64]) -> StreamFrame:
        offset, size = map(int, entry)
        data = self._file.read(offset, size)
        if len(data) < size:
            raise CodecError(f"{self.path} has been cut off since it was opened", offset=len(data))
        return StreamFrame(offset, read_header(data), data)


def _is_image(file: StreamFile, stretch: Stretch) -> bool:
    if not (stretch.opened and stretch.closed):
        return False
    try:
        read_header(file.read(stretch.start, min(HEAD_SIZE, stretch.end - stretch.start)))
    except CodecError:
        return False
    return True


def _view(file: StreamFile, index: NDArray[np.int64]) -> FrameStream:
    view = FrameStream.__new__(FrameStream)
    view._file, view._index = file, index
    return view


def _reopen(path: Path, index: NDArray[np.int64]) -> FrameStream:
    return _view(StreamFile(path), index)
