"""One unbroken count of frames across reconnections, with the ledger exactly equal."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from recorder.samples import CameraSettings, Frame, Loss, LossCause, Stamp
from recorder.service.ids import FrameCount

PERIOD_NS = 20_000_000
PIXELS = np.zeros((1, 1), np.uint16)


def frame(number: int, raw_ns: int) -> Frame:
    return Frame("front", number, Stamp(raw_ns=raw_ns), PIXELS, 10)


def test_ids_pass_unchanged_on_the_first_connection() -> None:
    count = FrameCount()
    assert [count.place(frame(n, n * PERIOD_NS))[0].id for n in range(3)] == [0, 1, 2]  # type: ignore[union-attr]


def test_time_away_becomes_one_loss_of_as_many_frames() -> None:
    count = FrameCount()
    for n in range(10):
        count.place(frame(n, n * PERIOD_NS))
    count.reopened("unplugged")
    loss, again = count.place(frame(0, 59 * PERIOD_NS))
    assert isinstance(loss, Loss)
    assert (loss.first_id, loss.last_id, loss.cause) == (10, 58, LossCause.DEVICE)
    assert "unplugged" in loss.detail
    assert isinstance(again, Frame)
    assert again.id == 59


def test_a_failure_before_the_first_frame_loses_nothing() -> None:
    count = FrameCount()
    count.reopened("absent")
    assert count.ended("/camera/front/image", 10**10, "silent") is None
    assert count.place(frame(0, 0))[0].id == 0  # type: ignore[union-attr]


def test_a_camera_that_is_away_at_the_end_has_lost_until_then() -> None:
    count = FrameCount()
    for n in range(3):
        count.place(frame(n, n * PERIOD_NS))
    count.reopened("silent")
    loss = count.ended("/camera/front/image", 12 * PERIOD_NS, "silent")
    assert loss is not None
    assert (loss.first_id, loss.last_id) == (3, 11)


@given(st.lists(st.tuples(st.integers(1, 30), st.integers(0, 40), st.integers(0, 3)), min_size=1, max_size=6))
def test_every_id_is_a_frame_or_in_exactly_one_loss(sessions: list[tuple[int, int, int]]) -> None:
    """Sessions of (frames, periods away, frames lost in transport at the start)."""
    count = FrameCount()
    now = 0
    seen: list[int] = []
    for frames, away, lost in sessions:
        placed: list[Frame | Loss] = []
        if lost:
            placed += count.place(Loss("/camera/front/image", 0, lost - 1, now, now, LossCause.TRANSPORT))
        for n in range(frames):
            now += PERIOD_NS
            placed += count.place(frame(lost + n, now))
        for sample in placed:
            seen += [sample.id] if isinstance(sample, Frame) else range(sample.first_id, sample.last_id + 1)
        count.reopened("gone")
        now += away * PERIOD_NS
    assert seen == list(range(len(seen)))


def lost(placed: list[Frame | Loss]) -> int:
    return sum(sample.count for sample in placed if isinstance(sample, Loss))


def test_each_time_away_is_counted_by_the_cameras_own_period() -> None:
    count = FrameCount()
    now = 0
    stated = []
    for _ in range(4):
        for n in range(40):
            stated.append(lost(count.place(frame(n, now))))
            now += PERIOD_NS
        count.reopened("gone")
        now += 500 * PERIOD_NS - PERIOD_NS
    assert [number for number in stated if number] == [499, 499, 499]


def test_what_was_lost_before_the_fault_is_not_counted_again() -> None:
    count = FrameCount()
    for n in range(10):
        count.place(frame(n, n * PERIOD_NS))
    before = Loss("/camera/front/image", 10, 69, 9 * PERIOD_NS, 69 * PERIOD_NS, LossCause.TRANSPORT)
    count.place(before)
    count.reopened("gone")
    assert lost(count.place(frame(0, 80 * PERIOD_NS))) == 10


def test_after_a_single_frame_the_cameras_nominal_rate_is_taken_and_else_one_is_stated() -> None:
    settings = CameraSettings(rate_hz=50)
    for told, expected in ((settings, 99), (CameraSettings(), 1)):
        count = FrameCount()
        count.place(Frame("front", 0, Stamp(raw_ns=0), PIXELS, 10, told))
        count.reopened("gone")
        assert lost(count.place(frame(0, 100 * PERIOD_NS))) == expected


def test_a_loss_without_a_time_after_reconnecting_does_not_hide_the_time_away() -> None:
    count = FrameCount()
    for n in range(10):
        count.place(frame(n, n * PERIOD_NS))
    count.reopened("gone")
    placed = count.place(Loss("/camera/front/image", 0, 1, None, None, LossCause.TRANSPORT))
    placed += count.place(frame(2, 100 * PERIOD_NS))
    assert lost(placed) == 90
    ids = [s.id for s in placed if isinstance(s, Frame)]
    assert ids == [100]


def test_a_camera_that_is_silent_at_the_end_has_lost_frames_and_a_lively_one_has_not() -> None:
    count = FrameCount()
    for n in range(40):
        count.place(frame(n, n * PERIOD_NS))
    assert count.ended("/camera/front/image", 41 * PERIOD_NS, "silent") is None
    loss = count.ended("/camera/front/image", 39 * PERIOD_NS + 10**9, "silent")
    assert loss is not None
    assert loss.count == 49
