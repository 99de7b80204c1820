"""The folders of drives: their names and numbers."""

import re
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from recorder.storage.faults import storage_error
from recorder.storage.segment_file import sync_folder

_DRIVE = re.compile(r"^(\d{4,})(?:-\d{8}T\d{6}Z)?$")
_SEGMENT = re.compile(r"^(\d{4,})\.mcap$")


def drive_name(number: int, utc_ns: int | None) -> str:
    """Such as 0007-20261121T013300Z, or 0007 while UTC is not known."""
    if utc_ns is None:
        return f"{number:04d}"
    return f"{number:04d}-{datetime.fromtimestamp(utc_ns // 1_000_000_000, UTC):%Y%m%dT%H%M%SZ}"


RETIMED = "retimed.mcap"
"""Beside the segments: the times of the drive, solved again."""


def segment_name(number: int) -> str:
    return f"{number:04d}.mcap"


def segment_number(path: Path) -> int | None:
    """The number that a segment's name tells; None if it is no segment's name."""
    match = _SEGMENT.match(path.name)
    return int(match[1]) if match else None


def drives_in(folder: Path) -> Iterator[tuple[int, Path]]:
    """The numbers and paths of the drives in a folder. Raises OSError."""
    for path in folder.iterdir():
        match = _DRIVE.match(path.name)
        if match:
            yield int(match[1]), path


def create_drive_folder(out: Path, utc_ns: int | None) -> Path:
    """Make the folder of the next drive in ``out``, which is made if it is missing.

    mkdir decides between two writers: the one that comes second takes the next number.
    Raises `StorageError`.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        number = 1 + max((number for number, _ in drives_in(out)), default=0)
        while (path := _claim(out, number, utc_ns)) is None:
            number += 1
        sync_folder(out)
    except OSError as error:
        raise storage_error(error, out) from error
    return path.resolve()


def _claim(out: Path, number: int, utc_ns: int | None) -> Path | None:
    """Make the folder of drive ``number``; None if another writer has that number."""
    path = out / drive_name(number, utc_ns)
    try:
        path.mkdir()
    except FileExistsError:
        return None
    rivals = [other for taken, other in drives_in(out) if taken == number and other != path]
    if any(rival.name < path.name for rival in rivals):  # both see both: the first by name stays
        path.rmdir()
        return None
    return path
