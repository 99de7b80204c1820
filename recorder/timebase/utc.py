"""UTC from the receiver's fixes, with its uncertainty."""

from collections import deque
from dataclasses import dataclass
from math import isqrt

from recorder.config import TimebaseSection
from recorder.samples import Fix, UtcTime

MS_NS = 1_000_000
OSCILLATOR_PPM = 50
"""What the machine's oscillator may be off; the drift is not estimated yet."""
WOBBLE_NS = 170 * MS_NS
"""Of the first sentence of a SiRF receiver against the second (gpsd time service how-to)."""
DISBELIEVED_NS = 2_000 * MS_NS
"""A fix that is further from the ones before is not taken at its word; receivers jump by 0.2 s."""
AGREEING = 3
"""As many in a row that agree with each other are, and time steps: the ones before were wrong."""
KEPT_SEGMENTS = 16
"""Fixes that a late question can still be answered by; at one a second far more than needed."""


@dataclass(frozen=True, slots=True)
class _Segment:
    """One fix, and the raw instant from which it is the one that counts."""

    gps_ns: int
    gps_raw_ns: int
    from_raw_ns: int | None
    """None: it has been so from the beginning."""
    floor_ns: int
    """No answer of this segment is before the one that the former gave at ``from_raw_ns``."""


class UtcEstimate:
    """UTC at a raw instant, by the latest valid fix and the raw time since.

    utc = gps + delay + (raw − gps_raw); sigma² = delay_sigma² + (50 ppm · age)² + wobble² +
    (what was held back)². For a later instant never an earlier time, in whatever order the
    instants are asked for: a new fix counts only from the latest instant asked for so far, and
    where it would step back, the time is held and sigma says by how much. Only a date that was
    wrong by seconds is left at one step, once several fixes agree against it. Not thread-safe.
    """

    def __init__(self, settings: TimebaseSection) -> None:
        self._delay_ns = settings.gnss_delay_ms * MS_NS
        self._delay_sigma_ns = settings.gnss_delay_sigma_ms * MS_NS
        self._segments: deque[_Segment] = deque(maxlen=KEPT_SEGMENTS)
        self._asked_raw_ns: int | None = None
        self._contradictions = 0
        self._contradicting_ns = 0

    def observe(self, fix: Fix) -> None:
        """Take a fix; only a valid one that tells date and time counts."""
        gps_ns, gps_raw_ns = fix.stamp.gps_ns, fix.stamp.gps_raw_ns
        if not fix.valid or gps_ns is None or gps_raw_ns is None:
            return
        former = None if self._asked_raw_ns is None else self.peek(self._asked_raw_ns)
        if former is None:
            self._segments.append(_Segment(gps_ns, gps_raw_ns, None, 0))
        elif not self._contradicts(gps_ns - gps_raw_ns):
            self._segments.append(_Segment(gps_ns, gps_raw_ns, former.raw_ns, former.utc_ns))
        elif self._contradictions >= AGREEING:  # it was the former that was wrong: step
            self._segments.append(_Segment(gps_ns, gps_raw_ns, former.raw_ns, 0))
            self._contradictions = 0

    def _contradicts(self, offset_ns: int) -> bool:
        """Whether a fix is seconds away from those before it; counts how many in a row agree on that."""
        last = self._segments[-1]
        if abs(offset_ns - (last.gps_ns - last.gps_raw_ns)) <= DISBELIEVED_NS:
            self._contradictions = 0
            return False
        agrees = abs(offset_ns - self._contradicting_ns) <= DISBELIEVED_NS
        self._contradictions = self._contradictions + 1 if agrees else 1
        self._contradicting_ns = offset_ns
        return True

    def at(self, raw_ns: int) -> UtcTime | None:
        """None before the first valid fix. Later fixes count only from here on."""
        told = self.peek(raw_ns)
        if told is not None and (self._asked_raw_ns is None or raw_ns > self._asked_raw_ns):
            self._asked_raw_ns = raw_ns
        return told

    def peek(self, raw_ns: int) -> UtcTime | None:
        """As `at`, for who only looks: nothing that is recorded depends on it."""
        segment = self._segment_at(raw_ns)
        if segment is None:
            return None
        age_ns = raw_ns - segment.gps_raw_ns
        estimate_ns = segment.gps_ns + self._delay_ns + age_ns
        utc_ns = estimate_ns if segment.from_raw_ns is None else max(estimate_ns, segment.floor_ns)
        drift_ns = abs(age_ns) * OSCILLATOR_PPM // 1_000_000
        terms_ns = (self._delay_sigma_ns, drift_ns, WOBBLE_NS, utc_ns - estimate_ns)
        sigma_ns = isqrt(sum(term * term for term in terms_ns))
        return UtcTime(raw_ns=raw_ns, utc_ns=utc_ns, sigma_ns=sigma_ns, source="gnss")

    def _segment_at(self, raw_ns: int) -> _Segment | None:
        """The one in force at an instant; for one before all that are remembered the oldest."""
        for segment in reversed(self._segments):
            if segment.from_raw_ns is None or segment.from_raw_ns <= raw_ns:
                return segment
        return self._segments[0] if self._segments else None
