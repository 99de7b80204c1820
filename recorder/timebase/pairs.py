"""Readings of all clocks at one instant, and conversion between clocks by them."""

from collections import deque
from collections.abc import Callable

from recorder.clock import Clock
from recorder.samples import ClockPair

KEPT_PAIRS = 120
"""Two minutes at one a second: a kernel stamp is converted within a second of its arrival."""


def take_pair(clock: Clock, tries: int = 5) -> ClockPair:
    """Read all clocks between two readings of raw; of several such brackets the tightest.

    A bracket is wide when the thread was interrupted inside it. ``raw_ns`` is its middle, so each
    other clock was read at most half of ``bracket_ns`` from it.
    """
    return min((_bracket(clock) for _ in range(max(1, tries))), key=lambda pair: pair.bracket_ns)


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


class ClockHistory:
    """The latest pairs; converts a reading of one clock by the pair nearest to it on that clock.

    Only the offset of that pair is used: with a clock slewed by at most 500 ppm and a pair a second the
    error stays under 0.5 ms. Of two equally near the later counts. Not thread-safe.
    """

    def __init__(self, kept: int = KEPT_PAIRS) -> None:
        self._pairs: deque[ClockPair] = deque(maxlen=kept)

    def __len__(self) -> int:
        return len(self._pairs)

    @property
    def latest(self) -> ClockPair | None:
        return self._pairs[-1] if self._pairs else None

    def add(self, pair: ClockPair) -> None:
        """Remember a pair, and forget the oldest at the bound."""
        self._pairs.append(pair)

    def raw_from_realtime(self, realtime_ns: int) -> int | None:
        """None before the first pair. Wrong by the step if the wall clock was set since the
        nearest pair: bound the result by a raw reading."""
        pair = self._nearest(lambda one: abs(one.realtime_ns - realtime_ns))
        return None if pair is None else realtime_ns - pair.realtime_ns + pair.raw_ns

    def raw_from_monotonic(self, monotonic_ns: int) -> int | None:
        """None before the first pair."""
        pair = self._nearest(lambda one: abs(one.monotonic_ns - monotonic_ns))
        return None if pair is None else monotonic_ns - pair.monotonic_ns + pair.raw_ns

    def realtime_from_raw(self, raw_ns: int) -> int | None:
        """None before the first pair."""
        pair = self._nearest(lambda one: abs(one.raw_ns - raw_ns))
        return None if pair is None else raw_ns - pair.raw_ns + pair.realtime_ns

    def _nearest(self, distance_ns: Callable[[ClockPair], int]) -> ClockPair | None:
        return min(reversed(self._pairs), key=distance_ns, default=None)
