"""One thread a device: opens it, takes its samples, and never gives up on it.

Reconnecting, back-off, counting and health are written here once, for all devices.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass

from recorder.clock import Clock
from recorder.config import ServiceSection
from recorder.drivers.base import Driver
from recorder.errors import RecorderError
from recorder.samples import DeviceState, Frame, Health, Loss, Sample
from recorder.service.ids import FrameCount


@dataclass(frozen=True, slots=True)
class Policy:
    """What is done when a device fails."""

    retry: bool
    """Try again for ever (the service), or stop and keep the error (a one-shot recording)."""


class Supervisor:
    """Runs one driver in its own thread until stopped, ended, or failed without retry.

    Args:
        driver: the device.
        take: called in this thread with each sample and whether the device is live.
        tell: called with a `Health` at every change of state.
        stop: ends the thread within a driver's poll period (0.2 s).
        go: samples are taken only once this is set; the device is opened before.
    """

    def __init__(
        self,
        driver: Driver,
        *,
        take: Callable[[Sample, bool], None],
        tell: Callable[[Health], None],
        settings: ServiceSection,
        policy: Policy,
        stop: threading.Event,
        go: threading.Event,
        clock: Clock,
    ) -> None:
        self.driver = driver
        self._take, self._tell = take, tell
        self._settings, self._policy = settings, policy
        self._stop, self._go = stop, go
        self._clock = clock
        self._ids: dict[str, FrameCount] = {}
        self._thread = threading.Thread(target=self._run, name=f"device {driver.name}")
        self.ready = threading.Event()
        """Set once the device is open, or has failed for good."""
        self.finished = threading.Event()
        self.failure: RecorderError | None = None
        self.description: dict[str, str] = {}
        self.health = Health(clock.raw_ns(), driver.name, DeviceState.STARTING)
        self._samples = 0
        self._lost = 0

    def start(self) -> None:
        self._thread.start()

    def join(self) -> None:
        if self._thread.ident is not None:
            self._thread.join()

    def now(self) -> Health:
        """The current state with the current counts."""
        health = self.health
        return Health(
            self._clock.raw_ns(), health.device, health.state, health.reason, self._samples, self._lost
        )

    def _run(self) -> None:
        wait_s = self._settings.retry_seconds
        while not self._stop.is_set():
            self._say(DeviceState.STARTING)
            before = self._samples
            try:
                self._session()
                break
            except RecorderError as error:
                reason, failure = str(error), error
            except Exception as error:  # a driver's bug must not end the recording of the others
                reason = f"unexpected {type(error).__name__}: {error}"
                failure = RecorderError(reason, where=self.driver.name)
            finally:
                self.driver.close()
            for count in self._ids.values():
                count.reopened(reason)
            self._say(DeviceState.FAILING if self._samples else DeviceState.ABSENT, reason)
            if not self._policy.retry:
                self.failure = failure
                break
            wait_s = self._settings.retry_seconds if self._samples > before else wait_s
            self._stop.wait(wait_s)
            wait_s = min(2 * wait_s, self._settings.retry_max_seconds)
        self._state_absence()
        self.ready.set()
        self.finished.set()

    def _session(self) -> None:
        """From opening the device until it ends or the recording stops; raises on any fault."""
        self.driver.open()
        self.description = dict(self.driver.describe())
        self.ready.set()
        while not self._go.wait(0.1):
            if self._stop.is_set():
                return
        heard_ns = self._clock.raw_ns()
        silent_ns = round(self._settings.silent_seconds * 1e9)
        for sample in self.driver.samples():
            if sample is not None:
                heard_ns = self._clock.raw_ns()
                self._forward(sample)
                if self.health.state is not DeviceState.STREAMING:
                    self._say(DeviceState.STREAMING)
            elif self._clock.raw_ns() - heard_ns > silent_ns and self.health.state is not DeviceState.SILENT:
                self._say(DeviceState.SILENT, f"nothing for {self._settings.silent_seconds:g} s")
            if self._stop.is_set():
                return
        self._say(DeviceState.ENDED)

    def _forward(self, sample: Sample) -> None:
        if not isinstance(sample, Frame | Loss):
            self._samples += 1
            self._take(sample, self.driver.live)
            return
        topic = sample.topic if isinstance(sample, Frame) else sample.stream
        for placed in self._ids.setdefault(topic, FrameCount()).place(sample):
            if isinstance(placed, Loss):
                self._lost += placed.count
            else:
                self._samples += 1
            self._take(placed, self.driver.live)

    def _state_absence(self) -> None:
        """A camera that is away when the recording ends has lost what it would have taken."""
        for topic, count in self._ids.items():
            loss = count.ended(topic, self._clock.raw_ns())
            if loss is not None:
                self._lost += loss.count
                self._take(loss, self.driver.live)

    def _say(self, state: DeviceState, reason: str = "") -> None:
        self.health = Health(self._clock.raw_ns(), self.driver.name, state, reason, self._samples, self._lost)
        self._tell(self.health)
