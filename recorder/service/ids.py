"""One unbroken count of a camera's frames across reconnections and silences."""

from collections import deque
from dataclasses import replace
from statistics import median_low

from recorder.samples import Frame, Loss, LossCause

_PERIODS = 31
"""Frame periods remembered; their median is the camera's, whatever single arrivals do."""

_QUIET_NS = 500_000_000
"""A camera is away at the end of a recording if its last frame is older than this and than two periods."""


class FrameCount:
    """Continues a camera's frame ids where the last connection left off.

    A driver counts from 0 after each opening. What was not taken in between has no ids of its
    own, so ids are left out for it, as many as the time away over the frame period, and stated
    as one `Loss`: ids without a sample and the ledger stay exactly equal.
    """

    def __init__(self) -> None:
        self._base = 0
        self._next = 0
        self._last_raw_ns: int | None = None
        self._followed = False
        """The last sample was a frame of this connection: the next one tells a period."""
        self._periods: deque[int] = deque(maxlen=_PERIODS)
        self._nominal_ns: int | None = None
        self._untimed = 0
        """Ids stated without a time since the last one that had one."""
        self._away: str | None = None
        self._again = False

    def reopened(self, reason: str) -> None:
        """The connection failed; the ids of the next one start at 0 again."""
        if self._next:
            self._away = self._away or reason
            self._again = True
        self._followed = False

    def place(self, sample: Frame | Loss) -> list[Frame | Loss]:
        """The sample with its id in the unbroken count, after a `Loss` for the time away."""
        placed: list[Frame | Loss] = []
        raw_ns = sample.stamp.raw_ns if isinstance(sample, Frame) else sample.first_raw_ns
        if self._away is not None and raw_ns is not None:
            stream = sample.topic if isinstance(sample, Frame) else sample.stream
            missed = self._missed(raw_ns)
            if missed:
                placed.append(self._lost(stream, missed, raw_ns, self._away))
                self._base += missed
            self._away = None
        if self._again:
            self._base, self._again = self._next, False
        if isinstance(sample, Frame):
            sample = replace(sample, id=self._base + sample.id)
            self._learn(sample)
            self._next = sample.id + 1
        else:
            first, last = self._base + sample.first_id, self._base + sample.last_id
            sample = replace(sample, first_id=first, last_id=last)
            self._next = last + 1
            if sample.last_raw_ns is None:
                self._untimed += sample.count
            else:
                self._last_raw_ns = max(self._last_raw_ns or 0, sample.last_raw_ns)
                self._untimed = 0
            self._followed = False
        return [*placed, sample]

    def ended(self, stream: str, raw_ns: int, reason: str) -> Loss | None:
        """What the camera would have taken until the recording ended, if it was away by then."""
        if self._last_raw_ns is None:
            return None
        quiet_ns = raw_ns - self._last_raw_ns
        if self._away is None and quiet_ns < max(_QUIET_NS, 2 * (self._period_ns or 0)):
            return None
        missed = self._missed(raw_ns)
        return self._lost(stream, missed, raw_ns, self._away or reason) if missed else None

    @property
    def _period_ns(self) -> int | None:
        return median_low(self._periods) if self._periods else self._nominal_ns

    def _missed(self, raw_ns: int) -> int:
        """Frames between the last one and one at ``raw_ns``; at least one if nobody knows the rate."""
        if self._last_raw_ns is None:
            return 0
        period_ns = self._period_ns
        away_ns = raw_ns - self._last_raw_ns
        return max(0, (away_ns + period_ns // 2) // period_ns - 1 - self._untimed) if period_ns else 1

    def _lost(self, stream: str, missed: int, raw_ns: int, reason: str) -> Loss:
        how = "count from the time away" if self._period_ns else "how many is not known"
        first, self._next = self._next, self._next + missed
        return Loss(
            stream=stream,
            first_id=first,
            last_id=first + missed - 1,
            first_raw_ns=self._last_raw_ns,
            last_raw_ns=raw_ns,
            cause=LossCause.DEVICE,
            detail=f"{reason} ({how})",
        )

    def _learn(self, frame: Frame) -> None:
        raw_ns = frame.stamp.raw_ns
        if frame.settings.rate_hz:
            self._nominal_ns = max(1, round(1e9 / frame.settings.rate_hz))
        if raw_ns is None:
            return
        if self._followed and self._last_raw_ns is not None and raw_ns > self._last_raw_ns:
            self._periods.append(raw_ns - self._last_raw_ns)
        self._followed = True
        self._last_raw_ns = raw_ns
        self._untimed = 0
