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
from recorder.service.housekeeping import Chore, Housekeeping
from recorder.service.notify import notify, watchdog_period_s
from recorder.service.pipeline import Pipeline
from recorder.service.supervisor import Policy, Supervisor
from recorder.service.versions import versions
from recorder.storage import DriveHead, DriveWriter
from recorder.timebase import Timebase, wall_clock_error_ns

_log = logging.getLogger("recorder")
_log.addHandler(logging.NullHandler())  # who wants to see the events says so (`recorder run` does)

_HEALTH_PERIOD_S = 10.0
_DISK_STUCK_NS = 10_000_000_000
"""The watchdog is not fed if nothing has become durable for so long."""
_TRUSTED_WALL_CLOCK_NS = 1_000_000_000
"""A drive is named after the wall clock only if the kernel states an error below this."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a recording came to."""

    drive: Path
    seconds: float
    frames: dict[str, int]
    lost: dict[str, int]
    failures: list[RecorderError] = field(default_factory=list)


class Recording:
    """Devices to disk, from `start` to `close`.

    ``one_shot``: every device must open, or nothing is recorded; one that fails later ends,
    the others go on; the recording is `finished` when all have ended. Otherwise (the service)
    it starts with what there is and devices are tried again for ever.

    ``on_started`` gets the drive's path once, when the drive exists.
    """

    def __init__(
        self, settings: Settings, drivers: Sequence[Driver], *, one_shot: bool, clock: Clock = SYSTEM_CLOCK
    ) -> None:
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
                policy=Policy(retry=not one_shot),
                stop=self._stop,
                go=self._go,
                clock=clock,
            )
            for driver in drivers
        ]
        self._housekeeping = Housekeeping(self._chores(), clock=clock)
        self._started_raw_ns = clock.raw_ns()

    def start(self) -> Path:
        """Begin; returns the drive's path. Raises the first error if it cannot, leaving nothing behind."""
        try:
            if self._one_shot:
                self._open_all()
            writer = DriveWriter(self._settings.storage, self._head(), clock=self._clock)
        except BaseException:
            self._stop_devices()
            raise
        self._writer = writer
        self._pipeline = Pipeline(self._settings, self._timebase, writer, clock=self._clock)
        self._pipeline.start()
        self._housekeeping.start()
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
        self._stop_devices()
        self._housekeeping.close()
        for device in self._devices:
            self._pipeline.put(device.now())
        self._pipeline.close()
        failures = [device.failure for device in self._devices if device.failure is not None]
        if self._pipeline.failure is not None:
            failures.append(self._pipeline.failure)
        return Outcome(
            drive=self._writer.path,
            seconds=(self._clock.raw_ns() - self._started_raw_ns) / 1e9,
            frames=dict(self._pipeline.frames),
            lost=dict(self._pipeline.lost),
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
        if pipeline is not None and pipeline.failure is not None:
            problems.append(str(pipeline.failure))
        return {
            "healthy": not problems,
            "problems": problems,
            "recording": writer is not None and pipeline is not None and not pipeline.failed.is_set(),
            "drive": str(writer.path) if writer else None,
            "durable_raw_ns": writer.durable_raw_ns if writer else None,
            "devices": devices,
            "frames": dict(pipeline.frames) if pipeline else {},
            "lost": dict(pipeline.lost) if pipeline else {},
            "time": {"raw_ns": self._clock.raw_ns(), **self._timebase.status()},
            "disk": self._disk(),
            "processes": {"recorder": _process()},
        }

    def _chores(self) -> list[Chore]:
        """What runs when."""
        return [
            Chore("clock pair", self._settings.timebase.pair_seconds, self._record_clock_pair),
            Chore("health", _HEALTH_PERIOD_S, self._record_health),
            Chore("watchdog", watchdog_period_s() or 60.0, self._feed_watchdog),
        ]

    def _open_all(self) -> None:
        for device in self._devices:
            device.start()
        for device in self._devices:
            device.ready.wait()
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

    def _take(self, sample: Sample, live: bool) -> None:
        assert self._pipeline is not None
        self._pipeline.take(sample, live=live)

    def _tell(self, health: Health) -> None:
        level = logging.WARNING if health.reason else logging.INFO
        text = f"{health.state}: {health.reason}" if health.reason else str(health.state)
        _log.log(level, "%s %s", health.device, text)
        if self._pipeline is None:
            return
        self._pipeline.put(health)
        self._pipeline.put(LogLine(health.raw_ns, logging.getLevelName(level).lower(), health.device, text))
        if health.state is DeviceState.STREAMING and not self._one_shot:
            devices = {device.driver.name: device.description for device in self._devices}
            self._pipeline.call(lambda: self._writer.set_devices(devices) if self._writer else None)

    def _record_clock_pair(self) -> None:
        if self._pipeline is not None:
            self._pipeline.put(self._timebase.sample_pair())

    def _record_health(self) -> None:
        if self._pipeline is not None:
            for device in self._devices:
                self._pipeline.put(device.now())

    def _feed_watchdog(self) -> None:
        if self._writer is None or self._pipeline is None or self._pipeline.failed.is_set():
            return
        if self._clock.raw_ns() - self._writer.durable_raw_ns < _DISK_STUCK_NS:
            notify("WATCHDOG=1")

    def _disk(self) -> dict[str, Any]:
        usage = shutil.disk_usage(self._writer.path if self._writer else Path.cwd())
        return {"free_bytes": usage.free, "total_bytes": usage.total, "queue_bytes": self._queue_bytes()}

    def _queue_bytes(self) -> int:
        return self._pipeline.queue_bytes if self._pipeline else 0


def _process() -> dict[str, Any]:
    process = psutil.Process()
    return {
        "pid": os.getpid(),
        "rss_bytes": process.memory_info().rss,
        "cpu_s": time.process_time(),
        "threads": process.num_threads(),
    }
