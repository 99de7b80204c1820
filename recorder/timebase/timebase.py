"""From a driver's stamp to one that is complete on every clock."""

from dataclasses import replace
from math import isqrt
from threading import Lock
from typing import Any

from recorder.clock import SYSTEM_CLOCK, Clock
from recorder.config import TimebaseSection
from recorder.samples import ClockPair, Fix, PpsEdge, Stamp, UtcTime
from recorder.timebase.combined import CombinedTime
from recorder.timebase.dates import Judgement
from recorder.timebase.pairs import GOOD_BRACKET_NS, ClockHistory, Conversion, take_pair
from recorder.timebase.utc import UtcEstimate


class Timebase:
    """All that is known of time, for all threads: one lock, held for some microseconds a call."""

    def __init__(self, settings: TimebaseSection, clock: Clock = SYSTEM_CLOCK) -> None:
        self._clock = clock
        self._lock = Lock()
        self._history = ClockHistory()
        self._stepped = False
        """The wall clock was set since the last pair that is recorded."""
        self._steps = self._pairs = 0
        self._latest: ClockPair | None = None
        self._utc = UtcEstimate(settings)
        self.judgement: Judgement | None = None
        """What became of the time of the last fix."""
        self._combined: CombinedTime | None = None
        self._told: Fix | None = None
        self._valid: Fix | None = None
        first = self.sample_pair()
        self.log_offset_ns = first.realtime_ns - first.raw_ns
        """Wall clock minus raw when the timebase was made; does not change."""

    def sample_pair(self, *, stepped: bool = False) -> ClockPair:
        """Compare the clocks and remember it; the caller does so every ``pair_seconds``, and at once
        when the wall clock was set (``stepped``)."""
        with self._lock:
            pair = self._compare(take_pair(self._clock), stepped=stepped)
            pair = self._latest = replace(pair, stepped=self._stepped)
            self._pairs += 1
            self._steps += self._stepped
            self._stepped = False
        return pair

    def observe(self, fix: Fix) -> UtcTime | None:
        """Take a fix; UTC at the arrival of its burst, None before the first valid one."""
        with self._lock:
            self.judgement = self._utc.observe(fix)
            if fix.stamp.gps_ns is not None:
                self._told = fix
                self._valid = fix if fix.valid else self._valid
            raw_ns = fix.stamp.gps_raw_ns if fix.stamp.gps_raw_ns is not None else fix.stamp.raw_ns
            return None if raw_ns is None else self._utc.at(raw_ns)

    def observe_pulse(self, edge: PpsEdge) -> bool:
        """Take an edge of the receiver's pulse, its stamp refined; whether it is believed. One whose
        kernel stamp could not be converted is not."""
        raw_ns = edge.stamp.raw_ns
        if raw_ns is None or edge.stamp.raw_error_ns is None:
            return False
        with self._lock:
            return self._utc.observe_pulse(raw_ns)

    def refine(self, stamp: Stamp, *, after_ns: int | None = None) -> Stamp:
        """With ``raw_ns`` of the kernel's stamp and its error, where there is one that can be true.

        Args:
            stamp: ``raw_ns`` is the reading at arrival (now if absent); ``monotonic_ns`` or
                ``realtime_ns`` the kernel's or library's stamp.
            after_ns: raw, it was later than this: of the last sample of the same device.
        """
        arrival_ns = self._clock.raw_ns() if stamp.raw_ns is None else stamp.raw_ns
        if stamp.monotonic_ns is None and stamp.realtime_ns is None:
            return replace(stamp, raw_ns=arrival_ns)
        with self._lock:
            # a reading of now: what was slewed or set since the last pair is in it
            self._compare(take_pair(self._clock, tries=3, good_ns=GOOD_BRACKET_NS))
            found = self._converted(stamp, arrival_ns, after_ns)
        if found is None:
            return replace(stamp, raw_ns=arrival_ns)
        return replace(stamp, raw_ns=found.raw_ns, raw_error_ns=found.error_ns)

    def complete(self, stamp: Stamp, *, frame: bool = False) -> Stamp:
        """Fill in what the driver cannot know; `refine` it first where the kernel stamps.

        UTC is of the middle of the exposure where that is known, else of ``raw_ns``.

        Args:
            frame: the first stamp with it fixes the reference of the combined time.
        """
        raw_ns = self._clock.raw_ns() if stamp.raw_ns is None else stamp.raw_ns
        middle_ns = raw_ns if stamp.exposure_raw_ns is None else stamp.exposure_raw_ns
        with self._lock:
            realtime_ns = stamp.realtime_ns
            if realtime_ns is None:
                realtime_ns = self._history.realtime_from_raw(raw_ns)
            if frame and self._combined is None and realtime_ns is not None:
                self._combined = CombinedTime.at_first_frame(raw_ns, realtime_ns, self._valid)
            told = self._told.stamp if self._told else stamp
            utc = self._utc.at(middle_ns)
            return replace(
                stamp,
                raw_ns=raw_ns,
                realtime_ns=realtime_ns,
                gps_ns=told.gps_ns,
                gps_raw_ns=told.gps_raw_ns,
                combined_ns=self._combined.at(raw_ns) if self._combined else None,
                utc_ns=utc.utc_ns if utc else None,
                utc_sigma_ns=_together(utc.sigma_ns, stamp.exposure_sigma_ns or 0) if utc else None,
            )

    def status(self) -> dict[str, Any]:
        """For ``recorder status``; what is not known is None.

        Keys: ``source``, ``utc_ns``, ``utc_sigma_ns``, ``utc_half_width_ns``, ``fix_age_ns``, ``fix_valid``,
        ``pairs``, ``bracket_ns``, ``clock_steps``.
        """
        raw_ns = self._clock.raw_ns()
        with self._lock:
            utc, told, latest = self._utc.peek(raw_ns), self._told, self._latest
            arrival_ns = told.stamp.gps_raw_ns if told else None
            return {
                "source": utc.source if utc else None,
                "utc_ns": utc.utc_ns if utc else None,
                "utc_sigma_ns": utc.sigma_ns if utc else None,
                "utc_half_width_ns": utc.half_width_ns if utc else None,
                "fix_age_ns": None if arrival_ns is None else raw_ns - arrival_ns,
                "fix_valid": told.valid if told else None,
                "pairs": self._pairs,
                "bracket_ns": latest.bracket_ns if latest else None,
                "clock_steps": self._steps,
            }

    def _compare(self, pair: ClockPair, *, stepped: bool = False) -> ClockPair:
        pair = self._history.add(replace(pair, stepped=stepped))
        self._stepped = self._stepped or pair.stepped
        return pair

    def _converted(self, stamp: Stamp, arrival_ns: int, after_ns: int | None) -> Conversion | None:
        if stamp.monotonic_ns is not None:
            return self._history.raw_from_monotonic(
                stamp.monotonic_ns, arrival_ns=arrival_ns, after_ns=after_ns
            )
        assert stamp.realtime_ns is not None
        return self._history.raw_from_realtime(stamp.realtime_ns, arrival_ns=arrival_ns, after_ns=after_ns)


def _together(sigma_ns: int, other_ns: int) -> int:
    return isqrt(sigma_ns**2 + other_ns**2) if other_ns else sigma_ns
