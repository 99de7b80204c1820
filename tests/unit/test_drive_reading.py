"""Random access, search by time, foreign files, and what reading must not cost."""

import os
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

import recorder
from recorder.errors import DriveError, UsageError
from recorder.samples import ClockPair, NmeaSentence, Stamp
from recorder.storage import NoFrame, open_drive, verify
from recorder.storage.messages import KINDS, Times
from recorder.storage.schemas import schema_data
from recorder.storage.source import FileSource
from tests.unit.drive_maker import OFFSET_NS, PERIOD_NS, UTC_NS, frame, frames, make_drive, pixels, raw_ns


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return make_drive(tmp_path, frames(20))


def test_frames_are_a_sequence(path: Path) -> None:
    found = recorder.open_drive(path).frames("front")
    assert len(found) == 20
    assert (found[3].id, found[-1].id) == (3, 19)
    assert [one.id for one in found[2:9:3]] == [2, 5, 8]
    assert [one.id for one in reversed(found[:3])] == [2, 1, 0]
    assert found[5:][0].id == 5
    with pytest.raises(IndexError):
        found[20]


def test_frames_are_found_by_raw_time(path: Path) -> None:
    found = open_drive(path).frames("front")
    assert found.at(raw_ns=raw_ns(7)).id == 7
    assert found.at(raw_ns=raw_ns(7) + PERIOD_NS // 2 - 1).id == 7
    assert found.at(raw_ns=raw_ns(7) + PERIOD_NS // 2 + 1).id == 8
    assert found.at(raw_ns=-(10**30)).id == 0
    assert found.at(raw_ns=10**30).id == 19
    assert found[5:10].at(raw_ns=0).id == 5


def test_frames_are_found_by_utc(tmp_path: Path) -> None:
    known = frames(6)
    unknown = [frame(number, utc_ns=None) for number in range(6, 9)]  # type: ignore[arg-type]
    drive = open_drive(make_drive(tmp_path, [*known, *unknown]))
    found = drive.frames("front")
    assert found.at(utc_ns=UTC_NS + raw_ns(4) + 1).id == 4
    assert found.at(utc_ns=UTC_NS + raw_ns(8)).id == 5
    with pytest.raises(NoFrame, match="UTC"):
        found[6:].at(utc_ns=UTC_NS)


def test_a_search_needs_one_time_and_a_frame(path: Path) -> None:
    drive = open_drive(path)
    with pytest.raises(ValueError, match="either"):
        drive.frames().at()
    with pytest.raises(ValueError, match="either"):
        drive.frames().at(raw_ns=1, utc_ns=1)
    with pytest.raises(IndexError, match="no frame here"):
        drive.frames("tag").at(raw_ns=1)
    assert len(drive.frames("tag")) == 0


def test_unknown_names_are_refused(path: Path) -> None:
    drive = open_drive(path)
    with pytest.raises(UsageError, match="cameras here: front"):
        drive.frames("rear")
    with pytest.raises(UsageError, match="topics here: /camera/front/image"):
        drive.messages("/nothing")


def test_two_cameras_come_in_time(tmp_path: Path) -> None:
    both = sorted([*frames(10), *frames(10, camera="tag")], key=lambda one: one.id)
    with open_drive(make_drive(tmp_path, both)) as drive:
        assert drive.cameras == ["front", "tag"]
        assert [(one.camera, one.id) for one in drive.frames()] == [(one.camera, one.id) for one in both]
        for camera in drive.cameras:
            for one in drive.frames(camera):
                assert np.array_equal(one.pixels, pixels(one.id, camera))
        assert verify(drive).ok


def test_other_images_are_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Opening and one access touch a small part of the file."""
    path = make_drive(tmp_path, frames(400), sync_every=10)
    read = 0
    original = FileSource.read

    def counting(self: FileSource, offset: int, length: int) -> bytes:
        nonlocal read
        read += length
        return original(self, offset, length)

    monkeypatch.setattr(FileSource, "read", counting)
    drive = open_drive(path)
    opened_with = read
    read = 0
    assert np.array_equal(drive.frames("front")[250].pixels, pixels(250))
    assert read < 2000
    assert opened_with < drive.segments[0].size_bytes / 4


def test_no_file_stays_open(path: Path) -> None:
    before = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
    drive = open_drive(path)
    found = drive.frames()
    kept = [found[0], found[1]]
    messages = drive.messages("/camera/front/image")
    next(messages)
    assert kept[0].pixels.shape == (12, 16)
    assert len(os.listdir("/proc/self/fd")) == before  # noqa: PTH208
    drive.close()
    with pytest.raises(DriveError, match="closed"):
        _ = kept[0].pixels


def test_memory_does_not_grow_while_iterating(path: Path) -> None:
    found = open_drive(path).frames()

    def go_round() -> None:
        for one in found:
            assert one.pixels.size

    go_round()
    tracemalloc.start()
    try:
        go_round()
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(20):
            go_round()
        assert tracemalloc.get_traced_memory()[0] - before < 20_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("compression", CompressionType)
@pytest.mark.parametrize("chunked", [True, False])
def test_foreign_files_are_read(tmp_path: Path, compression: CompressionType, chunked: bool) -> None:
    """Compressed or without chunks; another schema, another encoding; out of order."""
    file = tmp_path / "foreign.mcap"
    kind = KINDS[ClockPair]
    writer = Writer(str(file), chunk_size=300, compression=compression, use_chunking=chunked)
    writer.start()
    schema = writer.register_schema("recorder.ClockPair", "protobuf", schema_data(kind.message))
    pairs = writer.register_channel("/pairs", "protobuf", schema)
    text = writer.register_channel("/text", "json", 0)
    for number in (2, 0, 1, 3, 4, 5, 6, 7, 8, 9):
        pair = ClockPair(number, 1, 2, 3, 4)
        writer.add_message(pairs, number, kind.encode(pair, Times(0, 0)), number, number)
        writer.add_message(text, number, b"{}", number, number)
    writer.finish()  # type: ignore[no-untyped-call]
    with open_drive(file) as drive:
        assert [message.value.raw_ns for message in drive.messages("/pairs")] == list(range(10))
        assert [message.value for message in drive.messages("/text")] == [b"{}"] * 10
        assert "not recorded by recorder" in drive.problems[-1]
        assert len(drive.frames()) == 0
        assert not verify(drive).ok


def test_paths_that_are_no_drive(tmp_path: Path) -> None:
    drives = tmp_path / "drives"
    make_drive(drives, [NmeaSentence(Stamp(raw_ns=raw_ns(0)), b"x")])
    text = tmp_path / "notes.txt"
    text.write_text("no drive at all, just some text that is long enough to be read as one\n" * 9)
    (tmp_path / "empty").mkdir()
    (tmp_path / "crashed").mkdir()
    (tmp_path / "crashed" / "0000.mcap").touch()
    for place, words in [
        (tmp_path / "missing", "no such drive; give"),
        (tmp_path / "empty", "no segments in it; give"),
        (drives, "it holds drives, the latest is 0001-2026"),
        (text, "not an MCAP file; give"),
        (tmp_path / "crashed", "empty; a crash"),
        (text / "below", "."),
    ]:
        with pytest.raises(DriveError, match=words) as caught:
            open_drive(place)
        assert "\n" not in str(caught.value)


def test_log_time_is_raw_time_and_offset(path: Path) -> None:
    drive = open_drive(path)
    times = [message.log_time_ns for message in drive.messages("/camera/front/image")]
    assert times == [raw_ns(number) + OFFSET_NS for number in range(20)]
    info = drive.topics["/camera/front/image"]
    assert (info.first_ns, info.last_ns, info.messages) == (times[0], times[-1], 20)
    assert info.bytes == sum(len(message.data) for message in drive.messages("/camera/front/image"))
