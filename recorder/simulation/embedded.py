"""A camera that lives in this process: a loop of frames at its true rate, for a demo without Aravis."""

import time
from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from recorder.clock import SYSTEM_CLOCK, Clock
from recorder.samples import CameraSettings, Frame, Loss, LossCause, Sample, Stamp, image_topic

STEP_NS = 200_000_000
"""No wait is longer, so that the caller can look at its stop event."""


class EmbeddedCamera:
    """A live `Driver` that exposes by the clock, whether anybody takes the frames or not.

    Frame n is exposed n periods after the first, counted from one start, so the rate does not
    drift. A consumer that is late finds the frames in ``buffers``, as behind a real camera; the
    oldest that found no buffer are stated as a `Loss` with the cause TRANSPORT. ``device_ns``
    is the camera's own counter, which starts at 0 with the first frame; ``raw_ns`` is the
    delivery.

    Args:
        frames: (N, H, W) uint16, played over and over.
        buffers: how many frames wait for a late consumer; at least 1.
        sleep: waits so many seconds.

    Raises `ValueError` on frames of another shape or type, and on a rate or number of buffers
    that is not positive.
    """

    live = True

    def __init__(
        self,
        name: str,
        frames: NDArray[np.uint16],
        *,
        rate_hz: float = 59.82,
        bit_depth: int = 10,
        buffers: int = 16,
        clock: Clock = SYSTEM_CLOCK,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if frames.ndim != 3 or not frames.size or frames.dtype != np.uint16:
            raise ValueError(f"frames must be (N, H, W) uint16, not {frames.dtype} {frames.shape}")
        if rate_hz <= 0 or buffers < 1:
            raise ValueError("rate_hz and buffers must be positive")
        self.name = name
        self._frames = frames.view()
        self._frames.flags.writeable = False
        # The decimal digits that the caller wrote, not the binary fraction behind them.
        self._rate = Fraction(repr(rate_hz))
        self._bit_depth = bit_depth
        self._buffers = buffers
        self._clock = clock
        self._sleep = sleep
        self._settings = CameraSettings(pixel_format=f"Mono{bit_depth}", rate_hz=rate_hz)

    def open(self) -> None:
        """Nothing to find: it is here."""

    def samples(self) -> Iterator[Sample | None]:
        """Frames without end; generated from the moment that the first is asked for."""
        start_ns = self._clock.raw_ns()
        frame_id = 0
        while True:
            due_ns = start_ns + self._since_start_ns(frame_id)
            now_ns = self._clock.raw_ns()
            if now_ns < due_ns:
                self._sleep(min(due_ns - now_ns, STEP_NS) / 1e9)
                if due_ns - now_ns > STEP_NS:
                    yield None
                continue
            oldest = self._exposed(now_ns - start_ns) - self._buffers
            if oldest > frame_id:
                yield self._loss(frame_id, oldest - 1, start_ns)
                frame_id = oldest
            yield self._frame(frame_id)
            frame_id += 1

    def describe(self) -> Mapping[str, str]:
        _, height, width = self._frames.shape
        return {
            "vendor": "recorder",
            "model": "embedded camera",
            "serial": self.name,
            "size": f"{width}x{height}",
            "rate_hz": str(float(self._rate)),
        }

    def close(self) -> None:
        """Nothing to let go of."""

    def _since_start_ns(self, frame_id: int) -> int:
        # Rounded up, so that a frame that is due counts as exposed.
        return -(-frame_id * 1_000_000_000 * self._rate.denominator // self._rate.numerator)

    def _exposed(self, elapsed_ns: int) -> int:
        """How many frames the camera has exposed so long after the first."""
        return int(elapsed_ns * self._rate / 1_000_000_000) + 1

    def _frame(self, frame_id: int) -> Frame:
        pixels = self._frames[frame_id % len(self._frames)]
        stamp = Stamp(raw_ns=self._clock.raw_ns(), device_ns=self._since_start_ns(frame_id))
        return Frame(self.name, frame_id, stamp, pixels, self._bit_depth, self._settings)

    def _loss(self, first: int, last: int, start_ns: int) -> Loss:
        return Loss(
            image_topic(self.name),
            first,
            last,
            start_ns + self._since_start_ns(first),
            start_ns + self._since_start_ns(last),
            LossCause.TRANSPORT,
            "taken too late",
        )
