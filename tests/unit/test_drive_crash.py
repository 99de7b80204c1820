"""Segments that nobody closed, and segments that were cut."""

from pathlib import Path

import numpy as np
import pytest

from recorder.errors import DriveError
from recorder.samples import NmeaSentence, Record, Stamp
from recorder.storage import DriveWriter, inspect, open_drive, verify
from tests.unit.drive_maker import HEAD, frame, frames, make_drive, pixels, raw_ns, settings


def test_what_was_synced_is_readable_before_the_end(tmp_path: Path) -> None:
    writer = DriveWriter(settings(tmp_path), HEAD)
    assert writer.durable_raw_ns == HEAD.start_raw_ns
    for number in range(10):
        writer.write(frame(number))
    writer.sync()
    assert writer.durable_raw_ns == raw_ns(9)
    writer.write(frame(10))
    assert writer.durable_raw_ns == raw_ns(9)
    with open_drive(writer.path) as drive:
        assert "not closed properly" in drive.problems[0]
        assert [one.id for one in drive.frames()] == list(range(10))
        assert drive.config == {"storage": {"out": "somewhere"}}
        assert not verify(drive).ok
        assert not inspect(drive).segments[0].closed
    writer.close()
    assert writer.durable_raw_ns == raw_ns(10)
    with open_drive(writer.path) as drive:
        assert verify(drive).ok


@pytest.mark.parametrize("tenth", range(10))
@pytest.mark.parametrize("sync_every", [3, 1000])
def test_frames_before_a_cut_are_exact(tmp_path: Path, tenth: int, sync_every: int) -> None:
    recorded = frames(40)
    path = make_drive(tmp_path, recorded, sync_every=sync_every)
    segment = path / "0000.mcap"
    whole = segment.read_bytes()
    kept = whole[: len(whole) * tenth // 10]
    segment.write_bytes(kept)
    if not kept:
        with pytest.raises(DriveError, match="empty"):
            open_drive(path)
        return
    before = [one.id for one in recorded if one.data in kept]
    with open_drive(path) as drive:
        assert drive.problems
        found = drive.frames()
        assert [one.id for one in found] == before
        assert all(np.array_equal(one.pixels, pixels(one.id)) for one in found)
        told = verify(drive)
    assert not told.ok
    assert told.frames == len(before)


def test_a_cut_at_every_byte_is_survived(tmp_path: Path) -> None:
    recorded: list[Record] = [frame(0), frame(1), NmeaSentence(Stamp(raw_ns=raw_ns(1)), b"$GPRMC")]
    path = make_drive(tmp_path, recorded, sync_every=2)
    segment = path / "0000.mcap"
    whole = segment.read_bytes()
    for length in range(len(whole) - 1, 0, -37):
        segment.write_bytes(whole[:length])
        try:
            with open_drive(path) as drive:
                assert drive.problems
                assert all(np.array_equal(one.pixels, pixels(one.id)) for one in drive.frames())
        except DriveError:
            assert length < 200


def test_a_torn_tail_of_zeros_is_told(tmp_path: Path) -> None:
    path = make_drive(tmp_path, frames(20), sync_every=2)
    segment = path / "0000.mcap"
    whole = bytearray(segment.read_bytes())
    half = len(whole) // 2
    segment.write_bytes(bytes(whole[:half]) + bytes(4096))
    with open_drive(path) as drive:
        found = [one.id for one in drive.frames()]
        assert found == list(range(len(found)))
        assert len(found) > 5
        assert all(np.array_equal(one.pixels, pixels(one.id)) for one in drive.frames()[:-1])
        told = verify(drive)
    assert not told.ok


def test_a_damaged_index_costs_nothing(tmp_path: Path) -> None:
    """The chunk itself is read where its message index is damaged."""
    path = make_drive(tmp_path, frames(20), sync_every=5)
    segment = path / "0000.mcap"
    data = bytearray(segment.read_bytes())
    index = data.index(b"\x07\x56\x00\x00\x00\x00\x00\x00\x00\x01\x00\x50")
    data[index + 11] ^= 0x20
    segment.write_bytes(data)
    with open_drive(path) as drive:
        assert [one.id for one in drive.frames()] == list(range(20))
        assert "message index" in drive.problems[0]
        assert not verify(drive).ok
