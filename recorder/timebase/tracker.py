"""A lower envelope that notices when it no longer applies, and begins anew."""

from dataclasses import dataclass

from recorder.timebase.lower_envelope import LowerEnvelope

SECOND_NS = 1_000_000_000
WINDOW_NS = 60 * SECOND_NS
"""As long as a crystal's drift is a constant to some microseconds: 1 ppm a minute bends it by 7 µs."""
CHUNKS = 10
SETTLED = 50
"""After so many points the spread of the delays is known."""
AGREEING = 3
"""As many in a row that lie far under the line are, and it is the line that is wrong."""
STALE_NS = 5 * SECOND_NS
"""If nothing touches the line for so long, it lies too low: the clocks have moved against each other."""
KEPT_DRIFT_PPT = 2_000_000
"""2 ppm: what the drift may change by in a restart; it is the same crystal."""
_BENDING_NS = 5_000
"""What the line may be off by the crystal's wander within the window (measured by simulation)."""
_END_OF_LINE = 6
"""At its end the line is uncertain by as many times spread / count (measured by simulation)."""


@dataclass(frozen=True, slots=True)
class Followed:
    """What a point came to."""

    line: int
    """The least delay stands here; never above the point."""
    sigma: int
    restarted: bool
    """The line begins anew with this point."""


class Tracker:
    """Follows one clock against another from points (x, y) as in `LowerEnvelope`; all in nanoseconds.

    It begins anew where x goes back (the device restarted), where several points in a row lie far under
    the line, and where for `STALE_NS` all lie far above it. One point far under the line is a fault of
    its own and moves nothing. Not thread-safe.

    Args:
        drift_sigma_ppt: how far the two clocks may run apart at first.
        keeps_drift: the drift is a crystal's: what was known of it holds after a restart.
        gap_ns: a longer gap in x also begins anew; None for clocks that go on meanwhile.
    """

    def __init__(self, *, drift_sigma_ppt: int, keeps_drift: bool, gap_ns: int | None = None) -> None:
        self._keeps_drift, self._gap_ns = keeps_drift, gap_ns
        self._prior = 0, drift_sigma_ppt
        self._last_x: int | None = None
        self._touched_x: int | None = None
        self._strange = 0
        self._begin()

    @property
    def spread_ns(self) -> int:
        """Mean delay above the least, so far."""
        return self._envelope.spread() if self._envelope.count else 0

    def follow(self, x: int, y: int) -> Followed:
        """Take a point; x should grow."""
        restarted = self._last_x is None
        if self._last_x is not None:
            gap = x - self._last_x
            if gap <= 0 or (self._gap_ns is not None and gap > self._gap_ns):
                self._restart()
                restarted = True
        if not restarted and self._below(x, y):
            self._strange += 1
            if self._strange < AGREEING:
                return Followed(y, max(self.spread_ns, _BENDING_NS), False)
            self._restart()
            restarted = True
        self._strange = 0
        self._envelope.add(x, y)
        self._last_x = x
        if not restarted and self._is_stale(x, y):
            self._restart()
            self._envelope.add(x, y)
            self._last_x, restarted = x, True
        count = self._envelope.count
        sigma = _BENDING_NS + _END_OF_LINE * max(self.spread_ns, SECOND_NS // 1000) // count
        return Followed(min(y, self._envelope.line().at(x)), sigma, restarted)

    def _below(self, x: int, y: int) -> bool:
        """Whether a point lies so far under the line that no delay explains it."""
        settled = self._envelope.count >= SETTLED
        room = max(4 * self.spread_ns, 1_000_000) if settled else 100_000_000
        return self._envelope.line().at(x) - y > room

    def _is_stale(self, x: int, y: int) -> bool:
        height = y - self._envelope.line().at(x)
        if height <= max(6 * self.spread_ns, 5_000_000):
            self._touched_x = x
        return self._touched_x is not None and x - self._touched_x > STALE_NS

    def _restart(self) -> None:
        if self._keeps_drift and self._envelope.span >= WINDOW_NS // 2:
            self._prior = self._envelope.line().slope_ppt, KEPT_DRIFT_PPT
        self._begin()

    def _begin(self) -> None:
        drift, sigma = self._prior
        self._envelope = LowerEnvelope(
            window=WINDOW_NS, chunks=CHUNKS, drift_ppt=drift, drift_sigma_ppt=sigma
        )
        self._last_x = self._touched_x = None
        self._strange = 0
