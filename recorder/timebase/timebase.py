"""From a driver's stamp to one that is complete on every clock."""

from dataclasses import replace
from threading import Lock
from typing import Any

from recorder.clock import SYSTEM_CLOCK, Clock
from recorder.config import TimebaseSection
from recorder.samples import ClockPair, Fix, Stamp, UtcTime
from recorder.timebase.combined import CombinedTime
from recorder.timebase.pairs import ClockHistory, take_pair
from recorder.timebase.utc import UtcEstimate

SET_NS = 2_000_000
"""The wall clock against raw may move so far between two pairs, a second apart: slewing does 0.5 ms."""
OLDEST_NS = 1_000_000_000
"""A kernel stamp may lie so long before its arrival; one that says otherwise comes from a wall
clock that was set in between, and is not believed."""


class Timebase:
    """All that is known of time, for all threads: one lock, held for some microseconds a call."""

    def __init__(self, settings: TimebaseSection, clock: Clock = SYSTEM_CLOCK) -> None:
        self._clock = clock
        self._lock = Lock()
        self._history = ClockHistory()
        self._utc = UtcEstimate(settings)
        self._combined: CombinedTime | None = None
        self._told: Fix | None = None
        self._valid: Fix | None = None
        first = self.sample_pair()
        self.log_offset_ns = first.realtime_ns - first.raw_ns
        """Wall clock minus raw when the timebase was made; does not change."""

    def sample_pair(self) -> ClockPair:
        """Compare the clocks and remember it; the caller does so every ``pair_seconds``."""
        pair = take_pair(self._clock)
        with self._lock:
            self._history.add(pair)
        return pair

    def observe(self, fix: Fix) -> UtcTime | None:
        """Take a fix; UTC at the arrival of its burst, None before the first valid one."""
        with self._lock:
            self._utc.observe(fix)
            if fix.stamp.gps_ns is not None:
                self._told = fix
                self._valid = fix if fix.valid else self._valid
            raw_ns = fix.stamp.gps_raw_ns if fix.stamp.gps_raw_ns is not None else fix.stamp.raw_ns
            return None if raw_ns is None else self._utc.at(raw_ns)

    def complete(self, stamp: Stamp, *, frame: bool = False) -> Stamp:
        """Refine ``raw_ns`` and fill in what the driver cannot know.

        Args:
            stamp: ``raw_ns`` is the reading at arrival (now if absent), ``realtime_ns`` the
                kernel's or library's stamp or None.
            frame: the first stamp with it fixes the reference of the combined time.
        """
        arrival_ns = self._clock.raw_ns() if stamp.raw_ns is None else stamp.raw_ns
        with self._lock:
            raw_ns = self._refined(arrival_ns, stamp.realtime_ns)
            realtime_ns = stamp.realtime_ns
            if realtime_ns is None:
                realtime_ns = self._history.realtime_from_raw(raw_ns)
            if frame and self._combined is None and realtime_ns is not None:
                self._combined = CombinedTime.at_first_frame(raw_ns, realtime_ns, self._valid)
            told = self._told.stamp if self._told else stamp
            utc = self._utc.at(raw_ns)
            return replace(
                stamp,
                raw_ns=raw_ns,
                realtime_ns=realtime_ns,
                gps_ns=told.gps_ns,
                gps_raw_ns=told.gps_raw_ns,
                combined_ns=self._combined.at(raw_ns) if self._combined else None,
                utc_ns=utc.utc_ns if utc else None,
                utc_sigma_ns=utc.sigma_ns if utc else None,
            )

    def status(self) -> dict[str, Any]:
        """For ``recorder status``: ``source``, ``utc_ns``, ``utc_sigma_ns``, ``fix_age_ns``, ``fix_valid``,
        ``pairs``, ``bracket_ns``; what is not known is None."""
        raw_ns = self._clock.raw_ns()
        with self._lock:
            utc, told, latest = self._utc.peek(raw_ns), self._told, self._history.latest
            arrival_ns = told.stamp.gps_raw_ns if told else None
            return {
                "source": utc.source if utc else None,
                "utc_ns": utc.utc_ns if utc else None,
                "utc_sigma_ns": utc.sigma_ns if utc else None,
                "fix_age_ns": None if arrival_ns is None else raw_ns - arrival_ns,
                "fix_valid": told.valid if told else None,
                "pairs": len(self._history),
                "bracket_ns": latest.bracket_ns if latest else None,
            }

    def _refined(self, arrival_ns: int, realtime_ns: int | None) -> int:
        """The kernel's stamp in raw time if it can be true, else the arrival."""
        if realtime_ns is None:
            return arrival_ns
        raw_ns = self._history.raw_from_realtime(realtime_ns)
        latest = self._history.latest
        if latest is None:
            return arrival_ns
        # a wall clock that was set since the last pair would move every stamp by as much
        offset_ns = self._clock.realtime_ns() - self._clock.raw_ns()
        if abs(offset_ns - (latest.realtime_ns - latest.raw_ns)) > SET_NS:
            return arrival_ns
        if raw_ns is None or not arrival_ns - OLDEST_NS <= raw_ns <= arrival_ns:
            return arrival_ns
        return raw_ns
