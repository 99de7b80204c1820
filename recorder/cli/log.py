"""The recorder's events on standard error, which may be blocked for ever without harm."""

import logging
import queue
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_WAITING = 1000
"""Lines that wait for a slow reader; more are left out."""
_LAST_WORDS_S = 0.5


class _Handler(logging.Handler):
    """Hands lines to a thread; whoever logs never waits."""

    def __init__(self) -> None:
        super().__init__()
        self._lines: queue.Queue[str | None] = queue.Queue(_WAITING)
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)
        self._thread.start()

    def emit(self, record: logging.LogRecord) -> None:
        try:
            self._lines.put_nowait(f"{record.levelname} {record.getMessage()}\n")
        except queue.Full:
            return

    def finish(self) -> None:
        try:
            self._lines.put_nowait(None)
        except queue.Full:
            return
        self._thread.join(_LAST_WORDS_S)

    def _write(self) -> None:
        for line in iter(self._lines.get, None):
            sys.stderr.write(line)
            sys.stderr.flush()


@contextmanager
def log_to_stderr() -> Iterator[None]:
    """While inside, the events of the recorder are written to standard error by a thread of its own."""
    logger = logging.getLogger("recorder")
    handler = _Handler()
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        handler.finish()
