"""UTC over a drive, from what the drive says of it now and then."""

from bisect import bisect_right
from collections.abc import Sequence

from recorder.samples import UtcTime


class UtcCourse:
    """UTC at any raw instant, straight between the instants that are told and on beyond their ends.

    Args:
        told: in order of raw time.
    """

    def __init__(self, told: Sequence[UtcTime]) -> None:
        self.told = list(told)
        self._raw_ns = [one.raw_ns for one in self.told]

    def at(self, raw_ns: int) -> UtcTime | None:
        """None if nothing is told. The uncertainty is the larger of both sides'."""
        if not self.told:
            return None
        after = bisect_right(self._raw_ns, raw_ns)
        left, right = self.told[max(after - 1, 0)], self.told[min(after, len(self.told) - 1)]
        elapsed_ns = right.raw_ns - left.raw_ns
        utc_ns = left.utc_ns + raw_ns - left.raw_ns
        if elapsed_ns > 0:
            gained_ns = right.utc_ns - left.utc_ns - elapsed_ns
            utc_ns += gained_ns * (raw_ns - left.raw_ns) // elapsed_ns
        worse = max(left, right, key=lambda one: one.sigma_ns)
        return UtcTime(raw_ns, utc_ns, worse.sigma_ns, worse.source, worse.half_width_ns)
