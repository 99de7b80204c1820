"""What runs when: everything periodic of the recorder's own process, as one table."""

import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from recorder.clock import Clock

_log = logging.getLogger("recorder.housekeeping")


@dataclass(frozen=True, slots=True)
class Chore:
    """Something short that is done again and again."""

    name: str
    period_s: float
    do: Callable[[], None]


class Housekeeping:
    """One thread that does each chore at its period until stopped.

    A chore that is late is done once, not caught up. One that fails is logged and done again at
    its time. None may wait for a device or the disk, but those of a thread of their own.
    """

    def __init__(self, chores: Sequence[Chore], *, clock: Clock, name: str = "housekeeping") -> None:
        self._chores = chores
        self._clock = clock
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self, timeout_s: float | None = None) -> None:
        """End the thread; one that hangs in a chore is left behind after ``timeout_s``."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(timeout_s)

    def _run(self) -> None:
        due_ns = {chore.name: self._clock.raw_ns() for chore in self._chores}
        while not self._stop.is_set():
            for chore in self._chores:
                now_ns = self._clock.raw_ns()
                if now_ns < due_ns[chore.name]:
                    continue
                try:
                    chore.do()
                except Exception as error:  # the other chores, the watchdog among them, go on
                    _log.error("%s: %s: %s", chore.name, type(error).__name__, error)
                period_ns = round(chore.period_s * 1e9)
                next_ns = due_ns[chore.name] + period_ns
                due_ns[chore.name] = next_ns if next_ns > now_ns else now_ns + period_ns
            wait_s = (min(due_ns.values()) - self._clock.raw_ns()) / 1e9
            self._stop.wait(max(0.0, wait_s))
