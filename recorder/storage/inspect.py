"""What a drive holds, as numbers that people and programs read."""

from collections import Counter
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

from recorder.errors import DriveError
from recorder.samples import ClockPair, Loss, UtcTime, image_topic
from recorder.storage.course import UtcCourse
from recorder.storage.drive import SOLVED_TOPIC, Drive
from recorder.storage.ledger import Range, settle

POINTS = 13
"""Of the course of time that is told."""


@dataclass(frozen=True, slots=True)
class SegmentReport:
    """One segment."""

    name: str
    bytes: int
    closed: bool


@dataclass(frozen=True, slots=True)
class TimeReport:
    """One end of a drive."""

    raw_ns: int
    log_time_ns: int
    utc_ns: int | None
    utc_sigma_ns: int | None


@dataclass(frozen=True, slots=True)
class TimePoint:
    """What is known of UTC at one instant of a drive."""

    at_s: float
    """Since its first message."""
    source: str
    offset_ns: int
    """UTC minus ``log_time``."""
    drift_ppb: int
    """By how much UTC runs faster than the raw clock there."""
    half_width_ns: int
    """Of the 95 % interval."""


@dataclass(frozen=True, slots=True)
class ClockStep:
    """The wall clock was set."""

    at_s: float
    by_ns: int


@dataclass(frozen=True, slots=True)
class TopicReport:
    """One topic."""

    messages: int
    bytes: int
    schema: str
    first_ns: int
    """``log_time`` of the first message."""
    last_ns: int
    rate_hz: float | None
    """None for fewer than two messages, or if they all bear one time."""
    gaps: int
    """For images: ids that are missing, by the ids themselves or by the ledger; else 0."""
    lost: int
    """Samples that the ledger says are lost."""


@dataclass(frozen=True, slots=True)
class Inspection:
    """A drive at a glance."""

    path: str
    segments: list[SegmentReport]
    duration_s: float
    first_time: TimeReport | None
    last_time: TimeReport | None
    topics: dict[str, TopicReport]
    ratios: dict[str, float]
    """By camera: bytes of its FELICS images over width x height x bit_depth / 8."""
    losses: dict[str, int]
    """Samples by cause."""
    time_topic: str | None
    """Where UTC is from: as solved again, else as recorded; None if nowhere."""
    time: list[TimePoint]
    """Evenly over the drive."""
    clock_steps: list[ClockStep]
    problems: list[str]

    def to_dict(self) -> dict[str, Any]:
        """Fit for JSON."""
        return asdict(self)


def inspect(drive: Drive) -> Inspection:
    """Reads indexes, the heads of frames and the small topics that concern time and loss."""
    problems: list[str] = []
    losses = _losses(drive, problems)
    absent, ratios = {}, {}
    for camera in drive.cameras:
        topic = image_topic(camera)
        ids, ratio = _frames(drive, camera, problems)
        if ratio is not None:
            ratios[camera] = ratio
        absent[topic] = settle(ids, _ranges(losses, topic)).absent
    first = min((info.first_ns for info in drive.topics.values()), default=None)
    last = max((info.last_ns for info in drive.topics.values()), default=None)
    time_topic = next((one for one in (SOLVED_TOPIC, "/time/utc") if one in drive.topics), None)
    utc = UtcCourse(_utc_times(drive, time_topic, problems) if time_topic else [])
    return Inspection(
        path=str(drive.path),
        segments=[SegmentReport(s.name, s.size_bytes, s.closed) for s in drive.segments],
        duration_s=(last - first) / 1e9 if first is not None and last is not None else 0.0,
        first_time=_time(drive, first, utc),
        last_time=_time(drive, last, utc),
        topics=_topics(drive, absent, losses),
        ratios=ratios,
        losses=dict(_by_cause(losses)),
        time_topic=time_topic,
        time=_course(drive, utc, first, last) if first is not None and last is not None else [],
        clock_steps=_clock_steps(drive, first or 0, problems),
        problems=[*drive.problems, *problems],
    )


def _topics(drive: Drive, absent: dict[str, int], losses: list[Loss]) -> dict[str, TopicReport]:
    reports = {}
    for topic, info in drive.topics.items():
        span_ns = info.last_ns - info.first_ns
        reports[topic] = TopicReport(
            messages=info.messages,
            bytes=info.bytes,
            schema=info.schema,
            first_ns=info.first_ns,
            last_ns=info.last_ns,
            rate_hz=(info.messages - 1) * 1e9 / span_ns if span_ns > 0 else None,
            gaps=absent.get(topic, 0),
            lost=sum(loss.count for loss in losses if loss.stream == topic),
        )
    return reports


def _frames(drive: Drive, camera: str, problems: list[str]) -> tuple[list[int], float | None]:
    """The ids of a camera's frames, and how much smaller than packed pixels its images are."""
    frames = drive.frames(camera)
    ids: list[int] = []
    stored = packed = 0.0
    for index in range(len(frames)):
        try:
            frame = frames[index]
        except DriveError as error:
            problems.append(str(error))
            continue
        ids.append(frame.id)
        stored += frame.data_size
        packed += frame.width * frame.height * frame.bit_depth / 8
    return ids, stored / packed if packed else None


def _losses(drive: Drive, problems: list[str]) -> list[Loss]:
    return [sample for sample in _samples(drive, "/loss", problems) if isinstance(sample, Loss)]


def _by_cause(losses: list[Loss]) -> Counter[str]:
    causes: Counter[str] = Counter()
    for loss in losses:
        causes[loss.cause.value] += loss.count
    return causes


def _ranges(losses: list[Loss], topic: str) -> list[Range]:
    return [(loss.first_id, loss.last_id) for loss in losses if loss.stream == topic]


def _utc_times(drive: Drive, topic: str, problems: list[str]) -> list[UtcTime]:
    return [sample for sample in _samples(drive, topic, problems) if isinstance(sample, UtcTime)]


def _course(drive: Drive, utc: UtcCourse, first: int, last: int) -> list[TimePoint]:
    """At `POINTS` instants, the drift over the stretch around each."""
    points = []
    step_ns = max(1, (last - first) // (POINTS - 1))
    for log_time_ns in range(first, last + 1, step_ns):
        raw_ns = log_time_ns - drive.log_offset_ns
        here = utc.at(raw_ns)
        before, after = utc.at(raw_ns - step_ns // 2), utc.at(raw_ns + step_ns // 2)
        if here is None or before is None or after is None:
            return []
        span_ns = max(1, after.raw_ns - before.raw_ns)
        points.append(
            TimePoint(
                at_s=(log_time_ns - first) / 1e9,
                source=here.source,
                offset_ns=here.utc_ns - log_time_ns,
                drift_ppb=(after.utc_ns - before.utc_ns - span_ns) * 10**9 // span_ns,
                half_width_ns=here.interval_ns[1] - here.utc_ns,
            )
        )
    return points


def _clock_steps(drive: Drive, first: int, problems: list[str]) -> list[ClockStep]:
    pairs = [one for one in _samples(drive, "/clock/pairs", problems) if isinstance(one, ClockPair)]
    steps = []
    for before, after in pairwise(pairs):
        if after.stepped:
            by_ns = (after.realtime_ns - after.raw_ns) - (before.realtime_ns - before.raw_ns)
            steps.append(ClockStep((after.raw_ns + drive.log_offset_ns - first) / 1e9, by_ns))
    return steps


def _samples(drive: Drive, topic: str, problems: list[str]) -> list[Any]:
    found = []
    for entry in drive.entries(topic):
        try:
            found.append(drive.access.message(entry).sample)
        except (DriveError, ValueError) as error:
            problems.append(f"{topic}: {error}")
    return found


def _time(drive: Drive, log_time_ns: int | None, utc: UtcCourse) -> TimeReport | None:
    """UTC as far as the drive knows it, carried on by the raw clock."""
    if log_time_ns is None:
        return None
    raw_ns = log_time_ns - drive.log_offset_ns
    told = utc.at(raw_ns)
    known = (told.utc_ns, told.sigma_ns) if told else (None, None)
    return TimeReport(raw_ns, log_time_ns, *known)
