"""Targets that are full, read-only or broken."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from recorder.errors import StorageError
from recorder.storage import DriveWriter, open_drive, verify
from recorder.storage.segment_file import RawFile, create_file
from tests.unit.drive_maker import HEAD, frame, pixels, settings


class Ticking:
    """A clock that goes on by one second at each reading."""

    def __init__(self) -> None:
        self._now = 0

    def raw_ns(self) -> int:
        self._now += 1_000_000_000
        return self._now

    monotonic_ns = realtime_ns = boottime_ns = raw_ns


class FailingFile:
    """A file that takes a number of bytes and then fails."""

    def __init__(self, path: Path, room: int, number: int) -> None:
        self._file = create_file(path)
        self._room, self._number = room, number

    def write(self, data: memoryview) -> int | None:
        taken = self._file.write(data[: max(self._room, 0)])
        self._room -= len(data)
        if self._room < 0:
            raise OSError(self._number, os.strerror(self._number))
        return taken

    def truncate(self, size: int) -> int:
        return self._file.truncate(size)

    def fileno(self) -> int:
        return self._file.fileno()

    def close(self) -> None:
        self._file.close()


def _failing(room: int, number: int) -> Callable[[Path], RawFile]:
    return lambda path: FailingFile(path, room, number)


def _write_for_ever(writer: DriveWriter) -> None:
    for frame_id in range(1000):
        writer.write(frame(frame_id))
        if frame_id % 5 == 0:
            writer.sync()


def test_the_reserve_is_not_eaten(tmp_path: Path) -> None:
    free = [1000, 1000, 1000, 1000, 10, 10, 1000]
    writer = DriveWriter(
        settings(tmp_path, reserve_bytes=100), HEAD, clock=Ticking(), free_bytes=lambda _path: free.pop(0)
    )
    for number in range(3):
        writer.write(frame(number))
    for _ in range(2):
        with pytest.raises(StorageError, match=r"full: 0 MiB free.*free some space"):
            writer.write(frame(3))
    writer.write(frame(3))
    writer.close()
    with open_drive(writer.path) as drive:
        assert [one.id for one in drive.frames()] == [0, 1, 2, 3]
        assert verify(drive).ok


def test_a_full_disk_is_refused_at_once(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="full"):
        DriveWriter(settings(tmp_path / "out", reserve_bytes=1), HEAD, free_bytes=lambda _path: 0)
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENOSPC, "full; free some space"),
        (errno.EROFS, "read-only; remount"),
        (errno.EIO, "input/output error; check the disk"),
        (errno.ESTALE, "cannot be written .*; check the disk"),
    ],
)
@pytest.mark.parametrize("room", [12_000, 16_000, 20_000])
def test_a_write_error_leaves_a_readable_drive(tmp_path: Path, number: int, words: str, room: int) -> None:
    writer = DriveWriter(settings(tmp_path), HEAD, create=_failing(room, number))
    with pytest.raises(StorageError, match=words) as caught:
        _write_for_ever(writer)
    assert str(writer.path) in str(caught.value)
    with pytest.raises(StorageError):
        writer.write(frame(0))
    with pytest.raises(StorageError):
        writer.sync()
    writer.close()
    writer.close()
    with open_drive(writer.path) as drive:
        assert len(drive.problems) == 1, drive.problems
        found = drive.frames()
        assert len(found) > 0
        assert found[-1].stamp.raw_ns == writer.durable_raw_ns
        assert all(np.array_equal(one.pixels, pixels(one.id)) for one in found)
        assert not verify(drive).ok


def test_a_failing_end_is_told_once(tmp_path: Path) -> None:
    synced = 0

    def fdatasync(fd: int) -> None:
        nonlocal synced
        synced += 1
        if synced > 2:
            raise OSError(errno.EIO, "bad")
        os.fdatasync(fd)

    writer = DriveWriter(settings(tmp_path), HEAD, fdatasync=fdatasync)
    writer.write(frame(0))
    writer.sync()
    durable = writer.durable_raw_ns
    writer.write(frame(1))
    with pytest.raises(StorageError, match="input/output"):
        writer.close()
    writer.close()
    assert writer.durable_raw_ns == durable


def test_targets_that_cannot_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(StorageError, match="not a folder; choose a folder"):
        DriveWriter(settings(file), HEAD)
    with pytest.raises(StorageError, match="not a folder; choose a folder"):
        DriveWriter(settings(file / "below"), HEAD)

    def refuse(path: Path, *_: object, **__: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(StorageError, match=r"out: read-only; remount it writable") as caught:
        DriveWriter(settings(tmp_path / "out"), HEAD)
    assert caught.value.exit_code == 1


def test_a_file_that_cannot_be_made_leaves_no_folder(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="full"):
        DriveWriter(settings(tmp_path), HEAD, create=_failing(20, errno.ENOSPC))
    assert list(tmp_path.iterdir()) == []
