"""UTC over a whole drive, from all that was heard before and after each instant."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import sqrt

from recorder.config import TimebaseSection
from recorder.samples import Fix, UtcTime
from recorder.timebase.arrivals import Arrivals, Envelope, fit
from recorder.timebase.dates import day_ns, is_leap_second, judge
from recorder.timebase.pulses import LATE_SIGMA_NS, PulseClock, nearest_second
from recorder.timebase.steering import MS_NS, SECOND_NS, Line
from recorder.timebase.utc import (
    CERTAIN_SIGMAS,
    HOLD_OVER_NS,
    NORMAL_95,
    PULSE_CLEAR_NS,
    PULSE_FIX_NS,
    Delay,
    envelope_line,
)


@dataclass(frozen=True, slots=True)
class SolvedUtc:
    """The answer of `solve`: what fixes and pulses tell, each weighted by its certainty."""

    origin: tuple[int, int]
    """Raw instant of the first fix, and what it told minus that."""
    envelope: Envelope
    delay: Delay
    leaps_raw_ns: tuple[int, ...]
    """Leap seconds: before each, Unix-like time was a second further on."""
    heard_raw_ns: tuple[int, ...]
    """Fixes."""
    forward: tuple[Line, ...]
    """After each pulse, by those up to it."""
    backward: tuple[Line, ...]
    """Before each pulse, by those from it on, both clocks counted backwards."""

    def at(self, raw_ns: int) -> UtcTime:
        """UTC at any instant of the drive, and, with growing uncertainty, around it."""
        base_ns, sigma_ns = self._by_fixes(raw_ns)
        estimates = [(0.0, sigma_ns**2)]
        pulsed_ns = None
        if self.forward:
            after = bisect_right(self.forward, raw_ns, key=lambda line: line.raw_ns)
            before = bisect_left(self.backward, raw_ns, key=lambda line: -line.raw_ns)
            near = [(self.forward[after - 1], 1)] if after else []
            near += [(self.backward[before], -1)] if before < len(self.backward) else []
            for line, sign in near:
                told_ns = sign * line.at(sign * raw_ns)
                estimates.append((float(told_ns - base_ns), line.sigma_ns(sign * raw_ns) ** 2))
            pulsed_ns = min(abs(raw_ns - sign * line.raw_ns) for line, sign in near)
        weight = sum(1 / variance for _, variance in estimates)
        utc_ns = base_ns + round(sum(value / variance for value, variance in estimates) / weight)
        utc_ns += SECOND_NS * sum(raw_ns < leap_ns for leap_ns in self.leaps_raw_ns)
        late_ns = LATE_SIGMA_NS if self.forward else 0.0
        sigma_ns = sqrt(1 / weight + late_ns**2)
        if pulsed_ns is not None and pulsed_ns <= HOLD_OVER_NS:
            source = "pps"
        else:
            source = "gnss" if self._heard_within(raw_ns, HOLD_OVER_NS) else "hold-over"
        return UtcTime(raw_ns, utc_ns, round(sigma_ns), source, round(NORMAL_95 * sigma_ns))

    def _by_fixes(self, raw_ns: int) -> tuple[int, float]:
        t_s = (raw_ns - self.origin[0]) / 1e9
        utc_ns = raw_ns + self.origin[1] + round((self.envelope.at(t_s) + self.delay.ms) * MS_NS)
        return utc_ns, sqrt(self.envelope.sigma(t_s) ** 2 + self.delay.sigma_ms**2) * MS_NS

    def _heard_within(self, raw_ns: int, ns: int) -> bool:
        index = bisect_left(self.heard_raw_ns, raw_ns - ns)
        return index < len(self.heard_raw_ns) and self.heard_raw_ns[index] <= raw_ns + ns


def solve(
    fixes: Iterable[Fix],
    settings: TimebaseSection,
    *,
    pulses_raw_ns: Iterable[int] = (),
) -> SolvedUtc | None:
    """Solve UTC again from all fixes of a drive; None if none of them can be trusted.

    Args:
        fixes: in order of arrival; those that `judge` refuses are passed over.
        settings: the receiver's delay and its uncertainty, and the earliest date to be believed.
        pulses_raw_ns: raw instants of the receiver's pulse (PPS), in order; empty without.
    """
    arrivals, heard = Arrivals(), list[int]()
    origin: tuple[int, int] | None = None
    for one in fixes:
        gps_ns, raw_ns = judge(one, day_ns(settings.not_before)).gps_ns, one.stamp.gps_raw_ns
        if gps_ns is None or raw_ns is None:
            continue
        origin = origin or (raw_ns, gps_ns - raw_ns)
        heard.append(raw_ns)
        arrivals.add((raw_ns - origin[0]) / 1e9, (gps_ns - raw_ns - origin[1]) / MS_NS)
    if origin is None:
        return None
    envelope, delay = fit(arrivals), Delay(settings)
    named = list(_named(pulses_raw_ns, heard, envelope, origin, delay))
    if named:
        off_ns = [second_ns - line.at(raw_ns) for raw_ns, second_ns, line in named]
        delay.ms += sum(off_ns) / len(off_ns) / MS_NS
        delay.sigma_ms = sum(envelope.sigma((raw_ns - origin[0]) / 1e9) for raw_ns, _, _ in named) / len(
            named
        )
    leaps = [
        origin[0] + round(step.t_s * 1e9)
        for step in arrivals.whole_steps
        if step.seconds == -1 and is_leap_second(_told_ns(envelope, origin, delay, step.t_s))
    ]
    pulses = [(raw_ns, second_ns) for raw_ns, second_ns, _ in named]
    back = [(-raw_ns, -second_ns) for raw_ns, second_ns in reversed(pulses)]
    return SolvedUtc(
        origin, envelope, delay, tuple(leaps), tuple(heard), _filtered(pulses), _filtered(back)[::-1]
    )


def _named(
    pulses_raw_ns: Iterable[int],
    heard: Sequence[int],
    envelope: Envelope,
    origin: tuple[int, int],
    delay: Delay,
) -> Iterable[tuple[int, int, Line]]:
    """Pulses soon after a fix, their full second, and the line by fixes, where the second is certain."""
    for raw_ns in pulses_raw_ns:
        index = bisect_right(heard, raw_ns)
        if not index or raw_ns - heard[index - 1] > PULSE_FIX_NS:
            continue
        t_s = (raw_ns - origin[0]) / 1e9
        line = envelope_line(envelope, origin, delay, 0.0, t_s)
        second_ns, away_ns = nearest_second(line, raw_ns)
        if away_ns + CERTAIN_SIGMAS * envelope.sigma(t_s) * MS_NS + PULSE_CLEAR_NS <= SECOND_NS // 2:
            yield raw_ns, second_ns, line


def _filtered(pulses: Sequence[tuple[int, int]]) -> tuple[Line, ...]:
    clock, lines = PulseClock(late_sigma_ns=0.0), list[Line]()
    for raw_ns, utc_ns in pulses:
        if clock.observe(raw_ns, utc_ns) and (line := clock.line()) is not None:
            lines.append(line)
    return tuple(lines)


def _told_ns(envelope: Envelope, origin: tuple[int, int], delay: Delay, t_s: float) -> int:
    return envelope_line(envelope, origin, delay, 0.0, t_s).utc_ns
