"""The embedded camera: its schedule, and what a late consumer loses."""

from itertools import islice

import numpy as np
import pytest

from recorder.samples import Frame, Loss, LossCause
from recorder.simulation.embedded import EmbeddedCamera

STACK = np.arange(3 * 4 * 5, dtype=np.uint16).reshape(3, 4, 5)


class FakeClock:
    """Time passes only while somebody sleeps."""

    def __init__(self) -> None:
        self.now = 5_000_000_000

    def raw_ns(self) -> int:
        return self.now

    monotonic_ns = realtime_ns = boottime_ns = raw_ns

    def sleep(self, seconds: float) -> None:
        self.now += round(seconds * 1e9)


def test_it_keeps_its_rate_without_drift() -> None:
    clock = FakeClock()
    camera = EmbeddedCamera("front", STACK, rate_hz=59.82, clock=clock, sleep=clock.sleep)
    frames = [s for s in islice(camera.samples(), 5983) if isinstance(s, Frame)]
    assert [frame.id for frame in frames] == list(range(5983))
    last = frames[-1].stamp
    assert last.device_ns == 5982 * 50 * 10**9 // 2991
    assert last.raw_ns is not None
    assert last.raw_ns - 5_000_000_000 == pytest.approx(last.device_ns, abs=10)
    assert last.realtime_ns is None


def test_the_frames_are_played_over_and_over_and_cannot_be_changed() -> None:
    clock = FakeClock()
    camera = EmbeddedCamera("front", STACK, clock=clock, sleep=clock.sleep)
    frames = [s for s in islice(camera.samples(), 7) if isinstance(s, Frame)]
    np.testing.assert_array_equal([f.pixels for f in frames], STACK[[0, 1, 2, 0, 1, 2, 0]])
    assert {(f.camera, f.bit_depth, f.settings.pixel_format) for f in frames} == {("front", 10, "Mono10")}
    assert not frames[0].pixels.flags.writeable
    assert STACK.flags.writeable


def test_a_slow_camera_lets_the_caller_look_up() -> None:
    clock = FakeClock()
    camera = EmbeddedCamera("front", STACK, rate_hz=1, clock=clock, sleep=clock.sleep)
    samples = list(islice(camera.samples(), 6))
    assert [s is None for s in samples] == [False, True, True, True, True, False]


def test_a_late_consumer_finds_the_buffers_and_the_loss() -> None:
    clock = FakeClock()
    camera = EmbeddedCamera("front", STACK, rate_hz=10, buffers=4, clock=clock, sleep=clock.sleep)
    samples = camera.samples()
    assert isinstance(next(samples), Frame)
    clock.now += 350_000_000  # frames 1 to 3 wait in buffers
    assert [s.id for s in islice(samples, 3) if isinstance(s, Frame)] == [1, 2, 3]
    clock.now += 1_000_000_000  # frames 4 to 13 were exposed, the last four are there
    loss = next(samples)
    assert isinstance(loss, Loss)
    assert (loss.first_id, loss.last_id, loss.cause) == (4, 9, LossCause.TRANSPORT)
    assert (loss.first_raw_ns, loss.last_raw_ns) == (5_400_000_000, 5_900_000_000)
    assert [s.id for s in islice(samples, 4) if isinstance(s, Frame)] == [10, 11, 12, 13]


@pytest.mark.parametrize("frames", [STACK[0], STACK.astype(np.uint8), STACK[:0]])
def test_wrong_frames(frames: np.ndarray) -> None:
    with pytest.raises(ValueError, match="uint16"):
        EmbeddedCamera("front", frames)


@pytest.mark.parametrize("wrong", [{"rate_hz": 0.0}, {"buffers": 0}])
def test_wrong_numbers(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="positive"):
        EmbeddedCamera("front", STACK, **wrong)  # type: ignore[arg-type]


def test_describe_and_close() -> None:
    camera = EmbeddedCamera("front", STACK)
    camera.open()
    assert camera.describe()["size"] == "5x4"
    camera.close()
    camera.close()
