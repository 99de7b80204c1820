"""Whether the date that a receiver tells can be true."""

from dataclasses import dataclass
from datetime import UTC, date, datetime
from enum import StrEnum

from recorder.samples import Fix

SECOND_NS = 1_000_000_000
DAY_NS = 86_400 * SECOND_NS
ROLLOVER_NS = 1024 * 7 * DAY_NS
"""GPS counts weeks in ten bits; firmware that is old enough takes this age for the one before."""


def day_ns(day: date) -> int:
    """The first instant of a day in UTC, Unix-like."""
    return (day - date(1970, 1, 1)).days * DAY_NS


SERVICE_LIFE_NS = 12 * 365 * DAY_NS
"""No recorder runs so long after its first day; less than a rollover, so at most one date is possible."""
FACTORY_DAYS_NS = frozenset(
    day_ns(date(*day)) for day in ((1970, 1, 1), (1980, 1, 6), (1999, 8, 22), (2000, 1, 1), (2019, 4, 7))
)
"""What receivers' clocks begin at: the epochs of Unix and GPS, its two rollovers, and a round number."""


class Verdict(StrEnum):
    ACCEPTED = "accepted"
    CORRECTED = "corrected"
    REFUSED = "refused"


@dataclass(frozen=True, slots=True)
class Judgement:
    """What became of a fix's time."""

    verdict: Verdict
    gps_ns: int | None
    """To be used in its place; None if it was refused."""
    reason: str = ""


def judge(fix: Fix, not_before_ns: int) -> Judgement:
    """Accept, correct or refuse the time that a fix tells.

    Args:
        fix: its ``valid`` says whether the time comes from satellites now.
        not_before_ns: Unix-like; earlier dates cannot be. 0 believes every date, as for a log
            that is replayed.
    """
    gps_ns = fix.stamp.gps_ns
    if gps_ns is None or fix.stamp.gps_raw_ns is None:
        return Judgement(Verdict.REFUSED, None, "it tells no date and time")
    if not fix.valid:
        return Judgement(Verdict.REFUSED, None, f"no fix from satellites ({fix.mode})")
    if not_before_ns <= 0 or not_before_ns <= gps_ns <= not_before_ns + SERVICE_LIFE_NS:
        return Judgement(Verdict.ACCEPTED, gps_ns)
    day = _iso(gps_ns)
    if gps_ns // DAY_NS * DAY_NS in FACTORY_DAYS_NS:
        return Judgement(Verdict.REFUSED, None, f"{day} is a date that receivers start with")
    rollovers = max(0, -((gps_ns - not_before_ns) // ROLLOVER_NS))
    corrected_ns = gps_ns + rollovers * ROLLOVER_NS
    if corrected_ns > not_before_ns + SERVICE_LIFE_NS:
        limits = f"{_iso(not_before_ns)} to {_iso(not_before_ns + SERVICE_LIFE_NS)}"
        return Judgement(Verdict.REFUSED, None, f"{day} is not within {limits}, nor is it by week rollovers")
    reason = f"{day} is {rollovers} week rollover(s) behind, taken for {_iso(corrected_ns)}"
    return Judgement(Verdict.CORRECTED, corrected_ns, reason)


def is_leap_second(before_ns: int) -> bool:
    """Whether Unix-like time may step back by a second here: around a UTC month's first midnight."""
    nearest = datetime.fromtimestamp((before_ns + DAY_NS // 2) // DAY_NS * 86_400, tz=UTC)
    return nearest.day == 1 and abs(before_ns - int(nearest.timestamp()) * SECOND_NS) <= LEAP_WINDOW_NS


LEAP_WINDOW_NS = 5 * SECOND_NS
"""A step is noticed so soon, the latency of the sentences included."""


def _iso(ns: int) -> str:
    try:
        return f"{datetime.fromtimestamp(ns // SECOND_NS, tz=UTC):%Y-%m-%d}"
    except (OverflowError, ValueError, OSError):
        return f"second {ns // SECOND_NS}"
