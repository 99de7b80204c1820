"""One thread a device: opens it, takes its samples, and never gives up on it.

Reconnecting, back-off, counting and health are written here once, for all devices.
"""

import threading
from collections.abc import Callable

from recorder.clock import Clock
from recorder.config import ServiceSection
from recorder.drivers.base import Driver
from recorder.errors import RecorderError
from recorder.samples import DeviceState, Frame, Health, LogLine, Loss, Sample
from recorder.service.ids import FrameCount

_LET_GO_S = 5.0
"""A driver that has not let go of its device by then is left behind, so that the drive can be closed."""


class Supervisor:
    """Runs one driver in its own thread until stopped, ended, or failed without retry.

    A live device that fails is opened again for ever if ``retry``. A file is tried again only
    until it can be opened: played once, it has ended, well or not.

    Args:
        driver: the device.
        take: called in this thread with each sample and whether the device is live; False if it
            had to be left out.
        tell: called with a `Health` at every change of state.
        retry: try again (the service), or keep the error and end (a one-shot recording).
        stop: ends the thread within a driver's poll period (0.2 s).
        go: samples are taken only once this is set; the device is opened before.
    """

    def __init__(
        self,
        driver: Driver,
        *,
        take: Callable[[Sample, bool], bool],
        tell: Callable[[Health], None],
        settings: ServiceSection,
        retry: bool,
        stop: threading.Event,
        go: threading.Event,
        clock: Clock,
    ) -> None:
        self.driver = driver
        self._take, self._tell = take, tell
        self._settings, self._retry = settings, retry
        self._stop, self._go = stop, go
        self._clock = clock
        self._ids: dict[str, FrameCount] = {}
        # a daemon, so that a driver that hangs in a call can't keep the process from ending
        self._thread = threading.Thread(target=self._run, name=f"device {driver.name}", daemon=True)
        self.ready = threading.Event()
        """Set once the device is open, or has failed for good."""
        self.finished = threading.Event()
        self.failure: RecorderError | None = None
        self.description: dict[str, str] = {}
        self._samples = 0
        self._lost = 0
        self._told = False
        self._health = Health(clock.raw_ns(), driver.name, DeviceState.STARTING)

    def start(self) -> None:
        self._thread.start()

    def join(self) -> None:
        """Wait until the device is let go of; one that hangs is left behind, with an error."""
        if self._thread.ident is None:
            return
        self._thread.join(_LET_GO_S)
        if self._thread.is_alive():
            self.failure = RecorderError("the device does not let go", where=self.driver.name)

    def now(self) -> Health:
        """The current state with the current counts."""
        state, reason = self._health.state, self._health.reason
        return Health(self._clock.raw_ns(), self.driver.name, state, reason, self._samples, self._lost)

    def state_absence(self, raw_ns: int) -> None:
        """When the recording ends: a camera that is away has lost what it would have taken until then."""
        if self._health.state is DeviceState.ENDED or not self.driver.live:
            return
        for topic, count in self._ids.items():
            loss = count.ended(topic, raw_ns, self._health.reason or "nothing came any more")
            if loss is not None:
                self._lost += loss.count
                self._take(loss, True)

    def _run(self) -> None:
        try:
            self._supervise()
        finally:
            self.ready.set()
            self.finished.set()

    def _supervise(self) -> None:
        wait_s = self._settings.retry_seconds
        while not self._stop.is_set():
            if self._health.state not in (DeviceState.ABSENT, DeviceState.FAILING):
                self._say(DeviceState.STARTING)
            before = self._samples
            failure = self._session()
            failure = self._let_go() or failure
            if failure is None:
                return
            reason = str(failure)
            for count in self._ids.values():
                count.reopened(reason)
            self._say(DeviceState.FAILING if self._samples else DeviceState.ABSENT, reason)
            played = not self.driver.live and self._samples > before
            if played or not self._retry:
                self.failure = failure
                return
            wait_s = self._settings.retry_seconds if self._samples > before else wait_s
            self._stop.wait(wait_s)
            wait_s = min(2 * wait_s, self._settings.retry_max_seconds)

    def _session(self) -> RecorderError | None:
        """From opening the device until it ends, fails (the error) or the recording stops."""
        try:
            self.driver.open()
            self.description = dict(self.driver.describe())
            self.ready.set()
            self._listen()
        except RecorderError as error:
            return error
        except Exception as error:  # a driver's bug must not end the recording of the others
            return self._unexpected(error)
        return None

    def _let_go(self) -> RecorderError | None:
        try:
            self.driver.close()
        except Exception as error:
            return self._unexpected(error)
        return None

    def _unexpected(self, error: Exception) -> RecorderError:
        return RecorderError(f"unexpected {type(error).__name__}: {error}", where=self.driver.name)

    def _listen(self) -> None:
        while not self._go.wait(0.1):
            if self._stop.is_set():
                return
        heard_ns = self._clock.raw_ns()
        silent_ns = round(self._settings.silent_seconds * 1e9)
        for sample in self.driver.samples():
            if isinstance(sample, LogLine):  # what the device tells of itself may have changed with it
                self.description = dict(self.driver.describe())
                self._take(sample, self.driver.live)
            elif sample is not None:
                heard_ns = self._clock.raw_ns()
                self._forward(sample)
                if self._health.state is not DeviceState.STREAMING:
                    self._say(DeviceState.STREAMING)
            elif self._health.state is not DeviceState.SILENT and self._clock.raw_ns() - heard_ns > silent_ns:
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
            kept = self._take(placed, self.driver.live)
            if isinstance(placed, Loss):
                self._lost += placed.count
            elif kept:
                self._samples += 1
            else:
                self._lost += 1

    def _say(self, state: DeviceState, reason: str = "") -> None:
        """Tell a change; what is tried again with the same outcome is no change."""
        changed = (state, reason) != (self._health.state, self._health.reason) or not self._told
        self._told = True
        self._health = Health(
            self._clock.raw_ns(), self.driver.name, state, reason, self._samples, self._lost
        )
        if changed:
            self._tell(self._health)
