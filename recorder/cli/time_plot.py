"""A picture of what is known of UTC over a drive."""

from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from recorder.config import TimebaseSection
from recorder.errors import DriveError, StorageError, UsageError
from recorder.samples import ClockPair, Fix, UtcTime
from recorder.storage import Drive
from recorder.storage.drive import SOLVED_TOPIC

Points = NDArray[np.float64]

_WIDTH, _HEIGHT = 1400, 840
_LEFT, _RIGHT = 110, 40
_PANELS = ((90, 520), (600, 770))
"""Top and bottom rows: the offset, and the width of the interval."""
_INK, _GRID, _AWAY = (40, 40, 40), (225, 225, 225), (240, 240, 240)
_BAND, _LINE, _FIX, _STEP = (245, 222, 190), (180, 90, 20), (60, 140, 40), (40, 40, 210)
_OUTAGE_S = 5.0
"""Without a valid fix for longer, the receiver is out."""


@dataclass(slots=True)
class _Story:
    """What is drawn: seconds since the first message, milliseconds of UTC minus raw time."""

    utc: Points
    """(N, 3): when, offset, half width of the 95 % interval."""
    fixes: Points
    """(N, 2)"""
    end_s: float
    steps_s: list[float] = field(default_factory=list)


def write_plot(drive: Drive, out: Path) -> None:
    """Draw a drive's time: the offset of UTC from raw time less its trend, its 95 % interval, the fixes,
    the outages, and where the wall clock was set.

    Raises `UsageError` for a name that is no .png and for a drive without UTC, `StorageError` if it
    cannot be written.
    """
    if out.suffix.lower() != ".png":
        raise UsageError("a picture is a .png", where=str(out), todo="name it so")
    story = _read(drive)
    if not len(story.utc):
        raise UsageError("nothing is known of UTC, so there is nothing to draw", where=str(drive.path))
    data = cv2.imencode(".png", _draw(story, drive.path.name))[1].tobytes()
    try:
        out.write_bytes(data)
    except OSError as error:
        raise StorageError(f"cannot be written ({error.strerror})", where=str(out)) from error


def _read(drive: Drive) -> _Story:
    topic = SOLVED_TOPIC if SOLVED_TOPIC in drive.topics else "/time/utc"
    first_ns = min((info.first_ns for info in drive.topics.values()), default=0) - drive.log_offset_ns
    last_ns = max((info.last_ns for info in drive.topics.values()), default=0) - drive.log_offset_ns
    told = [one for one in _samples(drive, topic) if isinstance(one, UtcTime)]
    if not told:
        return _Story(np.zeros((0, 3)), np.zeros((0, 2)), 0.0)
    origin_ns = told[0].utc_ns - told[0].raw_ns
    rows = [
        ((u.raw_ns - first_ns) / 1e9, (u.utc_ns - u.raw_ns - origin_ns) / 1e6,
         (u.interval_ns[1] - u.utc_ns) / 1e6)
        for u in told
    ]  # fmt: skip
    delay_ns = 1_000_000 * int(
        drive.config.get("timebase", {}).get("gnss_delay_ms", TimebaseSection().gnss_delay_ms)
    )
    fixes = [
        ((raw_ns - first_ns) / 1e9, (gps_ns + delay_ns - raw_ns - origin_ns) / 1e6)
        for fix in _samples(drive, "/gnss/fix")
        if isinstance(fix, Fix) and fix.valid
        for gps_ns, raw_ns in [(fix.stamp.gps_ns, fix.stamp.gps_raw_ns)]
        if gps_ns is not None and raw_ns is not None
    ]
    pairs = (one for one in _samples(drive, "/clock/pairs") if isinstance(one, ClockPair))
    return _Story(
        utc=np.array(rows),
        fixes=np.array(fixes).reshape(-1, 2),
        end_s=(last_ns - first_ns) / 1e9,
        steps_s=[(pair.raw_ns - first_ns) / 1e9 for pair in pairs if pair.stepped],
    )


def _samples(drive: Drive, topic: str) -> list[object]:
    found: list[object] = []
    for entry in drive.entries(topic):
        try:
            found.append(drive.access.message(entry).sample)
        except (DriveError, ValueError):
            continue  # `recorder inspect` tells of it
    return found


def _draw(story: _Story, name: str) -> NDArray[np.uint8]:
    picture = np.full((_HEIGHT, _WIDTH, 3), 255, np.uint8)
    when, offset, half = story.utc.T
    slope, level = np.polyfit(when, offset, 1) if len(when) > 1 else (0.0, offset[0])
    offset = offset - level - slope * when
    fixes = story.fixes.copy()
    fixes[:, 1] -= level + slope * fixes[:, 0]
    _text(picture, f"{name}: UTC over the drive", (_LEFT, 40), 0.8)
    _text(picture, f"trend of {1000 * slope:+.3f} ppm taken out", (_LEFT, 68), 0.5)
    _legend(picture)
    reach = float(np.percentile(half + abs(offset), 98)) if len(half) else 1.0
    if len(fixes):
        reach = max(reach, float(np.percentile(abs(fixes[:, 1]), 98)))
    upper = _Panel(picture, _PANELS[0], (0, story.end_s), (-1.1 * reach, 1.1 * reach), "UTC - raw time, ms")
    lower = _Panel(picture, _PANELS[1], (0, story.end_s), (0, 1.15 * float(half.max())), "95 %, +- ms")
    for begin_s, end_s in _outages(story):
        for panel in (upper, lower):
            panel.shade(begin_s, end_s)
    for panel in (upper, lower):
        panel.frame()
    band = np.concatenate([np.c_[when, offset + half], np.c_[when, offset - half][::-1]])
    upper.fill(band)
    upper.dots(fixes)
    upper.line(np.c_[when, offset])
    lower.line(np.c_[when, half])
    for at_s in story.steps_s:
        for panel in (upper, lower):
            panel.mark(at_s)
    _text(picture, "s since the first message", (_WIDTH // 2 - 90, _HEIGHT - 18), 0.5)
    return picture


def _outages(story: _Story) -> list[tuple[float, float]]:
    edges = np.concatenate([[0.0], story.fixes[:, 0], [story.end_s]])
    gaps = np.flatnonzero(np.diff(edges) > _OUTAGE_S)
    return [(float(edges[index]), float(edges[index + 1])) for index in gaps]


class _Panel:
    """One pair of axes on the picture; what lies outside is cut off."""

    def __init__(
        self,
        picture: NDArray[np.uint8],
        rows: tuple[int, int],
        x: tuple[float, float],
        y: tuple[float, float],
        label: str,
    ) -> None:
        self._view = picture[rows[0] : rows[1], _LEFT : _WIDTH - _RIGHT]
        self._picture, self._rows, self._label = picture, rows, label
        self._x, self._y = (x[0], max(x[1], x[0] + 1e-3)), (y[0], max(y[1], y[0] + 1e-6))

    def frame(self) -> None:
        """Grid, numbers and label."""
        height, width = self._view.shape[:2]
        for value in _ticks(*self._x):
            column = self._place(np.array([[value, self._y[0]]]))[0, 0] >> _SHIFT
            cv2.line(self._view, (column, 0), (column, height), _GRID, 1)
            _text(self._picture, f"{value:g}", (_LEFT + column - 12, self._rows[1] + 22), 0.45)
        for value in _ticks(*self._y):
            row = self._place(np.array([[self._x[0], value]]))[0, 1] >> _SHIFT
            cv2.line(self._view, (0, row), (width, row), _GRID, 1)
            _text(self._picture, f"{value:8g}", (_LEFT - 84, self._rows[0] + row + 5), 0.45)
        cv2.rectangle(self._view, (0, 0), (width - 1, height - 1), _INK, 1)
        _text(self._picture, self._label, (_LEFT + 8, self._rows[0] + 20), 0.5)

    def shade(self, begin: float, end: float) -> None:
        left, right = (self._place(np.array([[at, 0.0]]))[0, 0] >> _SHIFT for at in (begin, end))
        self._view[:, max(left, 0) : right + 1] = _AWAY

    def fill(self, outline: Points) -> None:
        layer = self._view.copy()
        cv2.fillPoly(layer, [self._place(outline)], _BAND, cv2.LINE_AA, _SHIFT)
        self._view[:] = np.minimum(layer, self._view)  # the grid stays visible

    def line(self, points: Points) -> None:
        cv2.polylines(self._view, [self._place(points)], False, _LINE, 2, cv2.LINE_AA, _SHIFT)

    def dots(self, points: Points) -> None:
        for column, row in self._place(points):
            cv2.circle(self._view, (int(column), int(row)), 3 << _SHIFT, _FIX, -1, cv2.LINE_AA, _SHIFT)

    def mark(self, at: float) -> None:
        column = int(self._place(np.array([[at, 0.0]]))[0, 0] >> _SHIFT)
        cv2.line(self._view, (column, 0), (column, self._view.shape[0]), _STEP, 2)

    def _place(self, points: Points) -> NDArray[np.int32]:
        """In sixteenths of a pixel."""
        height, width = self._view.shape[:2]
        x = (points[:, 0] - self._x[0]) / (self._x[1] - self._x[0]) * (width - 1)
        y = (self._y[1] - points[:, 1]) / (self._y[1] - self._y[0]) * (height - 1)
        placed = np.clip(np.c_[x, y], -4 * _WIDTH, 4 * _WIDTH) * (1 << _SHIFT)
        return np.asarray(placed.round(), np.int32)


_SHIFT = 4


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers, five to ten of them."""
    rough = (high - low) / 8
    power = 10 ** np.floor(np.log10(rough))
    step = power * min((1, 2, 5, 10), key=lambda factor: abs(factor * power - rough))
    first = int(np.ceil(low / step))
    return [float(round(index * step, 9)) for index in range(first, int(high / step) + 1)]


def _legend(picture: NDArray[np.uint8]) -> None:
    entries = (
        (_LINE, "UTC"), (_BAND, "95 %"), (_FIX, "fixes"), (_AWAY, "no fix"), (_STEP, "wall clock set")
    )  # fmt: skip
    column = _WIDTH - 560
    for colour, name in entries:
        cv2.rectangle(picture, (column, 54), (column + 18, 70), colour, -1)
        cv2.rectangle(picture, (column, 54), (column + 18, 70), _GRID, 1)
        _text(picture, name, (column + 26, 68), 0.5)
        column += 56 + 9 * len(name)


def _text(picture: NDArray[np.uint8], text: str, at: tuple[int, int], size: float) -> None:
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, _INK, 1, cv2.LINE_AA)
