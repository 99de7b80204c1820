"""The time of a whole drive solved again: beside what was recorded, better, and whole or not there."""

import hashlib
import json
import os
from collections.abc import Iterator
from pathlib import Path
from random import Random

import cv2
import numpy as np
import pytest

from recorder.cli.app import main
from recorder.codec import encode
from recorder.config import StorageSection, parse
from recorder.errors import RecorderError, StorageError, UsageError
from recorder.samples import CameraSettings, ClockPair, EncodedFrame, Fix, Record, Stamp, UtcTime
from recorder.simulation.clocks import SimulatedCamera
from recorder.storage import DriveHead, DriveWriter, export, inspect, open_drive, retime, verify

SECOND_NS = 1_000_000_000
MS_NS = 1_000_000
DAY_NS = 86_400 * SECOND_NS
START_NS = 1000 * SECOND_NS
UTC_NS = 1_795_224_780 * SECOND_NS
OFFSET_NS = UTC_NS - START_NS - 300 * MS_NS
SECONDS = 90
DRIFT_PPM = 12
OUTAGE = range(40, 60)
STEP_AT = 30
CAMERA = SimulatedCamera(rate_hz=10)
CONFIG = parse(
    {
        "drivers": {
            "camera": {"front": {"source": "genicam://", "transfer_us": 1000}},
            "gnss": {"source": "x"},
        },
        "timebase": {"gnss_delay_ms": 600, "gnss_delay_sigma_ms": 10},
    },
    where="test",
)
HEAD = DriveHead(CONFIG.to_json(), log_offset_ns=OFFSET_NS, start_raw_ns=START_NS)


def true_utc_ns(raw_ns: int) -> int:
    since_ns = raw_ns - START_NS
    return UTC_NS + since_ns + since_ns * DRIFT_PPM // 1_000_000


def recorded(*, fixes: bool = True) -> Iterator[Record]:
    """A drive with an outage in the middle and a wall clock that is set, in order of time."""
    random = Random(5)
    records: list[tuple[int, Record]] = []
    image = encode(np.zeros((4, 8), np.uint16), bit_depth=10)
    for frame in CAMERA.frames(CAMERA.rate_hz * (SECONDS - 1), START_NS):
        stamp = Stamp(
            frame.arrival_ns, device_ns=frame.ticks_ns, utc_ns=true_utc_ns(frame.arrival_ns) + MS_NS
        )
        settings = CameraSettings("Mono10", exposure_us=frame.exposure_ns / 1000, rate_hz=CAMERA.rate_hz)
        records.append((frame.arrival_ns, EncodedFrame("front", frame.id, stamp, 8, 4, 10, settings, image)))
    for second in range(SECONDS):
        raw_ns = START_NS + second * SECOND_NS
        wall_ns = OFFSET_NS + (DAY_NS if second >= STEP_AT else 0)
        pair = ClockPair(raw_ns, raw_ns, raw_ns + wall_ns, raw_ns, 300, stepped=second == STEP_AT)
        records.append((raw_ns, pair))
        if fixes and second not in OUTAGE:
            arrival_ns = raw_ns + random.randint(0, 40 * MS_NS)
            gps_ns = true_utc_ns(raw_ns) - 600 * MS_NS
            stamp = Stamp(arrival_ns, gps_ns=gps_ns, gps_raw_ns=arrival_ns)
            records.append((arrival_ns, Fix(stamp, valid=True, mode="A/A/1")))
            online = UtcTime(arrival_ns, true_utc_ns(arrival_ns) + 200 * MS_NS, 300 * MS_NS, "gnss")
            records.append((arrival_ns, online))
    return (record for _, record in sorted(records, key=lambda one: one[0]))


def made(out: Path, records: Iterator[Record], *, close: bool = True) -> Path:
    storage = StorageSection(out=out, reserve_bytes=0, segment_seconds=30)
    writer = DriveWriter(storage, HEAD)
    for record in records:
        writer.write(record)
    writer.sync()
    if close:
        writer.close()
    else:
        writer._abandon()  # as a power cut leaves it
    return writer.path


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return made(tmp_path, recorded())


def hashes(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.iterdir()}


def test_nothing_that_was_recorded_is_altered_and_the_drive_stays_sound(drive: Path) -> None:
    before = hashes(drive)
    with open_drive(drive) as opened:
        stamps = [frame.stamp for frame in opened.frames("front")]
        retime(opened)
    assert {name: told for name, told in hashes(drive).items() if name != "retimed.mcap"} == before
    with open_drive(drive) as opened:
        assert opened.problems == []
        assert verify(opened).ok
        assert [frame.stamp for frame in opened.frames("front")] == stamps
        assert {"/time/utc", "/time/solved", "/camera/front/time", "/clock/pairs"} <= opened.topics.keys()
        assert opened.log_offset_ns == OFFSET_NS
        assert opened.config == json.loads(CONFIG.to_json())


def test_the_solved_time_is_nearer_to_the_truth_than_the_recorded_also_in_an_outage(drive: Path) -> None:
    with open_drive(drive) as opened:
        recorded_ns = opened.utc(START_NS + 50 * SECOND_NS)
        retime(opened)
    with open_drive(drive) as opened:
        for second in range(0, SECONDS - 1, 5):
            raw_ns = START_NS + second * SECOND_NS + 123
            told = opened.utc(raw_ns)
            assert told is not None
            assert abs(told.utc_ns - true_utc_ns(raw_ns)) < 60 * MS_NS
            low_ns, high_ns = told.interval_ns
            assert low_ns <= true_utc_ns(raw_ns) <= high_ns
    assert recorded_ns is not None
    assert abs(recorded_ns.utc_ns - true_utc_ns(START_NS + 50 * SECOND_NS)) > 150 * MS_NS


def test_every_frame_gets_the_middle_of_its_exposure_by_the_frames_before_and_after(drive: Path) -> None:
    with open_drive(drive) as opened:
        told = retime(opened)
    frames = list(CAMERA.frames(CAMERA.rate_hz * (SECONDS - 1), START_NS))
    assert told.frames == {"front": len(frames)}
    assert told.largest_change_ns is not None
    assert told.largest_change_ns > MS_NS
    with open_drive(drive) as opened:
        times = [message.sample for message in opened.messages("/camera/front/time")]
        solved = list(opened.messages("/time/solved"))
    assert [time.id for time in times] == [frame.id for frame in frames]  # type: ignore[union-attr]
    assert [time.raw_ns for time in times] == [frame.arrival_ns for frame in frames]  # type: ignore[union-attr]
    errors_ns = [
        abs(time.exposure_raw_ns - frame.middle_ns)  # type: ignore[union-attr]
        for time, frame in zip(times, frames, strict=True)
    ]
    assert max(errors_ns) < 200_000  # at 10 Hz; from the very first frame on
    assert SECONDS <= len(solved) <= SECONDS + 1


def test_solving_again_replaces_the_result_and_gives_the_same(drive: Path) -> None:
    for _ in range(2):
        with open_drive(drive) as opened:
            retime(opened)
        first = hashes(drive)
        with open_drive(drive) as opened:
            retime(opened)
        assert hashes(drive) == first
    assert sorted(path.name for path in drive.iterdir()) == [
        *(f"{number:04d}.mcap" for number in range(3)),
        "retimed.mcap",
    ]


def test_a_result_that_cannot_be_written_leaves_the_old_one(
    drive: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with open_drive(drive) as opened:
        retime(opened)
        before = hashes(drive)

        def full(_fd: int) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(os, "fdatasync", full)
        with pytest.raises(StorageError):
            retime(opened)
    assert hashes(drive) == before


def test_the_result_can_be_exported(drive: Path, tmp_path: Path) -> None:
    with open_drive(drive) as opened:
        retime(opened)
    with open_drive(drive) as opened:
        rows = export(opened, "/camera/front/time", "csv", tmp_path / "front.csv")
        assert rows == CAMERA.rate_hz * (SECONDS - 1)
        assert export(opened, "/time/solved", "csv", tmp_path / "time.csv") >= SECONDS
    assert "exposure_raw_ns" in (tmp_path / "front.csv").read_text().splitlines()[0]


def test_another_drives_result_is_left_out_and_stated(drive: Path, tmp_path: Path) -> None:
    with open_drive(drive) as opened:
        retime(opened)
    made(tmp_path / "other", recorded())
    other = made(tmp_path / "other", recorded())  # drive 0002
    (other / "retimed.mcap").write_bytes((drive / "retimed.mcap").read_bytes())
    with open_drive(other) as opened:
        assert any("belongs to drive" in line for line in opened.problems)
        assert "/time/solved" not in opened.topics
    (drive / "retimed.mcap").write_bytes(
        b"no MCAP file at all, and long enough to be one, if it only were" * 3
    )
    with open_drive(drive) as opened:
        assert any("retimed.mcap" in line for line in opened.problems)
        assert "/time/solved" not in opened.topics
        assert len(opened.frames("front")) == CAMERA.rate_hz * (SECONDS - 1)


def test_a_drive_without_a_valid_fix_stays_as_it_is(tmp_path: Path) -> None:
    path = made(tmp_path, recorded(fixes=False))
    with open_drive(path) as opened, pytest.raises(RecorderError, match="no valid fix"):
        retime(opened)
    assert not (path / "retimed.mcap").exists()


def test_one_segment_alone_and_a_foreign_drive_are_bad_input(drive: Path, tmp_path: Path) -> None:
    with open_drive(drive / "0000.mcap") as opened, pytest.raises(UsageError, match="folder"):
        retime(opened)
    from mcap.writer import Writer

    foreign = tmp_path / "foreign"
    foreign.mkdir()
    with (foreign / "0000.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("s", "", b"")
        writer.add_message(writer.register_channel("/t", "", schema), 1, b"x", 1)
        writer.finish()  # type: ignore[no-untyped-call]
    with open_drive(foreign) as opened, pytest.raises(UsageError, match="not recorded by recorder"):
        retime(opened)


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main([str(one) for one in arguments])
    told = capsys.readouterr()
    return int(ended.value.code or 0), told.out, told.err


def test_the_command_says_what_came_of_it(drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = run(capsys, "retime", str(drive))
    assert (code, err) == (0, "")
    assert out.splitlines()[-1] == str(drive / "retimed.mcap")
    code, out, err = run(capsys, "retime", str(drive), "--json")
    told = json.loads(out)
    assert (code, told["fixes"], told["drive"]) == (0, SECONDS - len(OUTAGE), str(drive))


def test_an_unfinished_drive_is_solved_as_far_as_it_goes_and_said_to_be_damaged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = made(tmp_path, recorded(), close=False)
    code, _, err = run(capsys, "retime", str(path))
    assert code == 1
    assert "not closed properly" in err
    assert "solved by what can be read" in err
    assert "Traceback" not in err
    with open_drive(path) as opened:
        assert opened.topics["/camera/front/time"].messages == CAMERA.rate_hz * (SECONDS - 1)


@pytest.mark.parametrize("what", ["nowhere", "segment", "no fix"])
def test_what_cannot_be_solved_is_one_line(
    what: str, drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = {"nowhere": tmp_path / "nowhere", "segment": drive / "0001.mcap"}
    path = paths.get(what) or made(tmp_path / "bare", recorded(fixes=False))
    code, out, err = run(capsys, "retime", str(path))
    assert (code, out) == (1 if what == "no fix" else 2, "")
    assert err.count("\n") == 1
    assert err.startswith("recorder: ")


def test_inspect_tells_source_offset_drift_and_interval_over_the_drive(
    drive: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with open_drive(drive) as opened:
        assert inspect(opened).time_topic == "/time/utc"
        retime(opened)
    code, out, _ = run(capsys, "inspect", str(drive), "--json")
    told = json.loads(out)
    assert code == 0
    assert told["time_topic"] == "/time/solved"
    assert len(told["time"]) >= 12
    for point in told["time"]:
        raw_ns = START_NS + round(point["at_s"] * 1e9)
        offset_ns = true_utc_ns(raw_ns) - raw_ns - OFFSET_NS
        assert abs(point["offset_ns"] - offset_ns) <= point["half_width_ns"]
        assert point["source"]
    middle = told["time"][1:-1]
    assert all(abs(point["drift_ppb"] / 1000 - DRIFT_PPM) < 300 for point in middle)
    assert [round(step["at_s"]) for step in told["clock_steps"]] == [STEP_AT]
    assert told["clock_steps"][0]["by_ns"] == DAY_NS
    code, out, _ = run(capsys, "inspect", str(drive))
    assert "drift, ppm" in out
    assert "the wall clock was set by +86400.000000 s" in out


def test_inspect_draws_a_picture(drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with open_drive(drive) as opened:
        retime(opened)
    out = tmp_path / "time.png"
    code, _, _ = run(capsys, "inspect", str(drive), "--plot", str(out))
    assert code == 0
    picture = cv2.imread(str(out))
    assert picture is not None
    assert picture.shape == (840, 1400, 3)
    colours = {tuple(int(part) for part in colour) for colour in picture.reshape(-1, 3)}
    for colour in ((180, 90, 20), (245, 222, 190), (60, 140, 40), (40, 40, 210), (240, 240, 240)):
        assert colour in colours  # line, interval, fixes, wall clock set, outage
    code, _, err = run(capsys, "inspect", str(drive), "--plot", str(tmp_path / "time.svg"))
    assert (code, err.count("\n")) == (2, 1)
    code, _, err = run(capsys, "inspect", str(drive), "--plot", str(tmp_path / "no" / "time.png"))
    assert (code, err.count("\n")) == (1, 1)


def test_a_drive_without_utc_cannot_be_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = made(tmp_path, recorded(fixes=False))
    code, _, err = run(capsys, "inspect", str(path), "--plot", str(tmp_path / "time.png"))
    assert code == 2
    assert "nothing is known of UTC" in err
