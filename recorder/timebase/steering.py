"""One time for every instant, forward only, whatever is learnt later."""

from collections import deque
from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

PICO = 10**12
MS_NS = 1_000_000
SECOND_NS = 1_000_000_000
CORRECTION_S = 20
"""A correction is spread over so long, but goes never slower nor faster than these rates."""
SLOWEST_PICO = 500 * 10**6
FASTEST_PICO = 10**11
STEP_AHEAD_NS = 2 * SECOND_NS
"""A correction forward by more is a step."""
WRONG_DATE_NS = 30 * SECOND_NS
"""More than any leap seconds: who is ahead by more was told a wrong date. Time steps back then."""
KEPT_SEGMENTS = 64
"""Corrections that a late question can still be answered by; at most one a second."""
BEND_NS2_PER_S3 = 3000.0**2 / 1200.0
"""Random walk of the oscillator's rate: 3 ppm in 20 minutes, one standard deviation."""


@dataclass(frozen=True, slots=True)
class Line:
    """UTC near one raw instant, with the variance of its value and of its rate."""

    raw_ns: int
    utc_ns: int
    rate_pico: int
    """How much faster UTC goes than raw time, in 10⁻¹²."""
    variance_ns2: float
    covariance: float
    """Of value and rate, ns²/s."""
    rate_variance: float
    """ns²/s²"""
    source: str

    def at(self, raw_ns: int, beside_pico: int = 0) -> int:
        """UTC at an instant, and 10⁻¹² ns beside it; rounded down once."""
        age_ns = raw_ns - self.raw_ns
        return self.utc_ns + age_ns + (age_ns * self.rate_pico + beside_pico) // PICO

    def sigma_ns(self, raw_ns: int) -> float:
        """One standard deviation at an instant; grows without bound with the distance."""
        age_s = (raw_ns - self.raw_ns) / 1e9
        variance = self.variance_ns2 + age_s * (2 * self.covariance + age_s * self.rate_variance)
        return sqrt(max(0.0, variance) + BEND_NS2_PER_S3 * abs(age_s) ** 3 / 3)


@dataclass(frozen=True, slots=True)
class _Segment:
    """A line from some instant on, reached from where time then was."""

    line: Line
    from_raw_ns: int | None
    """None: it has been so from the beginning."""
    ahead_ns: int
    """By so much time was ahead of the line there."""
    slew_pico: int

    def left_pico(self, raw_ns: int) -> int:
        """What of ``ahead_ns`` is not corrected yet."""
        if self.from_raw_ns is None:
            return 0
        left = max(0, abs(self.ahead_ns) * PICO - self.slew_pico * (raw_ns - self.from_raw_ns))
        return left if self.ahead_ns > 0 else -left


class Steered(NamedTuple):
    """An answer."""

    utc_ns: int
    left_ns: int
    """How far it is ahead of what is known best."""
    line: Line


class Steering:
    """Follows ever better lines without a step back, in whatever order instants are asked for.

    A new line counts after the latest instant asked for so far, and is reached from there by going
    up to a tenth faster or slower. Only a wrong date is left at one step. Integers throughout: the
    rates sum to more than zero before the one rounding, so a later instant never gets an earlier
    time. Not thread-safe.
    """

    def __init__(self) -> None:
        self._segments: deque[_Segment] = deque(maxlen=KEPT_SEGMENTS)
        self._asked_raw_ns: int | None = None

    def follow(self, line: Line) -> None:
        """Take a new line."""
        if not self._segments or self._asked_raw_ns is None:
            self._segments.clear()
            self._segments.append(_Segment(line, None, 0, 0))
            return
        from_ns = self._asked_raw_ns + 1
        former = self._segments[-1]
        ahead_ns = self._answer(former, from_ns).utc_ns - line.at(from_ns)
        if ahead_ns < -STEP_AHEAD_NS or ahead_ns > WRONG_DATE_NS:
            ahead_ns = 0
        slew_pico = min(FASTEST_PICO, max(SLOWEST_PICO, abs(ahead_ns) * 1000 // CORRECTION_S))
        if former.left_pico(from_ns):
            slew_pico = max(slew_pico, former.slew_pico)
        if former.from_raw_ns == from_ns:  # nobody has asked since
            self._segments.pop()
        self._segments.append(_Segment(line, from_ns, ahead_ns, slew_pico))

    def at(self, raw_ns: int) -> Steered | None:
        """None before the first line. Later lines count only from here on."""
        if self._segments and (self._asked_raw_ns is None or raw_ns > self._asked_raw_ns):
            self._asked_raw_ns = raw_ns
        return self.peek(raw_ns)

    def peek(self, raw_ns: int) -> Steered | None:
        """As `at`, for who only looks: no later answer depends on it."""
        for segment in reversed(self._segments):
            if segment.from_raw_ns is None or segment.from_raw_ns <= raw_ns:
                return self._answer(segment, raw_ns)
        return self._answer(self._segments[0], raw_ns) if self._segments else None

    @staticmethod
    def _answer(segment: _Segment, raw_ns: int) -> Steered:
        left = segment.left_pico(raw_ns)
        return Steered(segment.line.at(raw_ns, left), left // PICO, segment.line)
