"""How a camera's frames come: when each was exposed, which were late, which the camera left out."""

from dataclasses import replace
from typing import Any

from recorder.config import CameraSection
from recorder.samples import Frame, Stamp
from recorder.timebase import CameraClock, CameraClockSettings


class CameraTiming:
    """One camera's clock and what it counts; the camera's thread calls, any thread may look."""

    def __init__(self, camera: CameraSection | None = None) -> None:
        self._clock = CameraClock(CameraClockSettings.of(camera) if camera else CameraClockSettings())
        self.late = 0
        """Frames that came more than half a period later than the quickest do; nothing is missing."""
        self.skipped = 0
        """Images that the camera itself left out, by its ticks; its ids do not count them."""
        self._clocks = 0
        self._latency_ns = self._sigma_ns = 0
        self._told = (0, 0)

    @property
    def restarts(self) -> int:
        """How often its clock was taken for a new one after the first time."""
        return max(0, self._clocks - 1)

    def stamped(self, frame: Frame, stamp: Stamp) -> Stamp:
        """``stamp``, whose ``raw_ns`` is known, with the middle of the exposure."""
        assert stamp.raw_ns is not None
        settings = frame.settings
        exposure_ns = None if settings.exposure_us is None else round(settings.exposure_us * 1000)
        period_ns = round(1e9 / settings.rate_hz) if settings.rate_hz else None
        told = self._clock.observe(frame.id, stamp.device_ns, stamp.raw_ns, exposure_ns, period_ns)
        self.late += bool(period_ns and 2 * told.latency_ns > period_ns)
        self.skipped += told.skipped
        self._clocks += told.restarted
        self._latency_ns, self._sigma_ns = told.latency_ns, told.sigma_ns
        return replace(stamp, exposure_raw_ns=told.raw_ns, exposure_sigma_ns=told.sigma_ns)

    def news(self) -> str:
        """What there is to tell since the last call; empty if nothing."""
        now = self.skipped, self.restarts
        skipped, restarts = (new - old for new, old in zip(now, self._told, strict=True))
        self._told = now
        parts = [f"{skipped} images left out by the camera itself"] if skipped else []
        parts += ["its clock began anew"] if restarts else []
        return ", ".join(parts)

    def status(self) -> dict[str, Any]:
        """For ``recorder status``."""
        return {
            "late": self.late,
            "skipped": self.skipped,
            "clock_restarts": self.restarts,
            "latency_ns": self._latency_ns,
            "exposure_sigma_ns": self._sigma_ns,
        }
