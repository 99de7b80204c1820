"""From the image numbers on the wire to a count without wrap, and to what is missing in it."""

from dataclasses import dataclass

SHORT_PERIOD = 65535
"""GigE Vision 16-bit block ids run 1 … 65535 and on at 1; 0 is never an image."""
LONG_PERIOD = 2**64 - 1
"""Extended ids are 64 bits wide and skip 0 as well; they are known by being above 65535."""
LATE = 100
"""An id so little behind the newest is a late image; one further back a counter that began anew."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """An image that came, or of which at least something came."""

    id: int
    """Counted from 0 for the first one ever seen."""
    missing: range
    """The ids right before it of which nothing came; often empty."""


class FrameIds:
    """Counts one acquisition. Every id up to the newest is in one `Arrival`, as its own or as missing."""

    def __init__(self) -> None:
        self._period = SHORT_PERIOD
        self._newest_raw: int | None = None
        self._newest = -1

    def arrive(self, raw_id: int) -> Arrival | None:
        """The id as counted, or None for an image that is late or repeated: it was counted before."""
        if raw_id > SHORT_PERIOD:
            self._period = LONG_PERIOD
        step = self._step_to(raw_id)
        if -LATE <= step <= 0:
            return None
        if step < 0:
            step = 1  # what was lost when the counter began anew cannot be known
        arrival = Arrival(self._newest + step, range(self._newest + 1, self._newest + step))
        self._newest_raw, self._newest = raw_id, arrival.id
        return arrival

    def _step_to(self, raw_id: int) -> int:
        """How far after the newest, taken the shorter way round."""
        if self._newest_raw is None:
            return 1
        half = self._period // 2
        return (raw_id - self._newest_raw + half) % self._period - half
