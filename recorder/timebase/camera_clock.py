"""When a frame was exposed: the camera's ticks and frame ids against raw time."""

from collections import deque
from dataclasses import dataclass
from math import isqrt
from statistics import median_low

from recorder.config import CameraSection
from recorder.timebase.tracker import SECOND_NS, Tracker

_CRYSTAL_PPT = 100_000_000
"""100 ppm: what a camera's oscillator and this machine's may run apart."""
_RATE_PPT = 20_000_000_000
"""2 %: what a frame rate that a camera states or that a few frames tell may be off."""
_GAP_NS = 2 * SECOND_NS
"""After so long without a frame the next ones need not fall into the old rhythm."""
_UNKNOWN_DELAY_NS = SECOND_NS // 100
_PERIODS = 15
"""Frame periods whose median is the camera's."""


@dataclass(frozen=True, slots=True)
class CameraClockSettings:
    """What is known of a camera's stamps."""

    event: str = "exposure_end"
    """What its own stamp tells: exposure_start, exposure_middle, exposure_end (start of readout in free
    run) or transfer_end."""
    transfer_ns: int = 0
    """From the end of the exposure to the earliest arrival."""
    transfer_sigma_ns: int = 0
    """One standard deviation of that."""
    wrap_ns: int | None = None
    """Its counter begins anew there; None if it does not."""

    @classmethod
    def of(cls, camera: CameraSection) -> "CameraClockSettings":
        """From a camera's section. The times of a file are the frames' own."""
        if camera.is_file:
            return cls(event="exposure_middle")
        wrap_ns = None if camera.stamp_wrap_s is None else round(camera.stamp_wrap_s * 1e9)
        transfer_ns, sigma_ns = camera.transfer_us * 1000, camera.transfer_sigma_us * 1000
        return cls(camera.stamp_event, transfer_ns, sigma_ns, wrap_ns)


@dataclass(frozen=True, slots=True)
class Exposure:
    """When one frame was exposed."""

    raw_ns: int
    """Raw time of the middle of the exposure."""
    sigma_ns: int
    latency_ns: int
    """What the frame took longer to get here than the quickest ones."""
    skipped: int
    """Images before it that the camera did not take, or did not count: by its ticks they are missing, by
    its ids they are not."""
    restarted: bool
    """The camera's clock was taken for a new one from this frame on."""


class CameraClock:
    """One camera's clock against raw time, by the lower envelope of the arrivals.

    A frame's arrival is its end of exposure plus a least time for readout and transfer
    (``transfer_ns``) plus a delay that varies (USB, network, scheduling) and is never negative. Ticks
    and arrivals together therefore give the camera's offset and drift without that delay. Without ticks,
    or where the ticks are the end of the transfer and bear its jitter, the ids times the frame period
    stand for exact ticks, as long as the camera runs freely.

    Cheap (some microseconds a frame) and bounded in memory. Not thread-safe.

    Args:
        backwards: frames are given from the last to the first, to solve them by what came after.
    """

    def __init__(self, settings: CameraClockSettings, *, backwards: bool = False) -> None:
        self._settings = settings
        self._direction = -1 if backwards else 1
        self._ticks = Tracker(drift_sigma_ppt=_CRYSTAL_PPT, keeps_drift=True)
        self._comb = _Comb(self._direction)
        self._wraps_ns = 0
        self._last: tuple[int, int, int] | None = None
        """Id, ticks and arrival of the last frame that had ticks."""
        self._periods: deque[int] = deque(maxlen=_PERIODS)
        self._next_ns = 0
        """No exposure is before the last one."""

    def observe(
        self,
        id: int,
        ticks_ns: int | None,
        arrival_ns: int,
        exposure_ns: int | None = None,
        period_ns: int | None = None,
    ) -> Exposure:
        """Take a frame; when it was exposed.

        Args:
            id: counts all images, does not wrap.
            ticks_ns: the camera's own stamp, its origin unknown.
            arrival_ns: raw, of the first sign of the frame here; never before the end of its exposure.
            exposure_ns: how long it was exposed, if known; else its end is taken for its middle.
            period_ns: between two frames, as the camera states it.
        """
        settings = self._settings
        if ticks_ns is None:
            end_ns, sigma_ns, restarted = self._comb.follow(id, arrival_ns, period_ns)
            skipped, unknown_ns = 0, self._periods_sigma(exposure_ns, period_ns)
        else:
            ticks_ns = self._unwrapped(ticks_ns, arrival_ns)
            skipped = self._skipped(id, ticks_ns)
            event_ns = ticks_ns + self._to_end(exposure_ns)
            followed = self._ticks.follow(self._direction * event_ns, arrival_ns - event_ns)
            restarted, sigma_ns = followed.restarted, followed.sigma
            if settings.event == "transfer_end":
                event_ns, jitter_ns, _ = self._comb.follow(id, event_ns, period_ns)
                sigma_ns = isqrt(sigma_ns**2 + jitter_ns**2)
            end_ns = event_ns + followed.line
            unknown_ns = self._periods_sigma(exposure_ns, period_ns)
            self._last = id, ticks_ns, arrival_ns
        latency_ns = max(0, arrival_ns - end_ns)
        middle_ns = min(end_ns, arrival_ns)
        if settings.event != "exposure_middle":
            middle_ns -= settings.transfer_ns + (exposure_ns or 0) // 2
        if self._direction > 0:
            middle_ns = max(middle_ns, self._next_ns)
            self._next_ns = middle_ns + 1
        sigma_ns = isqrt(sigma_ns**2 + settings.transfer_sigma_ns**2 + unknown_ns**2)
        return Exposure(middle_ns, sigma_ns, latency_ns, skipped, restarted)

    def _to_end(self, exposure_ns: int | None) -> int:
        """From what the stamp tells to the end of the exposure (of the transfer): after it, what follows
        until the arrival does not depend on the exposure."""
        return (exposure_ns or 0) if self._settings.event == "exposure_start" else 0

    def _unwrapped(self, ticks_ns: int, arrival_ns: int) -> int:
        wrap_ns = self._settings.wrap_ns
        if wrap_ns is None or self._last is None:
            return ticks_ns + self._wraps_ns
        _, last_ns, last_arrival_ns = self._last
        expected_ns = last_ns + arrival_ns - last_arrival_ns
        self._wraps_ns = (expected_ns - ticks_ns + wrap_ns // 2) // wrap_ns * wrap_ns
        return ticks_ns + self._wraps_ns

    def _skipped(self, id: int, ticks_ns: int) -> int:
        if self._last is None:
            return 0
        last_id, last_ticks_ns, _ = self._last
        steps, elapsed_ns = id - last_id, ticks_ns - last_ticks_ns
        if steps <= 0 or elapsed_ns <= 0 or elapsed_ns > _GAP_NS * steps:
            return 0
        known = len(self._periods) == _PERIODS
        period_ns = median_low(self._periods) if known else 0
        self._periods.append(elapsed_ns // steps)
        return max(0, (elapsed_ns + period_ns // 2) // period_ns - steps) if period_ns else 0

    def _periods_sigma(self, exposure_ns: int | None, period_ns: int | None) -> int:
        """What not knowing the exposure costs: it is between nothing and the frame period."""
        if exposure_ns is not None or self._settings.event == "exposure_middle":
            return 0
        known_ns = period_ns or (median_low(self._periods) if self._periods else 0)
        return known_ns * 2 // 7  # half an exposure, uniform in [0, period / 2], about 0: period / sqrt(12)


class _Comb:
    """Frame ids times a period as a clock: for a camera that runs freely and has no exact ticks."""

    def __init__(self, direction: int) -> None:
        self._direction = direction
        self._tracker = Tracker(drift_sigma_ppt=_RATE_PPT, keeps_drift=False, gap_ns=_GAP_NS)
        self._period_ns: int | None = None
        self._first: deque[tuple[int, int]] = deque(maxlen=_PERIODS)

    def follow(self, id: int, time_ns: int, period_ns: int | None) -> tuple[int, int, bool]:
        """The time of a frame without its delay, one standard deviation, and whether the comb begins anew."""
        if self._period_ns is None:
            self._period_ns = self._learned(id, time_ns, period_ns)
        if self._period_ns is None:
            return time_ns, _UNKNOWN_DELAY_NS, len(self._first) == 1
        x = id * self._period_ns
        followed = self._tracker.follow(self._direction * x, time_ns - x)
        return x + followed.line, followed.sigma, followed.restarted

    def _learned(self, id: int, time_ns: int, stated_ns: int | None) -> int | None:
        """As the camera states it, or from some frames."""
        if stated_ns:
            return stated_ns
        self._first.append((id, time_ns))
        if len(self._first) < _PERIODS:
            return None
        (first_id, first_ns), (last_id, last_ns) = self._first[0], self._first[-1]
        steps, elapsed_ns = self._direction * (last_id - first_id), self._direction * (last_ns - first_ns)
        return elapsed_ns // steps if min(steps, elapsed_ns) > 0 else None
