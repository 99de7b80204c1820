"""One unbroken count of a camera's frames across reconnections."""

from dataclasses import replace

from recorder.samples import Frame, Loss, LossCause


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
        self._period_ns: int | None = None
        self._away: str | None = None

    def reopened(self, reason: str) -> None:
        """The next sample comes from a new connection, whose ids start at 0 again."""
        if self._next:
            self._away = reason

    def place(self, sample: Frame | Loss) -> list[Frame | Loss]:
        """The sample with its id in the unbroken count, after a `Loss` for the time away."""
        placed: list[Frame | Loss] = []
        if self._away is not None:
            raw_ns = sample.stamp.raw_ns if isinstance(sample, Frame) else sample.first_raw_ns
            stream = sample.topic if isinstance(sample, Frame) else sample.stream
            loss = self._lost_while_away(stream, raw_ns)
            placed += [loss] if loss else []
            self._base, self._away = self._next, None
        if isinstance(sample, Frame):
            sample = replace(sample, id=self._base + sample.id)
            self._learn(sample)
            self._next = sample.id + 1
        else:
            sample = replace(
                sample, first_id=self._base + sample.first_id, last_id=self._base + sample.last_id
            )
            self._next = sample.last_id + 1
        return [*placed, sample]

    def ended(self, stream: str, raw_ns: int) -> Loss | None:
        """What the camera would have taken until now, if it is away when the recording ends."""
        return self._lost_while_away(stream, raw_ns) if self._away is not None else None

    def _lost_while_away(self, stream: str, raw_ns: int | None) -> Loss | None:
        if raw_ns is None or self._last_raw_ns is None or not self._period_ns:
            return None
        missed = round((raw_ns - self._last_raw_ns) / self._period_ns) - 1
        if missed < 1:
            return None
        first, self._next = self._next, self._next + missed
        return Loss(
            stream=stream,
            first_id=first,
            last_id=first + missed - 1,
            first_raw_ns=self._last_raw_ns,
            last_raw_ns=raw_ns,
            cause=LossCause.DEVICE,
            detail=f"{self._away} (count from the time away)",
        )

    def _learn(self, frame: Frame) -> None:
        raw_ns = frame.stamp.raw_ns
        if raw_ns is None:
            return
        if self._last_raw_ns is not None and frame.id == self._next:
            period_ns = raw_ns - self._last_raw_ns
            # slow average: arrival jitters by milliseconds
            self._period_ns = (
                period_ns
                if self._period_ns is None
                else self._period_ns + (period_ns - self._period_ns) // 16
            )
        self._last_raw_ns = raw_ns
