"""A segment on its way to disk: whole records or nothing."""

import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Protocol


class RawFile(Protocol):
    """What a segment is written to: an unbuffered file, or a test's imitation of a bad disk."""

    def write(self, data: memoryview, /) -> int | None: ...
    def truncate(self, size: int, /) -> int: ...
    def fileno(self) -> int: ...
    def close(self) -> None: ...


Create = Callable[[Path], RawFile]


def create_file(path: Path) -> RawFile:
    """A new file, unbuffered: the MCAP writer hands over whole chunks."""
    return path.open("xb", buffering=0)


class SegmentFile:
    """Counts its position, and takes back what was written in part.

    The MCAP writer hands over whole records in each call, so cutting the file back after an error
    leaves it ending on a whole record. Raises OSError, after which it takes nothing more.
    """

    def __init__(self, path: Path, create: Create = create_file) -> None:
        self.path = path
        self._file = create(path)
        self._position = 0
        self.broken = False

    def write(self, data: bytes) -> int:
        if self.broken:
            raise OSError(f"{self.path} failed before")
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) or 0 :]
        except OSError:
            self.broken = True
            with suppress(OSError):
                self._file.truncate(self._position)
            raise
        self._position += len(data)
        return len(data)

    def tell(self) -> int:
        return self._position

    def flush(self) -> None:
        """Nothing is buffered here; the MCAP writer asks for it."""

    def fileno(self) -> int:
        return self._file.fileno()

    def close(self) -> None:
        self._file.close()


def sync_folder(path: Path, sync: Callable[[int], None] = os.fsync) -> None:
    """Make the names in a folder durable. Raises OSError."""
    fd = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        sync(fd)
    finally:
        os.close(fd)
