"""The thread that compares the machine's clocks."""

import logging
import threading
from collections.abc import Callable

from recorder.clock import Clock
from recorder.samples import ClockPair
from recorder.timebase import ClockWatch, NoWatch, Timebase

_log = logging.getLogger("recorder.clock_pairs")


class ClockPairs:
    """Takes a pair every ``period_s``, and at once when the wall clock is set.

    Args:
        record: takes each pair; must not wait.
        watch: notices that the wall clock is set; closed with this.
    """

    def __init__(
        self,
        timebase: Timebase,
        record: Callable[[ClockPair], None],
        period_s: float,
        *,
        clock: Clock,
        watch: ClockWatch,
    ) -> None:
        self._timebase, self._record = timebase, record
        self._period_ns, self._clock, self._watch = round(period_s * 1e9), clock, watch
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="clock pairs", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        self._watch.wake()
        if self._thread.ident is not None:
            self._thread.join()
        self._watch.close()

    def _run(self) -> None:
        stepped, due_ns = False, self._clock.raw_ns()
        while not self._stop.is_set():
            pair = self._timebase.sample_pair(stepped=stepped)
            if pair.stepped:
                _log.warning("the wall clock was set")
            self._record(pair)
            now_ns = self._clock.raw_ns()
            if now_ns >= due_ns:
                due_ns = max(due_ns + self._period_ns, now_ns)
            stepped = self._wait((due_ns - now_ns) / 1e9)

    def _wait(self, timeout_s: float) -> bool:
        try:
            return self._watch.wait(timeout_s)
        except OSError as error:  # the pairs themselves still tell that the clock was set, only later
            _log.error("the wall clock is no longer watched: %s", error)
            self._watch.close()
            self._watch = NoWatch()
            return False
