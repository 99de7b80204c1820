"""The one queue between the devices and the disk."""

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future

from recorder.samples import Record

Entry = Record | Future[Record] | Callable[[], None]
"""A record, one that a worker is still making (it keeps its place in the order), or something
else that the writer thread shall do."""


class WriteQueue:
    """First in, first out, bounded in bytes.

    Device threads put, the writer thread takes; one lock, never held while waiting for a
    worker or the disk. At the bound a live frame is refused (the caller states the loss), a
    file's sample waits, and what else a live device says, some hundred bytes a second, is taken.
    """

    def __init__(self, bound_bytes: int) -> None:
        self._bound = bound_bytes
        self._entries: deque[tuple[Entry, int]] = deque()
        self._bytes = 0
        self._changed = threading.Condition()
        self._closed = False

    def put(self, make: Callable[[], Entry], size: int, *, wait: bool, required: bool = False) -> bool:
        """Queue what ``make`` returns, called only if there is room; False if there is none.

        Args:
            make: returns the record or starts the work that will.
            size: bytes held until the record is on disk.
            wait: wait for room instead of refusing.
            required: take it even beyond the bound.
        """
        with self._changed:
            while self._bytes and self._bytes + size > self._bound and not required:
                if not wait or self._closed:
                    return False
                self._changed.wait()
            if self._closed:
                return False
            self._entries.append((make(), size))
            self._bytes += size
            self._changed.notify_all()
            return True

    def take(self, timeout_s: float) -> tuple[Entry, int] | None:
        """The oldest entry and its size, or None after the timeout or when closed and empty.

        Its bytes count until `done` is called with them.
        """
        with self._changed:
            if not self._entries and not self._closed:
                self._changed.wait(timeout_s)
            return self._entries.popleft() if self._entries else None

    def done(self, size: int) -> None:
        """The entry of ``size`` bytes is written or dropped: make room."""
        with self._changed:
            self._bytes -= size
            self._changed.notify_all()

    def close(self) -> None:
        """Take nothing more; what is queued can still be taken."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def held_bytes(self) -> int:
        """Bytes queued or being written."""
        return self._bytes

    @property
    def drained(self) -> bool:
        """Closed and empty."""
        with self._changed:
            return self._closed and not self._entries
