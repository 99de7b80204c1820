"""Readings of all clocks at one instant, and conversion of kernel stamps to raw time by them."""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from operator import attrgetter

from recorder.clock import Clock
from recorder.samples import ClockPair

KEPT_PAIRS = 512
"""Some seconds: besides one every ``pair_seconds`` there is one for each sample that is stamped."""
SLEW_PPM = 1000
"""A clock may run so much off raw: 500 ppm by adjtimex's frequency and 500 by adjtime. Two readings
that say more were taken before and after the clock was set."""
OLDEST_NS = 1_000_000_000
"""A kernel stamp may lie so long before its arrival."""
EDGE_NS = 20_000
"""A stamp may seem so much after its arrival, or before the sample before it, by what brackets leave open."""
GOOD_BRACKET_NS = 20_000
"""A bracket so tight need not be tried again."""


def take_pair(clock: Clock, tries: int = 5, good_ns: int = 0) -> ClockPair:
    """Read all clocks between two readings of raw; of several such brackets the tightest.

    A bracket is wide when the thread was interrupted inside it. ``raw_ns`` is its middle, so each
    other clock was read at most half of ``bracket_ns`` from it. One of at most ``good_ns`` is taken at once.
    """
    best = _bracket(clock)
    for _ in range(tries - 1):
        if best.bracket_ns <= good_ns:
            break
        best = min(best, _bracket(clock), key=lambda pair: pair.bracket_ns)
    return best


def _bracket(clock: Clock) -> ClockPair:
    before_ns = clock.raw_ns()
    monotonic_ns, realtime_ns, boottime_ns = clock.monotonic_ns(), clock.realtime_ns(), clock.boottime_ns()
    after_ns = clock.raw_ns()
    return ClockPair(
        raw_ns=(before_ns + after_ns) // 2,
        monotonic_ns=monotonic_ns,
        realtime_ns=realtime_ns,
        boottime_ns=boottime_ns,
        bracket_ns=after_ns - before_ns,
    )


@dataclass(frozen=True, slots=True)
class Conversion:
    """A reading of another clock as raw time."""

    raw_ns: int
    error_ns: int
    """It is not further off."""


Reading = Callable[[ClockPair], int]
_realtime: Reading = attrgetter("realtime_ns")
_monotonic: Reading = attrgetter("monotonic_ns")


class ClockHistory:
    """The latest pairs; converts between clocks by the two pairs around an instant.

    Between two pairs a clock ran evenly (it was slewed), or it was set: then each of the two offsets
    holds on its side, and where that leaves a choice the arrival decides. Beyond the last pair its
    offset is carried on. Not thread-safe.
    """

    def __init__(self, kept: int = KEPT_PAIRS) -> None:
        self._pairs: deque[ClockPair] = deque(maxlen=kept)

    def __len__(self) -> int:
        return len(self._pairs)

    @property
    def latest(self) -> ClockPair | None:
        return self._pairs[-1] if self._pairs else None

    def add(self, pair: ClockPair) -> ClockPair:
        """Remember a pair, and forget the oldest at the bound. Returns it with ``stepped`` also if
        the readings tell that the wall clock was set since the one before."""
        last = self.latest
        if last is not None and not pair.stepped and _is_step(last, pair, _realtime):
            pair = replace(pair, stepped=True)
        self._pairs.append(pair)
        return pair

    def raw_from_realtime(
        self, realtime_ns: int, *, arrival_ns: int, after_ns: int | None = None
    ) -> Conversion | None:
        """What a stamp of CLOCK_REALTIME is in raw time.

        Args:
            arrival_ns: the raw reading at arrival: it was not later.
            after_ns: raw, it was later than this (the last sample of the device); `OLDEST_NS` before
                the arrival if absent.

        None before the first pair, and if no instant in between fits: the stamp cannot be true. Where
        the clock was set meanwhile several may fit; the latest is taken, and the error spans them all.
        """
        return self._raw_from(_realtime, realtime_ns, arrival_ns, after_ns)

    def raw_from_monotonic(
        self, monotonic_ns: int, *, arrival_ns: int, after_ns: int | None = None
    ) -> Conversion | None:
        """As `raw_from_realtime`, for CLOCK_MONOTONIC, which is slewed and never set."""
        return self._raw_from(_monotonic, monotonic_ns, arrival_ns, after_ns)

    def realtime_from_raw(self, raw_ns: int) -> int | None:
        """What the wall clock said, None before the first pair."""
        newer: ClockPair | None = None
        for older in reversed(self._pairs):
            if older.raw_ns <= raw_ns:
                if newer is None or newer.stepped or newer.raw_ns == older.raw_ns:
                    break
                ran_ns, elapsed_ns = newer.realtime_ns - older.realtime_ns, newer.raw_ns - older.raw_ns
                return older.realtime_ns + (raw_ns - older.raw_ns) * ran_ns // elapsed_ns
            newer = older
        else:
            if newer is None:
                return None
            older = newer
        return raw_ns - older.raw_ns + older.realtime_ns

    def _raw_from(
        self, read: Reading, told_ns: int, arrival_ns: int, after_ns: int | None
    ) -> Conversion | None:
        oldest_ns = arrival_ns - OLDEST_NS
        lower_ns = oldest_ns if after_ns is None else max(after_ns, oldest_ns)
        found: list[Conversion] = []
        stepped = False
        for candidate, at_step in self._candidates(read, told_ns, lower_ns):
            stepped = stepped or at_step
            if candidate is None:
                continue
            bounded_ns = min(max(candidate.raw_ns, lower_ns), arrival_ns)
            if abs(candidate.raw_ns - bounded_ns) <= EDGE_NS:
                found.append(Conversion(bounded_ns, candidate.error_ns))
        if not found:
            return None
        latest = max(found, key=lambda one: one.raw_ns)
        spread_ns = latest.raw_ns - min(one.raw_ns for one in found) if stepped else 0
        return Conversion(latest.raw_ns, latest.error_ns + spread_ns)

    def _candidates(
        self, read: Reading, told_ns: int, lower_ns: int
    ) -> Iterator[tuple[Conversion | None, bool]]:
        """What the stamp may mean, the latest stretch of the history first, and where the clock was set."""
        newer: ClockPair | None = None
        for older in reversed(self._pairs):
            if newer is None:
                one = self._carried(older, read, told_ns, after=True)
                # set by so little at the last that it does not tell: it may be from before
                yield (one and replace(one, error_ns=one.error_ns + self._hidden_ns())), False
            elif _is_step(older, newer, read):
                for pair in (newer, older):
                    one = _by_offset(pair, read, told_ns)
                    inside = older.raw_ns - one.error_ns <= one.raw_ns <= newer.raw_ns + one.error_ns
                    yield (one if inside else None), True
            else:
                yield _between(older, newer, read, told_ns), False
            newer = older
            if newer.raw_ns < lower_ns:
                return
        if newer is not None:
            yield self._carried(newer, read, told_ns, after=False), False

    def _hidden_ns(self) -> int:
        """By how much a clock may have been set between the last two pairs without their telling."""
        if len(self._pairs) < 2:
            return 0
        older, newer = self._pairs[-2], self._pairs[-1]
        return _slewed_ns(newer.raw_ns - older.raw_ns) + (older.bracket_ns + newer.bracket_ns) // 2 + 1

    @staticmethod
    def _carried(pair: ClockPair, read: Reading, told_ns: int, *, after: bool) -> Conversion | None:
        """Beyond one end of the history."""
        one = _by_offset(pair, read, told_ns)
        return one if (one.raw_ns >= pair.raw_ns if after else one.raw_ns < pair.raw_ns) else None


def _is_step(older: ClockPair, newer: ClockPair, read: Reading) -> bool:
    """Whether the clock was set between two pairs, rather than slewed."""
    if newer.stepped and read is _realtime:
        return True
    elapsed_ns = newer.raw_ns - older.raw_ns
    moved_ns = abs(read(newer) - read(older) - elapsed_ns)  # as `_hidden_ns`
    return moved_ns > _slewed_ns(elapsed_ns) + (older.bracket_ns + newer.bracket_ns) // 2 + 1


def _between(older: ClockPair, newer: ClockPair, read: Reading, told_ns: int) -> Conversion | None:
    """By the line through two pairs; None if the stamp is not between them. However the clock ran in
    between, and if it was set by so little that it could have been slewed, it is within the error."""
    if not read(older) <= told_ns < read(newer):
        return None
    elapsed_ns, ran_ns = newer.raw_ns - older.raw_ns, read(newer) - read(older)
    raw_ns = older.raw_ns + (told_ns - read(older)) * elapsed_ns // ran_ns
    return Conversion(raw_ns, (older.bracket_ns + newer.bracket_ns) // 2 + _slewed_ns(elapsed_ns) + 2)


def _by_offset(pair: ClockPair, read: Reading, told_ns: int) -> Conversion:
    """By the offset of one pair."""
    raw_ns = told_ns - read(pair) + pair.raw_ns
    return Conversion(raw_ns, pair.bracket_ns // 2 + _slewed_ns(raw_ns - pair.raw_ns) + 1)


def _slewed_ns(elapsed_ns: int) -> int:
    return abs(elapsed_ns) * SLEW_PPM // 1_000_000
