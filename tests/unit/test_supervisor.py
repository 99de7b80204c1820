"""A device's thread: states, retries, counting, one-shot."""

import threading
import time
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from recorder.clock import SYSTEM_CLOCK
from recorder.config import ServiceSection
from recorder.errors import DeviceAbsent, DeviceLost
from recorder.samples import DeviceState, Frame, Health, LogLine, Loss, Sample, Stamp
from recorder.service.supervisor import Supervisor

SETTINGS = ServiceSection(retry_seconds=0.01, retry_max_seconds=0.02, silent_seconds=0.1)


class Scripted:
    """A driver that does what each of its sessions says."""

    def __init__(self, *sessions: Callable[[], Iterator[Sample | None]], live: bool = True) -> None:
        self.name = "front"
        self.live = live
        self._sessions = list(sessions)
        self.closed = 0
        self.opened = 0

    def open(self) -> None:
        self.opened += 1
        if not self._sessions:
            raise DeviceAbsent("nothing answers", where="here")

    def samples(self) -> Iterator[Sample | None]:
        return self._sessions.pop(0)()

    def describe(self) -> Mapping[str, str]:
        return {"model": "scripted"}

    def close(self) -> None:
        self.closed += 1


def frames(count: int, then: Exception | None = None) -> Callable[[], Iterator[Sample | None]]:
    def session() -> Iterator[Sample | None]:
        for number in range(count):
            time.sleep(0.002)
            stamp = Stamp(raw_ns=SYSTEM_CLOCK.raw_ns())
            yield Frame("front", number, stamp, np.zeros((1, 1), np.uint16), 10)
        if then is not None:
            raise then

    return session


class Watch:
    """Runs a supervisor and keeps what it says."""

    def __init__(self, driver: Scripted, *, retry: bool) -> None:
        self.samples: list[Sample] = []
        self.full = False
        self.states: list[Health] = []
        self.stop, go = threading.Event(), threading.Event()
        go.set()
        self.supervisor = Supervisor(
            driver,
            take=self.take,
            tell=self.states.append,
            settings=SETTINGS,
            retry=retry,
            stop=self.stop,
            go=go,
            clock=SYSTEM_CLOCK,
        )
        self.supervisor.start()

    def take(self, sample: Sample, live: bool) -> bool:
        self.samples.append(sample)
        return not self.full

    def until(self, condition: Callable[[], bool]) -> None:
        end = time.monotonic() + 5
        while not condition():
            assert time.monotonic() < end, [str(state) for state in self.states]
            time.sleep(0.005)

    def end(self) -> None:
        self.stop.set()
        self.supervisor.join()

    def said(self) -> list[DeviceState]:
        return [health.state for health in self.states]


def test_a_source_that_ends_is_ended() -> None:
    driver = Scripted(frames(3))
    watch = Watch(driver, retry=False)
    watch.until(watch.supervisor.finished.is_set)
    watch.end()
    assert watch.said() == [DeviceState.STARTING, DeviceState.STREAMING, DeviceState.ENDED]
    assert len(watch.samples) == 3
    assert driver.closed == 1
    assert watch.supervisor.description == {"model": "scripted"}


def test_what_a_device_tells_of_itself_is_no_sample_and_renews_its_description() -> None:
    class Learning(Scripted):
        baud = "4800"

        def describe(self) -> Mapping[str, str]:
            return {"baud": self.baud}

    def session() -> Iterator[Sample | None]:
        driver.baud = "9600"
        yield LogLine(SYSTEM_CLOCK.raw_ns(), "info", "front", "speaks NMEA at 9600 baud")

    driver = Learning(session)
    watch = Watch(driver, retry=False)
    watch.until(watch.supervisor.finished.is_set)
    watch.end()
    assert watch.supervisor.description == {"baud": "9600"}
    assert watch.supervisor.now().samples == 0
    assert [type(sample) for sample in watch.samples] == [LogLine]
    assert DeviceState.STREAMING not in watch.said()


def test_a_device_that_fails_is_opened_again_and_what_it_missed_is_stated() -> None:
    watch = Watch(Scripted(frames(20, DeviceLost("unplugged")), frames(20)), retry=True)
    watch.until(watch.supervisor.finished.is_set)
    watch.end()
    assert DeviceState.FAILING in watch.said()
    ids = [sample.id for sample in watch.samples if isinstance(sample, Frame)]
    losses = [sample for sample in watch.samples if isinstance(sample, Loss)]
    stated = [number for loss in losses for number in range(loss.first_id, loss.last_id + 1)]
    assert sorted(ids + stated) == list(range(ids[-1] + 1))
    assert any("unplugged" in health.reason for health in watch.states)


def test_an_absent_device_is_tried_for_ever() -> None:
    driver = Scripted()
    watch = Watch(driver, retry=True)
    watch.until(lambda: driver.opened >= 4)
    assert not watch.supervisor.finished.is_set()
    watch.end()
    assert watch.said() == [DeviceState.STARTING, DeviceState.ABSENT]


def test_one_shot_keeps_the_first_error_and_ends() -> None:
    watch = Watch(Scripted(), retry=False)
    watch.until(watch.supervisor.finished.is_set)
    watch.end()
    assert isinstance(watch.supervisor.failure, DeviceAbsent)
    assert watch.supervisor.ready.is_set()


def test_a_drivers_bug_is_a_failing_device_not_a_dead_thread() -> None:
    watch = Watch(Scripted(frames(1, ZeroDivisionError("oops")), frames(2)), retry=True)
    watch.until(watch.supervisor.finished.is_set)
    watch.end()
    assert any("unexpected ZeroDivisionError" in health.reason for health in watch.states)
    assert watch.said()[-1] is DeviceState.ENDED


def test_silence_is_noticed_and_its_end_too() -> None:
    def session() -> Iterator[Sample | None]:
        yield from frames(1)()
        end = time.monotonic() + 0.3
        while time.monotonic() < end:
            time.sleep(0.02)
            yield None
        yield from frames(1)()

    watch = Watch(Scripted(session), retry=False)
    watch.until(watch.supervisor.finished.is_set)
    watch.end()
    assert watch.said() == [
        DeviceState.STARTING,
        DeviceState.STREAMING,
        DeviceState.SILENT,
        DeviceState.STREAMING,
        DeviceState.ENDED,
    ]


def test_a_file_that_fails_is_not_played_again() -> None:
    driver = Scripted(frames(3, DeviceLost("images are missing")), frames(3), live=False)
    watch = Watch(driver, retry=True)
    watch.until(watch.supervisor.finished.is_set)
    watch.end()
    assert isinstance(watch.supervisor.failure, DeviceLost)
    assert len(watch.samples) == 3


def test_a_file_that_is_not_there_yet_is_waited_for() -> None:
    driver = Scripted(live=False)
    watch = Watch(driver, retry=True)
    watch.until(lambda: driver.opened >= 3)
    driver._sessions.append(frames(2))
    watch.until(watch.supervisor.finished.is_set)
    watch.end()
    assert len(watch.samples) == 2


def test_a_driver_that_cannot_be_closed_does_not_kill_its_thread() -> None:
    class Stuck(Scripted):
        def close(self) -> None:
            super().close()
            raise OSError("device does not answer")

    watch = Watch(Stuck(frames(2)), retry=False)
    watch.until(watch.supervisor.finished.is_set)
    watch.end()
    assert watch.supervisor.ready.is_set()
    assert "device does not answer" in str(watch.supervisor.failure)


def test_frames_that_find_no_room_are_counted_as_lost() -> None:
    watch = Watch(Scripted(frames(5)), retry=False)
    watch.full = True
    watch.until(watch.supervisor.finished.is_set)
    watch.end()
    health = watch.supervisor.now()
    assert (health.samples, health.lost) == (0, 5)


def test_a_camera_that_failed_has_lost_frames_until_the_recording_ends() -> None:
    watch = Watch(Scripted(frames(30, DeviceLost("unplugged"))), retry=False)
    watch.until(watch.supervisor.finished.is_set)
    watch.end()
    last = watch.samples[-1]
    assert isinstance(last, Frame)
    assert last.stamp.raw_ns is not None
    watch.supervisor.state_absence(last.stamp.raw_ns + 10**9)
    loss = watch.samples[-1]
    assert isinstance(loss, Loss)
    assert loss.first_id == last.id + 1
    assert 100 < loss.count < 600
    assert "unplugged" in loss.detail


def test_a_camera_that_fell_silent_has_lost_frames_until_the_recording_ends() -> None:
    def session() -> Iterator[Sample | None]:
        yield from frames(30)()
        while True:
            time.sleep(0.02)
            yield None

    watch = Watch(Scripted(session), retry=True)
    watch.until(lambda: DeviceState.SILENT in watch.said())
    watch.end()
    watch.supervisor.state_absence(SYSTEM_CLOCK.raw_ns() + 10**9)
    assert isinstance(watch.samples[-1], Loss)
    assert "nothing for" in watch.samples[-1].detail


def test_a_source_that_ended_well_has_lost_nothing() -> None:
    watch = Watch(Scripted(frames(5)), retry=False)
    watch.until(watch.supervisor.finished.is_set)
    watch.end()
    watch.supervisor.state_absence(SYSTEM_CLOCK.raw_ns() + 10**10)
    assert all(isinstance(sample, Frame) for sample in watch.samples)
