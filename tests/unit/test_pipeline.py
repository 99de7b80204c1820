"""From samples to a drive: what is lost is stated, and costs nothing but itself."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from recorder.clock import SYSTEM_CLOCK
from recorder.codec import encode, read_header
from recorder.config import Settings, parse
from recorder.errors import StorageError
from recorder.samples import Frame, Loss, LossCause, NmeaSentence, Preview, Record, Stamp
from recorder.service import pipeline as module
from recorder.service.pipeline import Pipeline
from recorder.storage import DriveHead, DriveWriter, inspect, open_drive, verify
from recorder.timebase import Timebase

PIXELS = np.arange(64 * 48, dtype=np.uint16).reshape(48, 64) % 1024


def settings(out: Path, **storage: object) -> Settings:
    values = {"drivers": {"gnss": {"source": "x"}}, "storage": {"out": out, **storage}}
    return parse(values, where="test")


class Rig:
    """A pipeline with a real drive behind it."""

    def __init__(self, chosen: Settings) -> None:
        self.timebase = Timebase(chosen.timebase)
        head = DriveHead(
            config_json="{}", log_offset_ns=self.timebase.log_offset_ns, start_raw_ns=SYSTEM_CLOCK.raw_ns()
        )
        self.writer = DriveWriter(chosen.storage, head)
        self.pipeline = Pipeline(chosen, self.timebase, self.writer, clock=SYSTEM_CLOCK)
        self.pipeline.start()

    def feed(self, count: int, *, live: bool) -> None:
        for number in range(count):
            stamp = Stamp(raw_ns=SYSTEM_CLOCK.raw_ns())
            self.pipeline.take(Frame("front", number, stamp, PIXELS, 10), live=live)

    def close(self) -> Path:
        self.pipeline.close()
        return self.writer.path


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    made = Rig(settings(tmp_path))
    yield made
    made.pipeline.close()


def test_frames_come_back_in_order(rig: Rig) -> None:
    rig.feed(50, live=False)
    with open_drive(rig.close()) as drive:
        assert [frame.id for frame in drive.frames("front")] == list(range(50))
        assert verify(drive).ok


def test_whatever_an_encoder_raises_costs_that_frame_alone(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = iter(range(100))

    def fails_once(*arguments: object, **options: object) -> bytes:
        if next(calls) == 7:
            raise MemoryError("no more")
        return encode(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "encode", fails_once)
    rig.feed(20, live=False)
    with open_drive(rig.close()) as drive:
        assert verify(drive).ok
        assert len(drive.frames("front")) == 19
        assert inspect(drive).losses == {"encoder": 1}
    assert rig.pipeline.lost == {"/camera/front/image": 1}


def test_a_live_camera_that_outruns_us_loses_frames_and_every_one_is_stated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slow(*arguments: object, **options: object) -> bytes:
        time.sleep(0.02)
        return encode(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "encode", slow)
    rig = Rig(settings(tmp_path, queue_bytes=1 << 20))
    monkeypatch.setattr(rig.pipeline._queue, "_bound", 10 * PIXELS.nbytes)
    rig.feed(100, live=True)
    lost = rig.pipeline.lost["/camera/front/image"]
    assert 0 < lost < 100
    rig.feed(0, live=True)
    with open_drive(rig.close()) as drive:
        told = verify(drive)
        assert inspect(drive).losses == {"queue": lost}
        assert told.frames == 100 - lost


def test_a_file_waits_and_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(settings(tmp_path))
    monkeypatch.setattr(rig.pipeline._queue, "_bound", 2 * PIXELS.nbytes)
    rig.feed(60, live=False)
    for number in range(2000):
        stamp = Stamp(raw_ns=number)
        rig.pipeline.take(NmeaSentence(stamp, b"$GPZDA,,,,,00,00*48\r\n"), live=False)
        assert rig.pipeline.queue_bytes <= 2 * PIXELS.nbytes
    with open_drive(rig.close()) as drive:
        assert len(drive.frames("front")) == 60
        assert drive.topics["/gnss/raw"].messages == 2000


def test_a_loss_that_goes_on_is_stated_meanwhile(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rig.pipeline._queue, "_bound", 0)
    rig.pipeline._queue.put(lambda: Loss("x", 0, 0, 0, 0, LossCause.DEVICE), 1, wait=False)
    held = threading.Event()
    rig.pipeline.call(lambda: (held.wait(5), None)[1])
    rig.feed(5, live=True)
    assert rig.pipeline.lost["/camera/front/image"] >= 4
    rig.pipeline.state_refused()
    assert not rig.pipeline._refused
    held.set()


def test_a_slow_preview_delays_nothing_and_holds_one_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started = threading.Semaphore(0)

    def slow(frame: Frame, **options: object) -> Preview:
        started.release()
        time.sleep(0.3)
        return Preview(frame.camera, frame.stamp, b"jpeg")

    monkeypatch.setattr(module, "preview", slow)
    chosen = settings(tmp_path)
    chosen = chosen.model_copy(update={"realtime": chosen.realtime.model_copy(update={"preview_hz": 10.0})})
    rig = Rig(chosen)
    end = time.monotonic() + 1
    count = 0
    while time.monotonic() < end:
        rig.pipeline.take(Frame("front", count, Stamp(raw_ns=SYSTEM_CLOCK.raw_ns()), PIXELS, 10), live=True)
        count += 1
        time.sleep(0.005)
    assert rig.pipeline._previewer._work_queue.qsize() <= 1
    before = time.monotonic()
    path = rig.close()
    assert time.monotonic() - before < 2
    with open_drive(path) as drive:
        assert len(drive.frames("front")) == count
        assert drive.topics["/camera/front/preview"].messages <= 4


def test_a_disk_that_fails_ends_the_recording_and_nobody_waits_for_ever(rig: Rig) -> None:
    writes = iter(range(1000))
    write = rig.writer.write

    def fails(record: Record) -> None:
        if next(writes) >= 10:
            raise StorageError("full", where="here")
        write(record)

    rig.writer.write = fails  # type: ignore[method-assign]
    rig.feed(200, live=False)
    path = rig.close()
    assert rig.pipeline.failed.is_set()
    assert "full" in str(rig.pipeline.failure)
    assert rig.pipeline.lost["/camera/front/image"] == 200 - rig.pipeline.frames["front"]
    with open_drive(path) as drive:
        assert len(drive.frames("front")) == rig.pipeline.frames["front"]


def test_a_record_that_cannot_be_written_costs_itself_and_is_stated(rig: Rig) -> None:
    rig.feed(3, live=False)
    stamp = Stamp(raw_ns=1 << 70)  # no 64-bit field takes it
    rig.pipeline.take(NmeaSentence(stamp, b"x"), live=False)
    rig.feed(0, live=False)
    with open_drive(rig.close()) as drive:
        assert verify(drive).ok
        assert "not written" in next(iter(drive.messages("/log"))).value.message


def test_raw_time_of_a_camera_goes_forward_whatever_its_stamps_say(rig: Rig) -> None:
    now = SYSTEM_CLOCK.raw_ns()
    for number, raw_ns in enumerate((now, now - 10**8, now - 5, now + 10)):
        rig.pipeline.take(Frame("front", number, Stamp(raw_ns=raw_ns), PIXELS, 10), live=False)
    with open_drive(rig.close()) as drive:
        assert verify(drive).ok
        raw = [frame.stamp.raw_ns for frame in drive.frames("front")]
    assert raw == [now, now + 1, now + 2, now + 10]


@pytest.mark.parametrize("bit_depth", [8, 10, 16])
def test_the_smaller_model_can_be_chosen_and_deep_frames_get_felics(tmp_path: Path, bit_depth: int) -> None:
    chosen = settings(tmp_path)
    chosen = chosen.model_copy(update={"codec": chosen.codec.model_copy(update={"model": "felics-ls"})})
    rig = Rig(chosen)
    pixels = PIXELS % (1 << min(bit_depth, 10))
    rig.pipeline.take(Frame("front", 0, Stamp(raw_ns=1), pixels, bit_depth), live=False)
    with open_drive(rig.close()) as drive:
        assert verify(drive).ok
        assert np.array_equal(drive.frames("front")[0].pixels, pixels)


@pytest.mark.parametrize("model", ["felics", "felics-ls"])
def test_tables_are_trained_once_a_second_and_every_image_stands_alone(tmp_path: Path, model: str) -> None:
    chosen = settings(tmp_path)
    rig = Rig(
        chosen.model_copy(update={"codec": chosen.codec.model_copy(update={"model": model, "workers": 1})})
    )
    random = np.random.default_rng(1)
    scenes = [
        random.normal(500, spread, (48, 64)).clip(0, 1023).astype(np.uint16)
        for spread in (20, 22, 60, 2000, 20)
    ]
    for number, pixels in enumerate(scenes):
        stamp = Stamp(raw_ns=number * 600_000_000 if number < 3 else 1_200_000_000 + number)
        rig.pipeline.take(Frame("front", number, stamp, pixels, 10), live=False)
    with open_drive(rig.close()) as drive:
        assert verify(drive).ok
        frames = drive.frames("front")
        tables = [read_header(frame.data).tables for frame in frames]
        for frame, pixels in zip(frames, scenes, strict=True):
            assert np.array_equal(frame.pixels, pixels)
    assert tables[0] == tables[1] != tables[2]
    assert tables[3] == b""  # noise: raw
    assert tables[4] not in (b"", tables[2])  # trained again at once, not after a second
