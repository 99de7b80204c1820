"""Writes a drive: numbered segments, forced to disk when asked, rotated by time and size."""

import os
import shutil
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from recorder.clock import SYSTEM_CLOCK, Clock
from recorder.config import StorageSection
from recorder.errors import StorageError
from recorder.samples import ClockPair, EncodedFrame, Record, Scan
from recorder.storage import head as heads
from recorder.storage.faults import storage_error
from recorder.storage.folder import create_drive_folder, segment_name
from recorder.storage.head import ClockPairHistory, DriveHead
from recorder.storage.messages import KINDS, Times, raw_ns_of
from recorder.storage.segment_file import Create, SegmentFile, create_file, sync_folder
from recorder.storage.segment_writer import SegmentWriter

FREE_CHECK_NS = 1_000_000_000
"""The free space is asked for no more often than this."""


def free_bytes(path: Path) -> int:
    """What an ordinary user may still write where ``path`` is. Raises OSError."""
    return shutil.disk_usage(path).free


class DriveWriter:
    """One drive being written. One thread calls it; every call may wait for the disk.

    Making one creates the drive's folder and its first segment. All methods but `close` raise
    `StorageError` if the target is full, read-only or broken. After that the writer takes no more,
    `close` still works, and what is on disk is a drive that can be read.

    Args:
        settings: the folder of the drives and how they are cut.
        head: what every segment tells of the drive.
        clock: for the free-space interval, and for samples that carry no time.
        fdatasync: how written data is forced to disk.
        free_bytes: asked for the free space at a path, at most once a second.
        create: how a segment's file is made.
    """

    def __init__(
        self,
        settings: StorageSection,
        head: DriveHead,
        *,
        clock: Clock = SYSTEM_CLOCK,
        fdatasync: Callable[[int], None] = os.fdatasync,
        free_bytes: Callable[[Path], int] = free_bytes,
        create: Create = create_file,
    ) -> None:
        self._settings, self._head, self._clock = settings, head, clock
        self._fdatasync, self._free_bytes, self._create = fdatasync, free_bytes, create
        self._devices: Mapping[str, Mapping[str, str]] = dict(head.devices)
        self._history = ClockPairHistory()
        self._counts: Counter[str] = Counter()
        self._latest_raw_ns = head.start_raw_ns
        self._durable_raw_ns = head.start_raw_ns
        self._free_checked_ns: int | None = None
        self._number = 0
        self._closed = False
        self._failed = False
        self._file: SegmentFile | None = None
        self._segment_ns = round(settings.segment_seconds * 1_000_000_000)
        self._path = settings.out
        try:
            settings.out.mkdir(parents=True, exist_ok=True)
            self._check_space()
            self._path = create_drive_folder(settings.out, head.utc_ns)
            self._segment = self._open_segment()
        except OSError as error:
            self._abandon()
            self._remove_stillborn()
            raise storage_error(error, self._path) from error

    @property
    def path(self) -> Path:
        """The drive's folder, absolute."""
        return self._path

    @property
    def durable_raw_ns(self) -> int:
        """The latest raw time on disk: every record given up to the one that bears it is durable.
        Begins at the drive's start; clock pairs and health move it where no device speaks."""
        return self._durable_raw_ns

    @property
    def counts(self) -> Mapping[str, int]:
        """Messages given so far, by topic."""
        return dict(self._counts)

    @property
    def segments(self) -> int:
        """Segments begun so far."""
        return self._number

    def write(self, record: Record) -> None:
        """Append one record. It is durable after the next `sync`."""
        self._check_usable()
        try:
            self._check_space()
            self._append(record)
        except OSError as error:
            raise self._fail(error) from error

    def sync(self) -> None:
        """Force all that was given to disk and move the durable mark."""
        self._check_usable()
        try:
            self._segment.flush()
            self._fdatasync(self._segment.file.fileno())
        except OSError as error:
            raise self._fail(error) from error
        self._durable_raw_ns = self._latest_raw_ns

    def set_devices(self, devices: Mapping[str, Mapping[str, str]]) -> None:
        """What became known of the devices meanwhile: told now, and at the head of later segments."""
        self._check_usable()
        self._devices = dict(devices)
        try:
            self._segment.metadata(heads.DEVICES, heads.devices_record(self._devices))
        except OSError as error:
            raise self._fail(error) from error

    def close(self) -> None:
        """End the drive. Raises nothing if the disk failed before; a second call does nothing."""
        if self._closed:
            return
        self._closed = True
        if self._failed:
            self._abandon()
            return
        try:
            self._end_segment("closed")
        except OSError as error:
            failure = self._fail(error)
            self._abandon()
            raise failure from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _append(self, record: Record) -> None:
        kind = KINDS[type(record)]
        topic = kind.topic(record)
        raw_ns = self._raw_ns(record)
        log_time_ns = raw_ns + self._head.log_offset_ns
        data = kind.encode(record, Times(log_time_ns, self._head.log_offset_ns))
        if self._is_segment_full(log_time_ns, len(data)):
            self._end_segment("continued")
            self._segment = self._open_segment()
        numbered = isinstance(record, (EncodedFrame, Scan))
        sequence = record.id if numbered else self._counts[topic]  # type: ignore[union-attr]
        self._segment.message(kind, topic, data, log_time_ns, sequence & 0xFFFF_FFFF)
        self._counts[topic] += 1
        self._latest_raw_ns = max(self._latest_raw_ns, raw_ns)
        if isinstance(record, ClockPair):
            self._history.add(record)

    def _raw_ns(self, record: Record) -> int:
        """When the record is said to have been: its own raw time, else the latest of the drive."""
        raw_ns = raw_ns_of(record)
        return self._latest_raw_ns if raw_ns is None else raw_ns

    def _is_segment_full(self, log_time_ns: int, added: int) -> bool:
        first = self._segment.first_log_time_ns
        if first is None:
            return False
        too_long = log_time_ns - first >= self._segment_ns
        return too_long or self._segment.size_bytes + added > self._settings.segment_bytes

    def _open_segment(self) -> SegmentWriter:
        self._file = SegmentFile(self._path / segment_name(self._number), self._create)
        segment = SegmentWriter(self._file)
        head = self._head
        segment.metadata(heads.DRIVE, heads.drive_record(head, drive=self._path.name, segment=self._number))
        segment.metadata(heads.CONFIG, heads.config_record(head))
        segment.metadata(heads.VERSIONS, heads.sealed(heads.VERSIONS, head.versions))
        segment.metadata(heads.DEVICES, heads.devices_record(self._devices))
        pairs = self._history.to_json(head.log_offset_ns)
        log_time_ns = self._latest_raw_ns + head.log_offset_ns
        segment.attachment(heads.CLOCK_PAIRS, "application/json", pairs, log_time_ns)
        self._fdatasync(self._file.fileno())
        sync_folder(self._path)
        self._number += 1
        return segment

    def _end_segment(self, reason: str) -> None:
        """Everything in the segment is on disk afterwards."""
        segment = self._segment
        segment.flush()
        segment.metadata(heads.END, heads.end_record(reason, self._counts))
        segment.finish()
        self._fdatasync(segment.file.fileno())
        segment.file.close()
        self._file = None
        sync_folder(self._path)
        self._durable_raw_ns = self._latest_raw_ns

    def _check_space(self) -> None:
        now = self._clock.raw_ns()
        if self._free_checked_ns is not None and now - self._free_checked_ns < FREE_CHECK_NS:
            return
        free, reserve = self._free_bytes(self._path), self._settings.reserve_bytes
        if free < reserve:
            self._free_checked_ns = None  # ask again at the next record
            raise StorageError(
                f"full: {free >> 20} MiB free, of which {reserve >> 20} MiB are kept in reserve",
                where=str(self._path),
                todo="free some space, choose another place or lower storage.reserve_bytes",
            )
        self._free_checked_ns = now

    def _check_usable(self) -> None:
        if self._closed or self._failed:
            what = "closed" if self._closed else "no longer written, the disk failed"
            raise StorageError(what, where=str(self._path), todo="begin a new drive")

    def _fail(self, error: OSError) -> StorageError:
        self._failed = True
        return storage_error(error, self._path)

    def _abandon(self) -> None:
        """Let go of the segment as it stands."""
        if self._file is not None:
            with suppress(OSError):
                self._file.close()
            self._file = None

    def _remove_stillborn(self) -> None:
        """Leave no folder behind that looks like a drive and holds nothing."""
        if self._path != self._settings.out:
            with suppress(OSError):
                (self._path / segment_name(0)).unlink(missing_ok=True)
                self._path.rmdir()
