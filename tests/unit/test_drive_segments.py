"""Rotation, and drives of which segments are missing or strange."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from recorder.errors import DriveError
from recorder.samples import ClockPair
from recorder.storage import DriveWriter, head, open_drive, verify
from tests.unit.drive_maker import HEAD, PERIOD_NS, frame, frames, make_drive, pixels, raw_ns, settings

PER_SEGMENT = -(-1_000_000_000 // PERIOD_NS)
"""Frames in a segment of one second."""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Three segments."""
    return make_drive(tmp_path, frames(3 * PER_SEGMENT), segment_seconds=1, sync_every=20)


def test_segments_are_cut_by_time(path: Path) -> None:
    assert sorted(file.name for file in path.iterdir()) == ["0000.mcap", "0001.mcap", "0002.mcap"]
    with open_drive(path) as drive:
        assert [segment.messages for segment in drive.segments] == [PER_SEGMENT] * 3
        assert [segment.end_reason for segment in drive.segments] == ["continued", "continued", "closed"]
        assert [one.id for one in drive.frames()] == list(range(3 * PER_SEGMENT))
        assert verify(drive).ok


def test_segments_are_cut_by_size(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, 300_000, dtype=np.uint8).tobytes()
    with DriveWriter(settings(tmp_path, segment_bytes=1 << 20), HEAD) as writer:
        for number in range(8):
            writer.write(replace(frame(number), data=image))
    sizes = [file.stat().st_size for file in sorted(writer.path.iterdir())]
    assert len(sizes) == 3
    assert max(sizes) < (1 << 20) + 20_000


def test_each_segment_can_be_read_alone(path: Path) -> None:
    for number in range(3):
        with open_drive(path / f"000{number}.mcap") as drive:
            assert drive.problems == []
            assert drive.config == {"storage": {"out": "somewhere"}}
            first = drive.frames("front")[0]
            assert first.id == number * PER_SEGMENT
            assert np.array_equal(first.pixels, pixels(first.id))
            assert verify(drive).ok


def test_a_later_segment_knows_devices_and_clock_pairs(tmp_path: Path) -> None:
    with DriveWriter(settings(tmp_path, segment_seconds=1), HEAD) as writer:
        writer.set_devices({"front": {"serial": "late"}})
        for number in range(2 * PER_SEGMENT):
            writer.write(ClockPair(raw_ns(number), 1, 2, 3, number))
    with open_drive(writer.path / "0001.mcap") as drive:
        assert drive.devices == {"front": {"serial": "late"}}
    assert (writer.path / "0001.mcap").read_bytes().count(b'"bracket_ns"') == PER_SEGMENT


def test_the_clock_pair_history_is_bounded() -> None:
    history = head.ClockPairHistory()
    for number in range(10_000):
        history.add(ClockPair(number, 0, 0, 0, 0))
    times = [pair.raw_ns for pair in history.pairs()]
    assert len(times) <= head.CLOCK_PAIRS_MAX
    assert (times[0], times[-1]) == (0, 9999)
    assert len(set(np.diff(times[:-1]))) == 1


@pytest.mark.parametrize(
    ("lost", "words"),
    [(0, "0000.mcap: missing"), (1, "0001.mcap: missing"), (2, "says that the drive goes on")],
)
def test_a_missing_segment_is_told(path: Path, lost: int, words: str) -> None:
    (path / f"000{lost}.mcap").unlink()
    with open_drive(path) as drive:
        assert any(words in problem for problem in drive.problems)
        kept = [one for one in range(3 * PER_SEGMENT) if one // PER_SEGMENT != lost]
        assert [one.id for one in drive.frames()] == kept
        told = verify(drive)
    assert not told.ok
    assert told.frames == 2 * PER_SEGMENT
    assert told.unaccounted == (0 if lost == 2 else PER_SEGMENT)


def test_two_drives_mixed_are_told(tmp_path: Path, path: Path) -> None:
    other = make_drive(tmp_path, frames(PER_SEGMENT))
    shutil.copy(other / "0000.mcap", path / "0003.mcap")
    with open_drive(path) as drive:
        assert any("0003.mcap: belongs to drive '0002" in problem for problem in drive.problems)
        assert not verify(drive).ok


def test_a_newer_format_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(head, "FORMAT_VERSION", 2)
    path = make_drive(tmp_path, frames(3))
    monkeypatch.setattr(head, "FORMAT_VERSION", 1)
    with pytest.raises(DriveError, match=r"newer recorder \(format 2\).*update"):
        open_drive(path)


def test_numbers_go_on_and_are_not_shared(tmp_path: Path) -> None:
    (tmp_path / "0041-20200101T000000Z").mkdir()
    (tmp_path / "notes").mkdir()
    first = DriveWriter(settings(tmp_path), HEAD)
    second = DriveWriter(settings(tmp_path), HEAD)
    first.close()
    second.close()
    assert [first.path.name[:4], second.path.name[:4]] == ["0042", "0043"]
    unknown = head.DriveHead("{}", 0, 0)
    with DriveWriter(settings(tmp_path), unknown) as third:
        pass
    assert third.path.name == "0044"
    with open_drive(third.path) as drive:
        assert not drive.topics
        assert verify(drive).ok
