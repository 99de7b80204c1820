"""A file that holds images, read by position.

Nothing is mapped: where a file shrinks while it is read, or the disk fails, a mapping ends the process
(SIGBUS) and a read says so. Read in pieces that stay in the processor's cache, a scan is as fast.
"""

import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path

from recorder.codec.stream import MARKER_SIZE, Marker, markers
from recorder.errors import StorageError, UsageError

_PIECE = 1 << 18


class StreamFile:
    """An open file or disk; ``size`` is that at opening. Safe to share between threads.

    Raises `UsageError` for what cannot be opened, `StorageError` where the disk does not give what it holds.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            mode = path.stat().st_mode  # before opening: a pipe would be waited for
            if not (stat.S_ISREG(mode) or stat.S_ISBLK(mode)):
                raise UsageError("not a file", where=str(path), todo="give a file that holds images")
            self._file = path.open("rb", buffering=0)
            self.size = self._file.seek(0, os.SEEK_END)
        except OSError as error:
            reason = {errno.ENOENT: "not there", errno.EACCES: "no permission to read"}.get(error.errno or 0)
            what = reason or f"cannot be read ({error.strerror or error})"
            raise UsageError(what, where=str(path), todo="check the path") from error

    def read(self, offset: int, size: int) -> bytes:
        """So many bytes; fewer where the file ends or has shrunk. Raises ValueError once it is closed."""
        try:
            data = os.pread(self._file.fileno(), size, offset)
            while len(data) < size and (
                more := os.pread(self._file.fileno(), size - len(data), offset + len(data))
            ):
                data += more
        except OSError as error:
            what = f"cannot be read at byte {offset} ({error.strerror or error})"
            todo = "copy what can still be read from the disk (ddrescue) and use the copy"
            raise StorageError(what, where=str(self.path), todo=todo) from error
        return data

    def markers(self) -> Iterator[Marker]:
        """Every marker up to the size at opening, in order."""
        at = 0
        while at + MARKER_SIZE <= self.size:
            piece = self.read(at, min(_PIECE, self.size - at))
            if len(piece) < MARKER_SIZE:
                return
            for offset, is_end in markers(piece):
                yield Marker(at + offset, is_end)
            at += len(piece) - MARKER_SIZE + 1  # a marker may stand across two pieces

    def close(self) -> None:
        """Safe twice."""
        self._file.close()
