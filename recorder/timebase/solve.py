"""UTC over a whole drive, from all that was heard before and after each instant."""

from collections.abc import Iterable
from dataclasses import dataclass
from math import sqrt

from recorder.config import TimebaseSection
from recorder.samples import Fix, UtcTime
from recorder.timebase.arrivals import Arrivals, Envelope, fit

NS_PER_MS = 1_000_000


@dataclass(frozen=True, slots=True)
class SolvedUtc:
    """The answer of `solve`."""

    origin_raw_ns: int
    origin_offset_ns: int
    envelope: Envelope
    delay_sigma_ms: float

    def at(self, raw_ns: int) -> UtcTime:
        """UTC at any instant of the drive, and, with growing uncertainty, around it."""
        t_s = (raw_ns - self.origin_raw_ns) / 1e9
        utc_ns = raw_ns + self.origin_offset_ns + round(self.envelope.at(t_s) * NS_PER_MS)
        sigma_ms = sqrt(self.envelope.sigma(t_s) ** 2 + self.delay_sigma_ms**2)
        half_width_ns = round(1.96 * sigma_ms * NS_PER_MS)
        return UtcTime(raw_ns, utc_ns, round(sigma_ms * NS_PER_MS), "gnss", half_width_ns)


def solve(
    fixes: Iterable[Fix],
    settings: TimebaseSection,
    *,
    pulses_raw_ns: Iterable[int] = (),
    not_before_ns: int = 0,
) -> SolvedUtc | None:
    """Solve UTC again from all fixes of a drive; None if none of them can be trusted.

    Args:
        fixes: in order of arrival; those without a time, or not valid, are passed over.
        settings: the receiver's delay and its uncertainty.
        pulses_raw_ns: raw instants of the receiver's pulse (PPS), in order; empty without.
        not_before_ns: Unix-like; a receiver's date before it is wrong (see `judge`).
    """
    arrivals, origin = Arrivals(), None
    for one in fixes:
        gps_ns, raw_ns = one.stamp.gps_ns, one.stamp.gps_raw_ns
        if not one.valid or gps_ns is None or raw_ns is None:
            continue
        origin = origin or (raw_ns, gps_ns - raw_ns)
        arrivals.add((raw_ns - origin[0]) / 1e9, (gps_ns - raw_ns - origin[1]) / NS_PER_MS)
    if origin is None:
        return None
    offset_ns = origin[1] + settings.gnss_delay_ms * NS_PER_MS
    return SolvedUtc(origin[0], offset_ns, fit(arrivals), float(settings.gnss_delay_sigma_ms))
