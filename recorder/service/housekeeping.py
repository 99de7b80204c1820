"""What runs when: everything periodic of the recorder's own process, as one table."""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from recorder.clock import Clock


@dataclass(frozen=True, slots=True)
class Chore:
    """Something short that is done again and again."""

    name: str
    period_s: float
    do: Callable[[], None]


class Housekeeping:
    """One thread that does each chore at its period until stopped.

    A chore that is late is done once, not caught up; none may wait for a device or the disk.
    """

    def __init__(self, chores: Sequence[Chore], *, clock: Clock) -> None:
        self._chores = chores
        self._clock = clock
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="housekeeping")

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()

    def _run(self) -> None:
        due_ns = {chore.name: self._clock.raw_ns() for chore in self._chores}
        while not self._stop.is_set():
            now_ns = self._clock.raw_ns()
            for chore in self._chores:
                if now_ns >= due_ns[chore.name]:
                    chore.do()
                    due_ns[chore.name] = max(due_ns[chore.name] + round(chore.period_s * 1e9), now_ns)
            wait_s = (min(due_ns.values()) - self._clock.raw_ns()) / 1e9
            self._stop.wait(max(0.0, wait_s))
