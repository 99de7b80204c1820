"""A recording: everything built from one configuration, started, watched and closed."""

import logging
import os
import shutil
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from recorder.clock import SYSTEM_CLOCK, Clock
from recorder.config import Settings
from recorder.drivers.base import Driver
from recorder.errors import RecorderError, SourceError
from recorder.samples import DeviceState, Health, LogLine, Sample
from recorder.service.build import is_receiver
from recorder.service.clock_pairs import ClockPairs
from recorder.service.housekeeping import Chore, Housekeeping
from recorder.service.notify import notify, watchdog_period_s
from recorder.service.pipeline import Pipeline
from recorder.service.supervisor import Supervisor
from recorder.service.versions import versions
from recorder.storage import DriveHead, DriveWriter
from recorder.timebase import ClockWatch, Timebase, clock_watch, wall_clock_error_ns

_log = logging.getLogger("recorder")
_log.addHandler(logging.NullHandler())  # who wants to see the events says so (`recorder run` does)

_HEALTH_PERIOD_S = 10.0
_STATE_LOSSES_S = 1.0
"""A loss that is still going on is put into the drive as often."""
_DISK_FIGURES_S = 2.0
_DISK_STUCK_NS = 10_000_000_000
"""The watchdog is not fed if nothing was forced to disk for so long."""
_LATELY_NS = 10_000_000_000
"""Samples lost within this are told as a problem."""
_TRUSTED_WALL_CLOCK_NS = 1_000_000_000
"""A drive is named after the wall clock only if the kernel states an error below this."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a recording came to."""

    drive: Path
    seconds: float
    messages: dict[str, int]
    """Written, by topic."""
    lost: dict[str, int]
    """Lost, by topic."""
    failures: list[RecorderError] = field(default_factory=list)


class Recording:
    """Devices to disk, from `start` to `close`.

    ``one_shot``: every device must open, or nothing is recorded; one that fails later ends,
    the others go on; the recording is `finished` when all have ended. Otherwise (the service)
    it starts with what there is and devices are tried again for ever.
    """

    def __init__(
        self,
        settings: Settings,
        drivers: Sequence[Driver],
        *,
        one_shot: bool,
        clock: Clock = SYSTEM_CLOCK,
        watch: ClockWatch | None = None,
    ) -> None:
        gnss = settings.drivers.gnss
        if gnss is not None and not is_receiver(gnss.source):
            settings = settings.model_copy(update={"timebase": settings.timebase.believing_every_date})
        self._settings = settings
        self._one_shot = one_shot
        self._clock = clock
        self._timebase = Timebase(settings.timebase, clock)
        self._stop, self._go = threading.Event(), threading.Event()
        self._pipeline: Pipeline | None = None
        self._writer: DriveWriter | None = None
        self._devices = [
            Supervisor(
                driver,
                take=self._take,
                tell=self._tell,
                settings=settings.service,
                retry=not one_shot,
                stop=self._stop,
                go=self._go,
                clock=clock,
            )
            for driver in drivers
        ]
        self._housekeeping = Housekeeping(self._chores(), clock=clock)
        # a thread of its own: asking a dead disk for its free space may never return
        self._disk_watch = Housekeeping(
            [Chore("disk", _DISK_FIGURES_S, self._look_at_disk)], clock=clock, name="disk"
        )
        self._watch = watch
        self._clock_pairs: ClockPairs | None = None
        self._disk: dict[str, Any] = {}
        self._started_raw_ns = clock.raw_ns()

    def start(self, stop: threading.Event | None = None) -> Path:
        """Begin; returns the drive's path. Raises the first error if it cannot, leaving nothing behind.

        ``stop`` set meanwhile ends the wait for devices that take long to open.
        """
        try:
            if self._one_shot:
                self._open_all(stop or threading.Event())
            writer = DriveWriter(self._settings.storage, self._head(), clock=self._clock)
        except BaseException:
            self._stop_devices()
            raise
        self._writer = writer
        self._pipeline = Pipeline(self._settings, self._timebase, writer, clock=self._clock)
        self._pipeline.start()
        self._clock_pairs = ClockPairs(
            self._timebase,
            self._pipeline.put,
            self._settings.timebase.pair_seconds,
            clock=self._clock,
            watch=self._watch or clock_watch(),
        )
        self._clock_pairs.start()
        self._housekeeping.start()
        self._disk_watch.start()
        if self._one_shot:
            for device in self._devices:
                self._tell(device.now())
        else:
            for device in self._devices:
                device.start()
        self._go.set()
        notify("READY=1")
        return writer.path

    @property
    def finished(self) -> bool:
        """True when there is nothing more to record: all devices have ended, or the disk has failed."""
        failed = self._pipeline is not None and self._pipeline.failed.is_set()
        return failed or all(device.finished.is_set() for device in self._devices)

    def wait(self, stop: threading.Event, tick: Callable[[], None] | None = None) -> None:
        """Return when `finished` or when ``stop`` is set; call ``tick`` meanwhile."""
        while not self.finished and not stop.wait(0.1):
            if tick:
                tick()

    def close(self) -> Outcome:
        """End all devices, write what is queued, close the drive."""
        assert self._pipeline is not None
        assert self._writer is not None
        notify("STOPPING=1")
        stopped_raw_ns = self._clock.raw_ns()
        self._stop_devices()
        if self._clock_pairs is not None:
            self._clock_pairs.close()
        self._housekeeping.close()
        self._disk_watch.close(timeout_s=0.5)
        for device in self._devices:
            device.state_absence(stopped_raw_ns)
            self._pipeline.put(device.now())
        self._pipeline.close()
        failures = [device.failure for device in self._devices if device.failure is not None]
        if self._pipeline.failure is not None:
            failures.append(self._pipeline.failure)
        return Outcome(
            drive=self._writer.path,
            seconds=(self._clock.raw_ns() - self._started_raw_ns) / 1e9,
            messages=dict(self._writer.counts),
            lost=self._pipeline.lost,
            failures=failures,
        )

    @property
    def frames(self) -> int:
        """Frames on their way to disk so far."""
        return sum(self._pipeline.frames.values()) if self._pipeline else 0

    def status(self) -> dict[str, Any]:
        """The state of everything, as the status socket tells it; waits for nothing."""
        writer, pipeline = self._writer, self._pipeline
        devices = {
            device.driver.name: {
                "state": health.state,
                "reason": health.reason,
                "samples": health.samples,
                "lost": health.lost,
                **device.description,
            }
            for device in self._devices
            for health in (device.now(),)
        }
        problems = [
            f"{name}: {device['state']}" + (f", {device['reason']}" if device["reason"] else "")
            for name, device in devices.items()
            if device["state"] not in (DeviceState.STREAMING, DeviceState.ENDED)
        ]
        problems += self._recording_problems()
        return {
            "healthy": not problems,
            "problems": problems,
            "recording": writer is not None and pipeline is not None and not pipeline.failed.is_set(),
            "drive": str(writer.path) if writer else None,
            "durable_raw_ns": writer.durable_raw_ns if writer else None,
            "devices": devices,
            "frames": dict(pipeline.frames) if pipeline else {},
            "lost": dict(pipeline.lost) if pipeline else {},
            "timing": {name: timing.status() for name, timing in pipeline.timing.items()} if pipeline else {},
            "time": {"raw_ns": self._clock.raw_ns(), **self._timebase.status()},
            "disk": {**self._disk, "queue_bytes": pipeline.queue_bytes if pipeline else 0},
            "processes": {"recorder": _process()},
        }

    def _chores(self) -> list[Chore]:
        """What runs when."""
        return [
            Chore("losses", _STATE_LOSSES_S, self._state_losses),
            Chore("health", _HEALTH_PERIOD_S, self._record_health),
            Chore("watchdog", watchdog_period_s() or 60.0, self._feed_watchdog),
        ]

    def _recording_problems(self) -> list[str]:
        pipeline = self._pipeline
        if pipeline is None:
            return []
        now_ns = self._clock.raw_ns()
        problems = [str(pipeline.failure)] if pipeline.failure is not None else []
        if pipeline.lost_raw_ns is not None and now_ns - pipeline.lost_raw_ns < _LATELY_NS:
            lost = ", ".join(f"{topic} {count}" for topic, count in pipeline.lost.items())
            problems.append(f"samples are being lost: {lost}")
        stuck_s = (now_ns - pipeline.synced_raw_ns) / 1e9
        if stuck_s * 1e9 > _DISK_STUCK_NS:
            problems.append(f"nothing was forced to disk for {stuck_s:.0f} s")
        return problems

    def _open_all(self, stop: threading.Event) -> None:
        for device in self._devices:
            device.start()
        for device in self._devices:
            while not device.ready.wait(0.1):
                if stop.is_set():
                    raise RecorderError("stopped before it was open", where=device.driver.name)
        for device in self._devices:
            error = device.failure
            if error is not None:  # naming a source that cannot be opened is bad input
                raise SourceError(error.what, where=error.where, todo=error.todo) from error

    def _stop_devices(self) -> None:
        self._stop.set()
        for device in self._devices:
            device.join()

    def _head(self) -> DriveHead:
        error_ns = wall_clock_error_ns()
        trusted = error_ns is not None and error_ns < _TRUSTED_WALL_CLOCK_NS
        return DriveHead(
            config_json=self._settings.to_json(),
            versions=versions(),
            devices={device.driver.name: device.description for device in self._devices},
            log_offset_ns=self._timebase.log_offset_ns,
            start_raw_ns=self._clock.raw_ns(),
            utc_ns=self._clock.realtime_ns() if trusted else None,
        )

    def _take(self, sample: Sample, live: bool) -> bool:
        assert self._pipeline is not None
        if isinstance(sample, LogLine):
            _log.log(
                logging.getLevelNamesMapping()[sample.level.upper()], "%s %s", sample.name, sample.message
            )
            self._note_devices()
        return self._pipeline.take(sample, live=live)

    def _tell(self, health: Health) -> None:
        level = logging.WARNING if health.reason else logging.INFO
        text = f"{health.state}: {health.reason}" if health.reason else str(health.state)
        if self._pipeline is not None:
            self._pipeline.put(health)
            name = logging.getLevelName(level).lower()
            self._pipeline.put(LogLine(health.raw_ns, name, health.device, text))
            if health.state is DeviceState.STREAMING and not self._one_shot:
                self._note_devices()
        _log.log(level, "%s %s", health.device, text)

    def _note_devices(self) -> None:
        """What a device says of itself is known once it streams: have the drive say so."""
        if self._pipeline is not None:
            devices = {device.driver.name: device.description for device in self._devices}
            self._pipeline.call(lambda: self._writer.set_devices(devices) if self._writer else None)

    def _state_losses(self) -> None:
        if self._pipeline is not None:
            self._pipeline.state_refused()

    def _record_health(self) -> None:
        if self._pipeline is not None:
            for device in self._devices:
                self._pipeline.put(device.now())
            self._tell_of_timing(self._pipeline)

    def _tell_of_timing(self, pipeline: Pipeline) -> None:
        """What the cameras' clocks noticed since the last time."""
        for name, timing in pipeline.timing.items():
            news = timing.news()
            if news:
                pipeline.put(LogLine(self._clock.raw_ns(), "warning", name, news))
                _log.warning("%s: %s", name, news)

    def _feed_watchdog(self) -> None:
        pipeline = self._pipeline
        if pipeline is None or pipeline.failed.is_set():
            return
        if self._clock.raw_ns() - pipeline.synced_raw_ns < _DISK_STUCK_NS:
            notify("WATCHDOG=1")

    def _look_at_disk(self) -> None:
        if self._writer is None:
            return
        try:
            usage = shutil.disk_usage(self._writer.path)
        except OSError as error:
            self._disk = {"problem": f"{self._writer.path}: {error.strerror}"}
            return
        self._disk = {"free_bytes": usage.free, "total_bytes": usage.total, "raw_ns": self._clock.raw_ns()}


def _process() -> dict[str, Any]:
    process = psutil.Process()
    return {
        "pid": os.getpid(),
        "rss_bytes": process.memory_info().rss,
        "cpu_s": time.process_time(),
        "threads": process.num_threads(),
    }
