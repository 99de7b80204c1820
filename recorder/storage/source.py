"""Random access to the bytes of a segment. No file stays open between two reads of a drive."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from recorder.errors import DriveError


class Damaged(ValueError):
    """Bytes that are not what MCAP or the drive's own format says.

    Args:
        what: what is wrong.
        offset: the byte of the segment at which it was noticed.
    """

    def __init__(self, what: str, offset: int) -> None:
        self.what, self.offset = what, offset
        super().__init__(f"{what} at byte {offset}")


class Source(Protocol):
    """Bytes that can be read anywhere: a file or a decompressed chunk."""

    size: int

    def read(self, offset: int, length: int) -> bytes:
        """Exactly ``length`` bytes. Raises `Damaged` if there are fewer."""
        ...


class MemorySource:
    """Bytes in memory."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.size = len(data)

    def read(self, offset: int, length: int) -> bytes:
        if offset < 0 or length < 0 or offset + length > self.size:
            raise Damaged("cut", min(max(offset, 0), self.size))
        return self._data[offset : offset + length]


class FileSource:
    """An open file, read by position only; safe to share between threads."""

    def __init__(self, fd: int, path: Path) -> None:
        self._fd, self._path = fd, path
        self.size = os.fstat(fd).st_size

    def read(self, offset: int, length: int) -> bytes:
        if offset < 0 or length < 0 or offset + length > self.size:
            raise Damaged("cut", min(max(offset, 0), self.size))
        try:
            data = os.pread(self._fd, length, offset)
            while len(data) < length:
                more = os.pread(self._fd, length - len(data), offset + len(data))
                if not more:
                    raise Damaged("cut", offset + len(data))
                data += more
        except OSError as error:
            raise read_error(error, self._path) from error
        return data


@contextmanager
def opened(path: Path) -> Iterator[FileSource]:
    """The bytes of a file while the block runs. Raises `DriveError`."""
    try:
        fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError as error:
        raise read_error(error, path) from error
    try:
        yield FileSource(fd, path)
    finally:
        os.close(fd)


def read_error(error: OSError, path: Path) -> DriveError:
    """``error`` as a `DriveError`: what is wrong with ``path``, and what to do."""
    if isinstance(error, FileNotFoundError):
        return DriveError("not there", where=str(path), todo="check the path of the drive")
    if isinstance(error, PermissionError):
        todo = "ask its owner, or read it as another user"
        return DriveError("no permission to read", where=str(path), todo=todo)
    if error.errno == errno.EIO:
        return DriveError("input/output error", where=str(path), todo="check the disk and its cable")
    return DriveError(f"cannot be read ({error.strerror or error})", where=str(path), todo="check the disk")
