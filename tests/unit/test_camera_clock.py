"""When a frame was exposed: by the camera's ticks or ids, without the jitter of its way here."""

import time
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

import pytest
from camera_time import frame_errors_ns, frame_jitter_us, rms_ns
from hypothesis import given
from hypothesis import strategies as st

from recorder.config import CameraSection
from recorder.simulation.clocks import SimulatedCamera, SimulatedFrame
from recorder.timebase import CameraClock, CameraClockSettings, Exposure
from recorder.timebase.lower_envelope import LowerEnvelope

SECOND_NS = 1_000_000_000
MS_NS = 1_000_000
START_NS = 10**12
CAMERA = SimulatedCamera()
TOLD = CameraClockSettings(transfer_ns=CAMERA.transfer_ns)


def observed(
    frames: Iterable[SimulatedFrame],
    settings: CameraClockSettings = TOLD,
    *,
    ticks: bool = True,
    period_ns: int | None = None,
) -> list[tuple[Exposure, int]]:
    """What the clock says of each frame, and how far from the truth that is."""
    clock = CameraClock(settings)
    told = []
    for frame in frames:
        stamp_ns = frame.ticks_ns if ticks else None
        one = clock.observe(frame.id, stamp_ns, frame.arrival_ns, frame.exposure_ns, period_ns)
        told.append((one, one.raw_ns - frame.middle_ns))
    return told


def errors(told: list[tuple[Exposure, int]]) -> list[int]:
    return [error for _, error in told]


@given(
    st.lists(st.tuples(st.integers(1, 10**8), st.integers(-(10**9), 10**9)), min_size=1, max_size=60),
    st.integers(0, 10**9),
)
def test_the_line_is_under_every_point_of_its_window(points: list[tuple[int, int]], drift: int) -> None:
    envelope = LowerEnvelope(window=10**12, chunks=5, drift_ppt=drift, drift_sigma_ppt=10**8)
    x, added = 0, []
    for step, y in points:
        x += step
        envelope.add(x, y)
        added.append((x, y))
        line = envelope.line()
        assert all(line.at(x) <= y for x, y in added)
        assert any(line.at(x) >= y - 1 for x, y in added)


@given(st.integers(-(10**8), 10**8), st.integers(-(10**15), 10**15))
def test_points_without_delay_give_their_line_back(drift_ppt: int, offset: int) -> None:
    envelope = LowerEnvelope(window=60 * SECOND_NS, chunks=10, drift_ppt=0, drift_sigma_ppt=10**8)
    for number in range(500):
        x = number * 20 * MS_NS
        envelope.add(x, offset + x * drift_ppt // 10**12)
    assert abs(envelope.line().at(x) - (offset + x * drift_ppt // 10**12)) <= 2


def test_jitter_of_arrival_is_taken_out() -> None:
    assert frame_jitter_us(120) <= 20
    assert max(abs(error) for error in frame_errors_ns(CAMERA, 120)[500:]) < 100_000


def test_a_crystal_that_wanders_is_followed() -> None:
    assert frame_jitter_us(180, camera=replace(CAMERA, wander_ppm_per_minute=1.0)) <= 20


@pytest.mark.parametrize("event", ["exposure_start", "exposure_end", "transfer_end"])
def test_whatever_the_stamp_tells_the_middle_of_the_exposure_comes_out(event: str) -> None:
    camera = replace(CAMERA, event=event)
    errors_ns = frame_errors_ns(camera, 60)[500:]
    assert abs(sum(errors_ns) / len(errors_ns)) < 50_000


def test_a_stamp_of_the_end_of_transfer_bears_jitter_that_the_ids_take_out() -> None:
    camera = replace(CAMERA, event="transfer_end", transfer_jitter_ns=2 * MS_NS)
    assert rms_ns(frame_errors_ns(camera, 120)[500:]) < 40_000


def test_without_ticks_the_ids_do_as_a_clock() -> None:
    frames = list(CAMERA.frames(3000, START_NS))
    assert rms_ns(errors(observed(frames, ticks=False, period_ns=20 * MS_NS))[1000:]) < 30_000
    assert rms_ns(errors(observed(frames, ticks=False))[1000:]) < 100_000


def test_exposure_is_never_after_the_arrival_and_goes_forward() -> None:
    told = observed(CAMERA.frames(2000, START_NS))
    frames = list(CAMERA.frames(2000, START_NS))
    middles = [one.raw_ns for one, _ in told]
    assert all(one.raw_ns < frame.arrival_ns for (one, _), frame in zip(told, frames, strict=True))
    assert middles == sorted(set(middles))


def test_sigma_is_what_the_errors_are() -> None:
    told = observed(CAMERA.frames(6000, START_NS))
    for begin, end in ((0, 50), (50, 500), (500, 3000), (3000, 6000)):
        inside = [abs(error) <= 3 * one.sigma_ns for one, error in told[begin:end]]
        assert sum(inside) / len(inside) > 0.95


def test_a_late_frame_is_late_and_nothing_is_skipped() -> None:
    """Held up by 50 ms on its way, as long as two and a half periods."""
    frames = list(CAMERA.frames(1000, START_NS))
    frames[700] = replace(frames[700], arrival_ns=frames[700].arrival_ns + 50 * MS_NS)
    told = observed(frames)
    assert all(one.skipped == 0 for one, _ in told)
    assert told[700][0].latency_ns > 45 * MS_NS
    assert abs(told[700][1]) < 100_000


def test_an_image_that_the_camera_left_out_is_skipped_and_nothing_is_late() -> None:
    """Its ids go on, its ticks jump."""
    frames = [replace(frame, id=frame.id - (frame.id > 700)) for frame in CAMERA.frames(1000, START_NS)]
    del frames[700]
    told = observed(frames)
    assert [index for index, (one, _) in enumerate(told) if one.skipped] == [700]
    assert told[700][0].skipped == 1
    assert told[700][0].latency_ns < 7 * MS_NS


def test_images_lost_on_the_way_are_neither_late_nor_skipped() -> None:
    """Their ids are missing: the ledger tells of them."""
    frames = [frame for frame in CAMERA.frames(1000, START_NS) if not 600 <= frame.id < 640]
    told = observed(frames)
    assert all(one.skipped == 0 and one.latency_ns < 10 * MS_NS for one, _ in told[100:])
    assert rms_ns(errors(told)[500:]) < 40_000


def test_a_camera_whose_ticks_begin_anew_is_known_again() -> None:
    frames = list(CAMERA.frames(3000, START_NS))
    again = [replace(frame, ticks_ns=frame.ticks_ns - frames[2000].ticks_ns) for frame in frames[2000:]]
    told = observed(frames[:2000] + again)
    assert [index for index, (one, _) in enumerate(told) if one.restarted] == [0, 2000]
    assert rms_ns(errors(told)[2500:]) < 40_000
    assert max(abs(error) for error in errors(told)[2000:]) < 8 * MS_NS


@pytest.mark.parametrize("jump_ns", [-SECOND_NS // 3, SECOND_NS // 3, 3600 * SECOND_NS])
def test_a_camera_whose_clock_jumps_is_known_again(jump_ns: int) -> None:
    frames = list(CAMERA.frames(3000, START_NS))
    frames[1500:] = [replace(frame, ticks_ns=frame.ticks_ns + jump_ns) for frame in frames[1500:]]
    told = observed(frames)
    assert sum(one.restarted for one, _ in told) == 2
    assert rms_ns(errors(told)[2400:]) < 60_000


def test_one_wrong_tick_moves_no_other_frame() -> None:
    frames = list(CAMERA.frames(2000, START_NS))
    right = errors(observed(frames))
    frames[1000] = replace(frames[1000], ticks_ns=frames[1000].ticks_ns + 15 * MS_NS)
    wrong = errors(observed(frames))
    changed = [abs(a - b) for a, b in zip(right, wrong, strict=True)]
    assert max(changed[:1000] + changed[1001:]) < 50_000
    assert changed[1000] < 20 * MS_NS


def test_a_counter_that_wraps_goes_on() -> None:
    wrap_ns = 2**32 * 100 // 50
    frames = [replace(frame, ticks_ns=frame.ticks_ns % wrap_ns) for frame in CAMERA.frames(3000, START_NS)]
    assert any(later.ticks_ns < former.ticks_ns for former, later in pairwise(frames))
    told = observed(frames, replace(TOLD, wrap_ns=wrap_ns))
    assert sum(one.restarted for one, _ in told) == 1
    assert rms_ns(errors(told)[500:]) < 20_000


def test_the_time_of_a_file_is_the_frames_own() -> None:
    settings = CameraClockSettings.of(CameraSection(source="ride.mp4"))
    clock = CameraClock(settings)
    for number in range(200):
        media_ns = number * 40 * MS_NS
        told = clock.observe(number, media_ns, START_NS + media_ns, None, 40 * MS_NS)
        assert told.raw_ns == START_NS + media_ns


def test_an_exposure_that_nobody_knows_widens_sigma_by_what_it_may_be() -> None:
    clock = CameraClock(TOLD)
    for frame in CAMERA.frames(1000, START_NS):
        told = clock.observe(frame.id, frame.ticks_ns, frame.arrival_ns, None, 20 * MS_NS)
    assert 5 * MS_NS < told.sigma_ns < 10 * MS_NS


def test_a_frame_costs_little() -> None:
    frames = list(CAMERA.frames(5000, START_NS))
    clock = CameraClock(TOLD)
    began = time.process_time()
    for frame in frames:
        clock.observe(frame.id, frame.ticks_ns, frame.arrival_ns, frame.exposure_ns)
    assert (time.process_time() - began) / len(frames) < 100e-6  # some 10 us on an idle machine


@pytest.mark.parametrize(
    "key", [{"stamp_event": "exposure_start"}, {"transfer_us": 5}, {"stamp_wrap_s": 2.0}]
)
def test_what_tells_of_a_cameras_stamps_cannot_be_set_for_a_file(key: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="cannot be set for a file"):
        CameraSection.model_validate({"source": "ride.mp4"} | key)
    assert CameraClockSettings.of(CameraSection.model_validate({"source": "genicam://"} | key))
