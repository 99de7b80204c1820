"""The line under a cloud of points: one clock against another that is read with a delay that varies."""

from collections import deque
from dataclasses import dataclass

Point = tuple[int, int]

TRILLION = 10**12


@dataclass(frozen=True, slots=True)
class Line:
    """y = y0 + (x − x0) · slope, the slope in parts per trillion; whole numbers throughout."""

    x0: int
    y0: int
    slope_ppt: int

    def at(self, x: int) -> int:
        return self.y0 + (x - self.x0) * self.slope_ppt // TRILLION


class LowerEnvelope:
    """The steepness and height of a drifting offset under delays that are never negative.

    Given points (x, y) with y = offset + drift · x + delay, the delays independent and distributed
    exponentially about their least, the most probable line is the one under all points that has the
    least sum of distances to them; a Gaussian prior on the drift counts while there are few points. It
    goes through a corner of the points' lower convex hull.

    The window slides by chunks: each keeps its own hull, a dozen points, so memory and time are bounded
    however long it runs. x must increase. Not thread-safe.

    Args:
        window: how far back along x points count.
        chunks: in how many steps the window slides.
        drift_ppt, drift_sigma_ppt: the prior on the drift.
    """

    def __init__(self, *, window: int, chunks: int, drift_ppt: int, drift_sigma_ppt: int) -> None:
        self._chunk = max(1, window // chunks)
        self._chunks: deque[_Chunk] = deque(maxlen=chunks)
        self._prior = drift_ppt, drift_sigma_ppt
        self._line: Line | None = None
        self.count = 0
        """Points in the window."""
        self._spread = self._solved_count = self._since = 0
        """Points when it was solved last, and points since."""

    @property
    def span(self) -> int:
        """From the oldest point in the window to the newest, along x."""
        return self._chunks[-1].hull[-1][0] - self._chunks[0].begin if self._chunks else 0

    def add(self, x: int, y: int) -> None:
        """Take a point; the line is then under it too."""
        if not self._chunks or x - self._chunks[-1].begin >= self._chunk:
            if len(self._chunks) == self._chunks.maxlen:
                self.count -= self._chunks[0].count
            self._chunks.append(_Chunk(x))
            self._line = None
        self._chunks[-1].add((x, y))
        self.count += 1
        self._since += 1
        if self._line is not None and (y < self._line.at(x) or self._since > self._solved_count // 10):
            self._line = None

    def line(self) -> Line:
        """The line; there must be a point. Solved again only if points came that may change it."""
        if self._line is None:
            self._line = self._solved()
            mean_x, mean_y = self._mean()
            self._spread = max(0, mean_y - self._line.at(mean_x))
            self._solved_count, self._since = self.count, 0
        return self._line

    def spread(self) -> int:
        """Mean height of the points above the line, when it was solved last."""
        self.line()
        return self._spread

    def _mean(self) -> Point:
        count = self.count
        sum_x, sum_y = (sum(getattr(chunk, name) for chunk in self._chunks) for name in ("sum_x", "sum_y"))
        return sum_x // count, sum_y // count

    def _solved(self) -> Line:
        """Along the hull to where the posterior's derivative with respect to the slope changes sign."""
        hull: list[Point] = []
        for chunk in self._chunks:
            for point in chunk.hull:
                _extend(hull, point)
        count, (mean_x, mean_y) = self.count, self._mean()
        drift, sigma = self._prior
        slope_before: int | None = None
        for index, (x, y) in enumerate(hull):
            slope_after = _slope_ppt((x, y), hull[index + 1]) if index + 1 < len(hull) else None
            spread = max(1, mean_y - y - (mean_x - x) * drift // TRILLION)
            slope = drift + sigma * sigma * count * (mean_x - x) // (spread * TRILLION)
            if slope_before is not None and slope < slope_before:
                return Line(x, y, slope_before)
            if slope_after is None or slope <= slope_after:
                return Line(x, y, slope)
            slope_before = slope_after
        raise AssertionError("a hull has a last corner")


class _Chunk:
    """Consecutive points: their sums, and their lower convex hull from left to right."""

    __slots__ = ("begin", "count", "hull", "sum_x", "sum_y")

    def __init__(self, begin: int) -> None:
        self.begin = begin
        self.count = self.sum_x = self.sum_y = 0
        self.hull: list[Point] = []

    def add(self, point: Point) -> None:
        self.count += 1
        self.sum_x += point[0]
        self.sum_y += point[1]
        _extend(self.hull, point)


def _extend(hull: list[Point], point: Point) -> None:
    """Add a point on the right of a lower hull (Andrew's monotone chain)."""
    x, y = point
    while len(hull) >= 2:
        (x0, y0), (x1, y1) = hull[-2], hull[-1]
        if (x1 - x0) * (y - y0) > (y1 - y0) * (x - x0):
            break
        hull.pop()
    hull.append(point)


def _slope_ppt(left: Point, right: Point) -> int:
    return (right[1] - left[1]) * TRILLION // (right[0] - left[0])
