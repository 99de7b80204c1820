"""From a path to segments: what can be read of a drive, and what is wrong with it."""

from pathlib import Path

from mcap.opcode import Opcode

from recorder.errors import DriveError
from recorder.storage import head as heads
from recorder.storage.folder import RETIMED, drives_in, segment_name, segment_number
from recorder.storage.records import MAGIC, parse, span_at
from recorder.storage.scan import scan_segment
from recorder.storage.segment import Segment
from recorder.storage.source import Damaged, FileSource, opened, read_error
from recorder.storage.summary import read_summary

_WHAT_TO_GIVE = "give the folder of a drive, or one of its .mcap files"


def find_segments(path: Path) -> list[Path]:
    """The segments of the drive at ``path``, in order. Raises `DriveError` if there are none."""
    try:
        if not path.exists():
            raise DriveError("no such drive", where=str(path), todo=_WHAT_TO_GIVE)
        if not path.is_dir():
            return [path]
        found = [(number, file) for file in path.iterdir() if (number := segment_number(file)) is not None]
        if not found:
            inner = sorted((number, drive.name) for number, drive in drives_in(path))
            todo = f"it holds drives, the latest is {inner[-1][1]}" if inner else _WHAT_TO_GIVE
            raise DriveError("not a drive: no segments in it", where=str(path), todo=todo)
    except OSError as error:
        raise read_error(error, path) from error
    return [file for _, file in sorted(found)]


def read_segments(path: Path) -> tuple[list[Segment], list[str]]:
    """The readable segments of a drive and one line on each problem. Raises `DriveError`."""
    files = find_segments(path)
    segments, problems = [], []
    for file in files:
        try:
            segment = read_segment(file)
        except DriveError as error:
            if len(files) == 1 or error.what.startswith(_NEWER):
                raise
            problems.append(str(error))
            continue
        segments.append(segment)
        problems += segment.problems
    if not segments:
        raise DriveError("nothing in it can be read", where=str(path), todo=_WHAT_TO_GIVE)
    if not path.is_dir():
        return segments, problems
    problems += _gaps(segments, files)
    return segments + _added(path, segments, problems), problems


def _added(path: Path, segments: list[Segment], problems: list[str]) -> list[Segment]:
    """What was solved again later; it lies beside the segments and is left out if it is not theirs."""
    file = path / RETIMED
    if not file.exists():
        return []
    try:
        added = read_segment(file)
    except DriveError as error:
        problems.append(str(error))
        return []
    drives = [(one.last_metadata(heads.DRIVE) or {}).get("drive") for one in (added, *segments)]
    if drives[0] not in drives[1:]:
        problems.append(f"{RETIMED}: belongs to drive {drives[0]!r}, and is left out")
        return []
    problems += added.problems
    return [added]


def read_segment(path: Path) -> Segment:
    """One segment, by its summary or else record by record. Raises `DriveError`."""
    with opened(path) as source:
        segment = Segment(path, segment_number(path), source.size)
        _check_begin(source, segment)
        try:
            read_summary(source, segment)
        except Damaged as damage:
            segment = Segment(path, segment.number, source.size, problems=segment.problems)
            segment.problem(f"not closed properly ({damage}); read record by record")
            scan_segment(source, segment)
    _check_metadata(segment)
    return segment


_NEWER = "written by a newer recorder"


def _check_begin(source: FileSource, segment: Segment) -> None:
    """A file that neither begins as MCAP nor goes on as MCAP is something else."""
    where = str(segment.path)
    if source.size == 0:
        raise DriveError("empty", where=where, todo="a crash left it so; nothing was in it")
    begin = source.read(0, min(len(MAGIC), source.size))
    try:
        span = span_at(source, len(MAGIC), source.size)
        if span.opcode != Opcode.HEADER:
            raise Damaged("no header", span.start)
        parse(source, span)
    except Damaged as damage:
        if not MAGIC.startswith(begin):
            raise DriveError("not an MCAP file", where=where, todo=_WHAT_TO_GIVE) from None
        if source.size < len(MAGIC) + 64:
            todo = "nothing of it is left"
            raise DriveError("cut before its first record", where=where, todo=todo) from None
        segment.problem(f"{damage}: its header is damaged")
    if begin != MAGIC:
        segment.problem("does not begin as an MCAP file does (damaged)")


def _check_metadata(segment: Segment) -> None:
    """Read what the segment says of itself. Raises `DriveError` if its format is newer."""
    drive = segment.last_metadata(heads.DRIVE)
    if drive is None:
        segment.problem("not recorded by recorder, or its head is lost: no recorder.drive record")
        return
    told = drive.get("format", "")
    if heads.is_sound(heads.DRIVE, drive) and (not told.isdecimal() or int(told) > heads.FORMAT_VERSION):
        todo = f"this recorder reads formats up to {heads.FORMAT_VERSION}: update it"
        raise DriveError(f"{_NEWER} (format {told})", where=str(segment.path), todo=todo)
    for name, values in segment.metadata:
        if name.startswith("recorder.") and not heads.is_sound(name, values):
            segment.problem(f"the metadata {name} are damaged")
    end = segment.last_metadata(heads.END)
    segment.end_reason = end.get("reason") if end is not None else None
    if end is None and segment.indexed:
        segment.problem("no recorder.end record")


def _gaps(segments: list[Segment], files: list[Path]) -> list[str]:
    """Segments that are not there, or that belong elsewhere."""
    problems = []
    numbers = [number for file in files if (number := segment_number(file)) is not None]
    missing = sorted(set(range(numbers[-1] + 1)) - set(numbers))
    for number in missing[:10]:
        problems.append(f"{segment_name(number)}: missing")
    if len(missing) > 10:
        problems.append(f"{len(missing) - 10} more segments are missing")
    last = segments[-1]
    if last.path == files[-1] and last.end_reason == "continued":
        after = segment_name(numbers[-1] + 1)
        problems.append(f"{after}: missing, {last.name} says that the drive goes on")
    for segment in segments[:-1]:
        if segment.end_reason == "closed":
            problems.append(f"{segment.name}: says that the drive ends here, but more segments follow")
    return problems + _strangers(segments)


def _strangers(segments: list[Segment]) -> list[str]:
    """Segments whose own words do not fit where they lie."""
    problems: list[str] = []
    name: str | None = None
    for segment in segments:
        told = segment.last_metadata(heads.DRIVE)
        if told is None:
            continue
        name = name or told.get("drive")
        if told.get("drive") != name:
            problems.append(f"{segment.name}: belongs to drive {told.get('drive')!r}, not {name!r}")
        elif told.get("segment") != str(segment.number):
            problems.append(f"{segment.name}: says that it is segment {told.get('segment')}")
    return problems
