"""The GenICam driver against a real GigE Vision camera in its own process, over loopback."""

import gc
import socket
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from recorder.config import CameraSection
from recorder.drivers.genicam import GenicamCamera
from recorder.errors import DeviceAbsent, DeviceBusy, DeviceError, DeviceLost, DeviceUnsuitable
from recorder.samples import Frame, Loss, LossCause
from recorder.simulation.gige_camera import GigeCameraProcess, aravis_problem
from recorder.simulation.gige_pixels import pattern, pattern_number

pytestmark = pytest.mark.skipif(aravis_problem() != "", reason=aravis_problem() or "Aravis is there")

ADDRESS = "127.0.0.1"
SOURCE = f"genicam://{ADDRESS}"
BIT_DEPTHS = {"Mono8": 8, "Mono10": 10, "Mono10p": 10, "Mono12": 12, "Mono16": 16}


@pytest.fixture(scope="class")
def twin() -> Iterator[GigeCameraProcess]:
    """A small camera that no test harms. Its images are 162 columns wide, no multiple of four."""
    with GigeCameraProcess(width=162, height=122, rate=100) as process:
        yield process


def camera(**settings: object) -> GenicamCamera:
    return GenicamCamera("front", CameraSection.model_validate({"source": SOURCE, **settings}))


@contextmanager
def opened(**settings: object) -> Iterator[GenicamCamera]:
    driver = camera(**settings)
    with closing(driver):
        driver.open()
        yield driver


def take(driver: GenicamCamera, count: int, timeout_s: float = 10.0) -> list[Frame | Loss]:
    """The next samples; fails if the camera says nothing for so long."""
    taken: list[Frame | Loss] = []
    end = time.monotonic() + timeout_s
    for sample in driver.samples():
        if isinstance(sample, Frame | Loss):
            taken.append(sample)
        if len(taken) >= count:
            return taken
        assert time.monotonic() < end, f"{len(taken)} of {count} samples"
    raise AssertionError("the camera ended")


@pytest.mark.usefixtures("twin")
class TestCamera:
    """What one healthy camera is asked for."""

    def test_pixels_ids_and_stamps_are_exact(self, twin: GigeCameraProcess) -> None:
        for name, depth in BIT_DEPTHS.items():
            with opened(pixel_format=name) as driver:
                frames = take(driver, 12)
            for index, frame in enumerate(frames):
                assert isinstance(frame, Frame), name
                assert (frame.id, frame.bit_depth, frame.settings.pixel_format) == (index, depth, name)
                assert pattern_number(frame.pixels) == index
                np.testing.assert_array_equal(frame.pixels, pattern(index, 162, 122, depth))
            for before, after in pairwise(frames):
                assert isinstance(before, Frame)
                assert isinstance(after, Frame)
                for stamp in ("raw_ns", "device_ns", "realtime_ns"):
                    assert getattr(before.stamp, stamp) < getattr(after.stamp, stamp)
            assert isinstance(after, Frame)
            assert after.stamp.realtime_ns is not None
            assert abs(time.time_ns() - after.stamp.realtime_ns) < 5_000_000_000

    def test_settings_are_set_and_told(self, twin: GigeCameraProcess) -> None:
        with opened(
            width=160, height=100, rate_hz=50, exposure_us=1234.5, gain=2.5, packet_bytes=1400
        ) as driver:
            told = dict(driver.describe())
            (frame,) = take(driver, 1)
            assert driver.statistics["underruns"] == 0
        assert (told["vendor"], told["serial"], told["pixel_format"], told["size"]) == (
            "Aravis",
            twin.serial,
            "Mono10p",
            "160x100",
        )
        assert isinstance(frame, Frame)
        assert frame.pixels.shape == (100, 160)
        assert frame.settings.exposure_us == 1234.5
        assert frame.settings.gain == 2.5
        assert frame.settings.black_level == 8.0
        assert frame.settings.rate_hz == pytest.approx(50, rel=1e-3)

    @pytest.mark.parametrize(
        ("settings", "told"),
        [
            ({"exposure_us": 99999}, "exposure 99999 is out of the camera's range, 9 to 16656 us"),
            ({"gain": 0.5}, "gain 0.5 is out of the camera's range, 1 to 4"),
            ({"rate_hz": 500}, "rate 500 is out of the camera's range, 0.1 to 200 Hz"),
            ({"width": 5000}, "width 5000 is out of the camera's range, 1 to 162 pixels"),
        ],
    )
    def test_value_out_of_range_is_refused(
        self, twin: GigeCameraProcess, settings: dict[str, object], told: str
    ) -> None:
        with pytest.raises(DeviceUnsuitable) as caught, opened(**settings):
            pass
        assert str(caught.value) == f"{SOURCE}: {told}; correct the configuration"
        with opened() as driver:  # nobody holds it now
            take(driver, 1)

    def test_second_client_is_told_busy_and_the_first_goes_on(self, twin: GigeCameraProcess) -> None:
        with opened() as driver:
            take(driver, 1)
            with pytest.raises(DeviceBusy, match="another program controls the camera"), opened():
                pass
            assert all(isinstance(sample, Frame) for sample in take(driver, 30))

    def test_close_leaves_nothing_and_may_be_repeated(self, twin: GigeCameraProcess) -> None:
        def held() -> tuple[int, int]:
            gc.collect()
            return len(list(Path("/proc/self/fd").iterdir())), len(list(Path("/proc/self/task").iterdir()))

        driver = camera()
        driver.close()
        with opened():
            pass  # what the library opens once and for all is open now
        before = held()
        for _ in range(3):
            driver.open()
            samples = driver.samples()
            next(samples)
            assert held()[1] > before[1]
            driver.close()  # while the caller still holds its iterator
            driver.close()
            assert held() == before
            assert list(samples) == []
            assert driver.describe() == {}


def test_ids_go_on_over_the_16_bit_wrap() -> None:
    # The camera's own ids start at 65400, so 200 images are past 65535, after which comes 1.
    with GigeCameraProcess(width=64, height=16, rate=200), opened() as driver:
        ids = [sample.id for sample in take(driver, 200) if isinstance(sample, Frame)]
    assert ids == list(range(200))


def test_packet_loss_becomes_losses_that_fill_the_gaps() -> None:
    with (
        GigeCameraProcess(width=160, height=120, rate=100, loss=0.02),
        opened(packet_bytes=1400) as driver,
    ):
        samples = take(driver, 200)
    lost = [sample for sample in samples if isinstance(sample, Loss)]
    assert 20 < len(lost) < 180
    next_id = 0
    for sample in samples:
        first, last = (
            (sample.id, sample.id) if isinstance(sample, Frame) else (sample.first_id, sample.last_id)
        )
        assert first == next_id
        next_id = last + 1
        if isinstance(sample, Frame):
            number = pattern_number(sample.pixels)
            assert number == sample.id + pattern_number_of_first(samples)
            np.testing.assert_array_equal(sample.pixels, pattern(number, 160, 120, 10))
    for loss in lost:
        assert loss.stream == "/camera/front/image"
        assert loss.cause is LossCause.TRANSPORT
        assert loss.detail in {"missing-packets", "timeout", "never arrived"}
        assert loss.first_raw_ns is not None
        assert loss.last_raw_ns is not None
        assert loss.first_raw_ns <= loss.last_raw_ns


def pattern_number_of_first(samples: list[Frame | Loss]) -> int:
    """The camera's number of the image that the driver calls 0: nothing came of those before."""
    frame = next(sample for sample in samples if isinstance(sample, Frame))
    return pattern_number(frame.pixels) - frame.id


def test_killed_camera_is_lost_and_its_successor_can_be_opened() -> None:
    with GigeCameraProcess(width=64, height=16) as process, opened() as driver:
        take(driver, 5)
        process.kill()
        killed = time.monotonic()
        with pytest.raises(DeviceLost, match="the camera is gone"):
            list(driver.samples())
        assert time.monotonic() - killed < 10
        driver.close()
        with GigeCameraProcess(width=64, height=16):
            driver.open()
            assert [sample.id for sample in take(driver, 5) if isinstance(sample, Frame)] == list(range(5))
            driver.close()


def test_camera_that_stalls_briefly_goes_on() -> None:
    with GigeCameraProcess(width=64, height=16) as process, opened() as driver:
        take(driver, 5)
        process.pause()
        while next(driver.samples()) is not None:
            pass
        process.resume()
        assert len(take(driver, 20)) == 20


def test_camera_without_a_format_of_ours_is_unsuitable() -> None:
    with (
        GigeCameraProcess(formats="RGB8", pixel_format="RGB8", width=64, height=16),
        pytest.raises(DeviceUnsuitable, match=r"offers RGB8, not Mono10p or .*; use another camera"),
        opened(),
    ):
        pass


def test_best_format_is_chosen_and_another_can_be_refused() -> None:
    with GigeCameraProcess(formats="Mono8,Mono16", width=64, height=16):
        with opened() as driver:
            assert driver.describe()["pixel_format"] == "Mono16"
        with (
            pytest.raises(
                DeviceUnsuitable, match="offers Mono8, Mono16, not Mono10; set pixel_format to Mono8"
            ),
            opened(pixel_format="Mono10"),
        ):
            pass


def test_left_aligned_pixels_are_kept_as_they_are() -> None:
    """Some cameras send ten bits in the upper ones of sixteen, and call them Mono10."""
    with GigeCameraProcess(left_aligned=True, width=64, height=16), opened(pixel_format="Mono10") as driver:
        frames = take(driver, 3)
    for frame in frames:
        assert isinstance(frame, Frame)
        assert frame.bit_depth == 16
        np.testing.assert_array_equal(frame.pixels, pattern(frame.id, 64, 16, 10) << 6)


def test_nothing_there_is_told_soon() -> None:
    begin = time.monotonic()
    with pytest.raises(DeviceAbsent, match="no camera answers; check its power"), opened():
        pass
    assert time.monotonic() - begin < 5


def test_twin_that_cannot_serve_says_why() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind((ADDRESS, 3956))
        with pytest.raises(DeviceError, match="cannot serve a camera at UDP port 3956"):
            GigeCameraProcess().start()
