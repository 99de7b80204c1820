"""Solves the time of a whole drive again, and lays the result beside what was recorded."""

import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from math import isqrt
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from recorder.config import CameraSection, TimebaseSection
from recorder.errors import DriveError, RecorderError, UsageError
from recorder.samples import Fix, FrameTime, PpsEdge, UtcTime
from recorder.storage import head as heads
from recorder.storage.drive import SOLVED_TOPIC, Drive
from recorder.storage.faults import storage_error
from recorder.storage.folder import RETIMED
from recorder.storage.head import DriveHead
from recorder.storage.messages import KINDS, Times
from recorder.storage.segment_file import SegmentFile, sync_folder
from recorder.storage.segment_writer import SegmentWriter
from recorder.storage.verify import Progress
from recorder.timebase import CameraClock, CameraClockSettings, SolvedUtc, solve

STEP_NS = 1_000_000_000
"""UTC is told as often; straight in between it is exact to nanoseconds."""
_FRAME = np.dtype([(name, "i8") for name in ("id", "raw", "ticks", "exposure", "period", "utc")])
_Section = TypeVar("_Section", TimebaseSection, CameraSection)
_EVERY_DATE = {"not_before": "1970-01-01"}
"""Of drives from before the earliest date was configured."""
_NONE = np.iinfo(np.int64).min


@dataclass(frozen=True, slots=True)
class Retiming:
    """What came of it."""

    file: str
    fixes: int
    """Valid ones with a time."""
    pulses: int
    seconds: float
    frames: dict[str, int]
    """By camera."""
    largest_change_ns: int | None
    """Of UTC of any frame against what was recorded; None if no frame had UTC."""
    half_width_ns: int
    """Of the 95 % interval where it is widest."""
    problems: list[str]

    def to_dict(self) -> dict[str, Any]:
        """Fit for JSON."""
        return asdict(self)


def retime(drive: Drive, progress: Progress | None = None) -> Retiming:
    """Solve UTC and every frame's exposure again, from all that was heard before and after.

    Writes ``retimed.mcap`` into the drive's folder: ``/time/solved`` every second, and
    ``/camera/<name>/time`` for each frame. Nothing else is touched; a result that was there is replaced
    in one step, when the new one is on disk.

    Raises:
        UsageError: not the folder of a drive of ours.
        RecorderError: nothing in it that UTC could be solved by.
        StorageError: it cannot be written.
    """
    if not drive.path.is_dir():
        raise UsageError("one segment alone", where=str(drive.path), todo="give the folder of its drive")
    if all(segment.last_metadata(heads.DRIVE) is None for segment in drive.segments):
        raise UsageError("not recorded by recorder", where=str(drive.path), todo="give the folder of a drive")
    job = _Job(drive, progress or (lambda done, total: None))
    return job.run()


class _Job:
    def __init__(self, drive: Drive, progress: Progress) -> None:
        self._drive, self._progress = drive, progress
        self._problems = list(drive.problems)
        self._done, self._total = 0, sum(len(drive.frames(name)) for name in drive.cameras)
        self._change_ns: int | None = None

    def run(self) -> Retiming:
        drive = self._drive
        fixes = [one for one in self._samples("/gnss/fix") if isinstance(one, Fix)]
        edges = [one.stamp for one in self._samples("/gnss/pps") if isinstance(one, PpsEdge)]
        pulses = [one.raw_ns for one in edges if one.raw_ns is not None and one.raw_error_ns is not None]
        settings = _known(TimebaseSection, _EVERY_DATE | (drive.config.get("timebase") or {}))
        solved = solve(fixes, settings, pulses_raw_ns=pulses)
        if solved is None:
            what = "no valid fix in it, so its time cannot be solved"
            raise RecorderError(what, where=str(drive.path), todo="it stays as it was recorded")
        first_ns, last_ns = self._ends()
        course = [solved.at(raw_ns) for raw_ns in _every(first_ns, last_ns)]
        frames = {camera: self._frames(camera) for camera in drive.cameras}
        with _Result(drive) as result:
            for utc in course:
                result.write(SOLVED_TOPIC, utc)
            for camera, rows in frames.items():
                for time in self._times(camera, rows, solved):
                    result.write(KINDS[FrameTime].topic(time), time)
        return Retiming(
            file=str(drive.path / RETIMED),
            fixes=sum(fix.valid and fix.stamp.gps_ns is not None for fix in fixes),
            pulses=len(pulses),
            seconds=(last_ns - first_ns) / 1e9,
            frames={camera: len(rows) for camera, rows in frames.items()},
            largest_change_ns=self._change_ns,
            half_width_ns=max(utc.interval_ns[1] - utc.utc_ns for utc in course),
            problems=self._problems,
        )

    def _ends(self) -> tuple[int, int]:
        """Of what was recorded, raw."""
        recorded = [self._drive.topics[topic] for topic in self._drive.topics if not _is_ours(topic)]
        offset_ns = self._drive.log_offset_ns
        return min(one.first_ns for one in recorded) - offset_ns, max(
            one.last_ns for one in recorded
        ) - offset_ns

    def _samples(self, topic: str) -> Iterator[Any]:
        for entry in self._drive.entries(topic):
            try:
                yield self._drive.access.message(entry).sample
            except (DriveError, ValueError) as error:
                self._problems.append(str(error))

    def _frames(self, camera: str) -> NDArray[np.void]:
        """What the camera's clock is solved by; frames that are damaged are passed over."""
        frames = self._drive.frames(camera)
        rows = np.full(len(frames), _NONE, _FRAME)
        count = 0
        for index in range(len(frames)):
            self._done += 1
            self._progress(self._done, self._total)
            try:
                frame = frames[index]
            except DriveError as error:
                self._problems.append(str(error))
                continue
            stamp, settings = frame.stamp, frame.settings
            if stamp.raw_ns is None:
                continue
            exposure_us, rate_hz = settings.exposure_us, settings.rate_hz
            exposure_ns = None if exposure_us is None else round(exposure_us * 1000)
            period_ns = round(1e9 / rate_hz) if rate_hz else None
            known = (stamp.device_ns, exposure_ns, period_ns, stamp.utc_ns)
            rows[count] = (frame.id, stamp.raw_ns, *(_NONE if one is None else one for one in known))
            count += 1
        return rows[:count]

    def _times(self, camera: str, rows: NDArray[np.void], solved: SolvedUtc) -> Iterator[FrameTime]:
        section = self._drive.config.get("drivers", {}).get("camera", {}).get(camera)
        settings = CameraClockSettings.of(_known(CameraSection, {"source": "genicam:"} | (section or {})))
        for row, (middle_ns, sigma_ns) in zip(rows, _exposures(settings, rows), strict=True):
            utc = solved.at(middle_ns)
            recorded_ns = _or_none(int(row["utc"]))
            if recorded_ns is not None:
                self._change_ns = max(self._change_ns or 0, abs(utc.utc_ns - recorded_ns))
            together_ns = isqrt(utc.sigma_ns**2 + sigma_ns**2)
            yield FrameTime(
                camera=camera,
                id=int(row["id"]),
                raw_ns=int(row["raw"]),
                exposure_raw_ns=middle_ns,
                exposure_sigma_ns=sigma_ns,
                utc_ns=utc.utc_ns,
                utc_sigma_ns=together_ns,
            )


class _Result:
    """The file on its way: under another name until it is whole and on disk."""

    def __init__(self, drive: Drive) -> None:
        self._folder, self._offset_ns = drive.path, drive.log_offset_ns
        self._part = self._folder / f".{RETIMED}.part"
        self._head = DriveHead("{}", drive.log_offset_ns, drive.start_raw_ns)
        told = (segment.last_metadata(heads.DRIVE) for segment in drive.segments)
        self._name = next((one["drive"] for one in told if one and "drive" in one), drive.path.name)

    def __enter__(self) -> "_Result":
        try:
            self._part.unlink(missing_ok=True)
            self._file = SegmentFile(self._part)
            self._writer = SegmentWriter(self._file)
            record = heads.drive_record(self._head, drive=self._name, segment="retimed")
            self._writer.metadata(heads.DRIVE, record)
        except OSError as error:
            raise storage_error(error, self._folder) from error
        return self

    def write(self, topic: str, record: UtcTime | FrameTime) -> None:
        """Raises `StorageError`."""
        log_time_ns = record.raw_ns + self._offset_ns
        kind = KINDS[type(record)]
        data = kind.encode(record, Times(log_time_ns, self._offset_ns))
        try:
            self._writer.message(kind, topic, data, log_time_ns, self._writer.counts[topic])
        except OSError as error:
            raise storage_error(error, self._folder) from error

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        try:
            if error is None:
                self._finish()
        except OSError as fault:
            raise storage_error(fault, self._folder) from fault
        finally:
            with suppress(OSError):
                self._file.close()
            with suppress(OSError):
                self._part.unlink(missing_ok=True)

    def _finish(self) -> None:
        self._writer.flush()
        self._writer.metadata(heads.END, heads.end_record("closed", self._writer.counts))
        self._writer.finish()
        os.fdatasync(self._file.fileno())
        self._part.replace(self._folder / RETIMED)
        sync_folder(self._folder)


def _exposures(settings: CameraClockSettings, rows: NDArray[np.void]) -> Iterator[tuple[int, int]]:
    """Middle of each exposure and one standard deviation, by the frames before and after it."""
    count = len(rows)
    solved = np.zeros((2, count, 2), np.int64)
    for direction, order in enumerate((range(count), range(count - 1, -1, -1))):
        clock = CameraClock(replace(settings, transfer_sigma_ns=0), backwards=direction == 1)
        for index in order:
            row = rows[index]
            ticks, exposure, period = (_or_none(int(row[n])) for n in ("ticks", "exposure", "period"))
            told = clock.observe(int(row["id"]), ticks, int(row["raw"]), exposure, period)
            solved[direction, index] = told.raw_ns, told.sigma_ns
    for index in range(count):
        (before_ns, sigma_ns), (after_ns, other_ns) = solved[:, index].tolist()
        weight, other = other_ns**2, sigma_ns**2
        middle_ns = before_ns + (after_ns - before_ns) * other // max(1, weight + other)
        yield middle_ns, isqrt(min(sigma_ns, other_ns) ** 2 + settings.transfer_sigma_ns**2)


def _every(first_ns: int, last_ns: int) -> Iterable[int]:
    yield from range(first_ns, last_ns, STEP_NS)
    yield last_ns


def _is_ours(topic: str) -> bool:
    return topic == SOLVED_TOPIC or (topic.startswith("/camera/") and topic.endswith("/time"))


def _or_none(value: int) -> int | None:
    return None if value == _NONE else value


def _known(kind: type[_Section], values: Any) -> _Section:
    """A section of the drive's own configuration, as far as this version knows its keys."""
    known = {key: value for key, value in (values or {}).items() if key in kind.model_fields}
    try:
        return kind.model_validate(known)
    except ValidationError:
        return kind.model_validate({key: known[key] for key in ("source",) if key in known})
