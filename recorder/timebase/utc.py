"""UTC from the receiver's fixes and pulses, with its uncertainty."""

from math import sqrt

from recorder.config import TimebaseSection
from recorder.samples import Fix, UtcTime
from recorder.timebase.arrivals import Arrivals, Envelope, fit
from recorder.timebase.dates import Judgement, day_ns, judge
from recorder.timebase.pulses import PulseClock, nearest_second
from recorder.timebase.steering import MS_NS, SECOND_NS, Line, Steered, Steering

KEPT_BLOCKS = 240
"""An hour of fixes: the drift is known well by then, and changes with temperature."""
FIRST_FIT_S, LAST_FIT_S = 1.0, 60.0
"""The line is fitted again after a twentieth of the time since the first fix, within these."""
HOLD_OVER_NS = 10 * SECOND_NS
"""After so long without a fix or pulse time is held over."""
PULSE_FIX_NS = 2_500 * MS_NS
"""A pulse counts if a valid fix came so shortly before: without one, the receiver's clock runs free."""
MEASURED_NS = 30 * SECOND_NS
"""Pulses tell the delay of fixes that are so near; the earliest of a block is some seconds old."""
CERTAIN_SIGMAS = 3.0
"""The second of a pulse is certain if the line is so many of its sigmas from the middle of two."""
PULSE_CLEAR_NS = 50 * MS_NS
NORMAL_95 = 1.96


def utc_time(steered: Steered, raw_ns: int, source: str) -> UtcTime:
    """An answer with its interval: what is still being corrected adds to it in full."""
    sigma_ns = steered.line.sigma_ns(raw_ns)
    half_width_ns = round(NORMAL_95 * sigma_ns) + abs(steered.left_ns)
    return UtcTime(
        raw_ns, steered.utc_ns, round(sqrt(sigma_ns**2 + steered.left_ns**2)), source, half_width_ns
    )


class Delay:
    """From the instant that a fix speaks of to its arrival at the earliest.

    Given, with its uncertainty, since nothing but a pulse can tell it; measured from then on.
    """

    def __init__(self, settings: TimebaseSection) -> None:
        self.ms = float(settings.gnss_delay_ms)
        self.sigma_ms = float(settings.gnss_delay_sigma_ms)

    def measure(self, pulses: Line, envelope: Line, own_sigma_ns: float) -> None:
        """Take it from a line by pulses and one by fixes that stands on this delay.

        ``own_sigma_ns`` is the second line's without the delay's.
        """
        off_ns = pulses.utc_ns - envelope.utc_ns + envelope.raw_ns - pulses.raw_ns
        off_ns += (envelope.raw_ns - pulses.raw_ns) * pulses.rate_pico // 10**12
        self.ms += off_ns / MS_NS
        self.sigma_ms = sqrt(pulses.sigma_ns(envelope.raw_ns) ** 2 + own_sigma_ns**2) / MS_NS


class UtcEstimate:
    """UTC at a raw instant: the better of what fixes and what pulses tell, steered forward only.

    Some microseconds a fix; now and then, at most once a minute after the first twenty, a
    millisecond for the line. Not thread-safe.
    """

    def __init__(self, settings: TimebaseSection) -> None:
        self._not_before_ns = day_ns(settings.not_before)
        self._delay = Delay(settings)
        self._arrivals = Arrivals(KEPT_BLOCKS)
        self._pulses = PulseClock()
        self._steering = Steering()
        self._origin: tuple[int, int] | None = None
        self._fix_raw_ns: int | None = None
        self._heard_raw_ns = 0
        self._fit_due_s = 0.0
        self._envelope: Line | None = None

    def observe(self, fix: Fix) -> Judgement:
        """Take a fix; what became of it. One that is refused changes nothing."""
        judgement = judge(fix, self._not_before_ns)
        raw_ns = fix.stamp.gps_raw_ns
        if judgement.gps_ns is None or raw_ns is None:
            return judgement
        offset_ns = judgement.gps_ns - raw_ns
        if self._origin is None:
            self._origin = raw_ns, offset_ns
        t_s = (raw_ns - self._origin[0]) / 1e9
        self._fix_raw_ns, self._heard_raw_ns = raw_ns, max(raw_ns, self._heard_raw_ns)
        levels = len(self._arrivals.levels), len(self._arrivals.whole_steps)
        self._arrivals.add(t_s, (offset_ns - self._origin[1]) / MS_NS)
        if t_s >= self._fit_due_s or levels != (len(self._arrivals.levels), len(self._arrivals.whole_steps)):
            self._fit_due_s = t_s + min(LAST_FIT_S, max(FIRST_FIT_S, t_s / 20))
            self._fit()
        return judgement

    def observe_pulse(self, raw_ns: int) -> bool:
        """Take the raw instant of a pulse; whether its second is known and it is believed."""
        best = self._best(raw_ns)
        if best is None or self._fix_raw_ns is None or not 0 <= raw_ns - self._fix_raw_ns <= PULSE_FIX_NS:
            return False
        second_ns, away_ns = nearest_second(best, raw_ns)
        unsure_ns = CERTAIN_SIGMAS * self._own_sigma_ns(best, raw_ns) + PULSE_CLEAR_NS
        if away_ns + unsure_ns > SECOND_NS // 2 or not self._pulses.observe(raw_ns, second_ns):
            return False
        self._heard_raw_ns = max(raw_ns, self._heard_raw_ns)
        self._follow(raw_ns)
        return True

    def at(self, raw_ns: int) -> UtcTime | None:
        """None before the first fix that was accepted. Later ones count only from here on."""
        steered = self._steering.at(raw_ns)
        return None if steered is None else utc_time(steered, raw_ns, self._source(steered, raw_ns))

    def peek(self, raw_ns: int) -> UtcTime | None:
        """As `at`, for who only looks: nothing that is recorded depends on it."""
        steered = self._steering.peek(raw_ns)
        return None if steered is None else utc_time(steered, raw_ns, self._source(steered, raw_ns))

    def _source(self, steered: Steered, raw_ns: int) -> str:
        return "hold-over" if raw_ns - self._heard_raw_ns > HOLD_OVER_NS else steered.line.source

    def _fit(self) -> None:
        envelope = fit(self._arrivals)
        self._envelope = self._line(envelope)
        pulses = self._pulses.line()
        if pulses is not None and abs(self._envelope.raw_ns - pulses.raw_ns) <= MEASURED_NS:
            own_sigma_ns = self._own_sigma_ns(self._envelope, self._envelope.raw_ns)
            self._delay.measure(pulses, self._envelope, own_sigma_ns)
            self._envelope = self._line(envelope)
        self._follow(self._envelope.raw_ns)

    def _line(self, envelope: Envelope) -> Line:
        assert self._origin is not None
        return envelope_line(envelope, self._origin, self._delay, self._arrivals.left_ms, envelope.end_s)

    def _follow(self, raw_ns: int) -> None:
        best = self._best(raw_ns)
        if best is not None:
            self._steering.follow(best)

    def _best(self, raw_ns: int) -> Line | None:
        lines = [line for line in (self._pulses.line(), self._envelope) if line is not None]
        return min(lines, key=lambda line: line.sigma_ns(raw_ns), default=None)

    def _own_sigma_ns(self, line: Line, raw_ns: int) -> float:
        """Without the uncertainty of the delay, which the second's middle allows for itself."""
        sigma_ns = line.sigma_ns(raw_ns)
        delay_ns = self._delay.sigma_ms * MS_NS if line.source == "gnss" else 0.0
        return sqrt(max(0.0, sigma_ns**2 - delay_ns**2))


def envelope_line(
    envelope: Envelope, origin: tuple[int, int], delay: Delay, left_ms: float, t_s: float
) -> Line:
    """The line by fixes near an instant; ``origin`` is the first one's raw instant and offset."""
    raw_ns = origin[0] + round(t_s * 1e9)
    offset_ms = envelope.at(t_s) - left_ms + delay.ms
    variance, covariance, rate_variance = (one * MS_NS**2 for one in envelope.variances(t_s))
    return Line(
        raw_ns=raw_ns,
        utc_ns=raw_ns + origin[1] + round(offset_ms * MS_NS),
        rate_pico=round(envelope.slope(t_s) * 1e9),
        variance_ns2=variance + (delay.sigma_ms * MS_NS) ** 2,
        covariance=covariance,
        rate_variance=rate_variance,
        source="gnss",
    )
