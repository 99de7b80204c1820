"""A drive being read: topics, messages, frames, and what the segments say of it."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from recorder.config import CAMERA_NAMES
from recorder.errors import UsageError
from recorder.samples import UtcTime, image_topic
from recorder.storage import head as heads
from recorder.storage.access import Access, Message
from recorder.storage.course import UtcCourse
from recorder.storage.frames import Frames
from recorder.storage.opening import read_segments
from recorder.storage.segment import ENTRY, Entries, Segment

FRAME_SCHEMA = "recorder.FelicsFrame"
SOLVED_TOPIC = "/time/solved"
"""UTC as solved again after the drive."""


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """What a drive holds of one topic."""

    messages: int
    bytes: int
    """Of the messages' data."""
    first_ns: int
    """``log_time`` of the first message."""
    last_ns: int
    schema: str


class Drive:
    """A drive on disk, read only; from `open_drive`.

    Holds an index of the messages (34 bytes each) and no open file. May be shared between threads.
    """

    def __init__(self, path: Path, segments: list[Segment], problems: list[str]) -> None:
        self.path = path
        self.segments: tuple[Segment, ...] = tuple(segments)
        self.problems: list[str] = problems
        """One line on everything that is not as it should be; empty for a sound drive."""
        drive = self._told(heads.DRIVE)
        self.log_offset_ns = _number(drive.get("log_offset_ns", ""))
        """log_time - raw_ns."""
        self.start_raw_ns = _number(drive.get("start_raw_ns", ""))
        self.versions: Mapping[str, str] = self._told(heads.VERSIONS)
        self.config: Mapping[str, Any] = self._json(self._told(heads.CONFIG).get("json", "{}"), "config")
        devices = self._told(heads.DEVICES)
        self.devices: Mapping[str, Mapping[str, str]] = {
            name: self._json(text, "devices") for name, text in devices.items()
        }
        """What is known of each device, by the latest word."""
        self._entries = _by_topic(segments, problems)
        self.topics: Mapping[str, TopicInfo] = {topic: self._info(topic) for topic in sorted(self._entries)}
        self.access = Access(self.segments, self.log_offset_ns)
        self._course: UtcCourse | None = None

    def frames(self, camera: str | None = None) -> Frames:
        """The frames of one camera, or of all of them in order of time.

        Raises `UsageError` for a name that is no camera's.
        """
        cameras = self.cameras
        if camera is not None and camera not in cameras and camera not in CAMERA_NAMES:
            known = f"cameras here: {', '.join(cameras) or 'none'}"
            raise UsageError(f"no camera {camera!r}", where=str(self.path), todo=known)
        wanted = cameras if camera is None else [camera]
        entries = [self.entries(image_topic(name)) for name in wanted if name in cameras]
        return Frames(self, _in_time(entries))

    @property
    def cameras(self) -> list[str]:
        """The cameras that have frames in this drive."""
        parts = (topic.split("/") for topic, info in self.topics.items() if info.schema == FRAME_SCHEMA)
        return [part[2] for part in parts if len(part) == 4 and image_topic(part[2]) == "/".join(part)]

    def messages(self, topic: str) -> Iterator[Message]:
        """The messages of a topic in order of time.

        Raises `UsageError` if there is no such topic, `DriveError` at a message that is damaged.
        """
        if topic not in self.topics:
            known = f"topics here: {', '.join(self.topics) or 'none'}"
            raise UsageError(f"no topic {topic!r}", where=str(self.path), todo=known)
        return (self.access.message(entry) for entry in self.entries(topic))

    def utc(self, raw_ns: int) -> UtcTime | None:
        """UTC at a raw instant: as solved again (``/time/solved``) if it was, else as recorded
        (``/time/utc``); None if neither knows. The first call reads that topic. Raises `DriveError`."""
        if self._course is None:
            topic = SOLVED_TOPIC if SOLVED_TOPIC in self.topics else "/time/utc"
            told = [message.sample for message in self.messages(topic)] if topic in self.topics else []
            self._course = UtcCourse([one for one in told if isinstance(one, UtcTime)])
        return self._course.at(raw_ns)

    def entries(self, topic: str) -> Entries:
        """Where the messages of a topic stand, in order of time."""
        return self._entries.get(topic, np.zeros(0, ENTRY))

    def close(self) -> None:
        """Nothing can be read any more."""
        self.access.closed = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _info(self, topic: str) -> TopicInfo:
        entries = self._entries[topic]
        segment = self.segments[entries[0]["segment"]]
        schema = segment.schemas.get(segment.channels[int(entries[0]["channel"])].schema_id)
        times = entries["log_time"]
        return TopicInfo(
            messages=len(entries),
            bytes=int(entries["size"].sum()),
            first_ns=int(times[0]),
            last_ns=int(times[-1]),
            schema=schema.name if schema is not None else "",
        )

    def _told(self, name: str) -> dict[str, str]:
        """The latest sound word of the segments on something, else the latest word."""
        words = [values for segment in self.segments for other, values in segment.metadata if other == name]
        sound = [values for values in words if heads.is_sound(name, values)]
        return heads.unsealed((sound or words or [{}])[-1])

    def _json(self, text: str, what: str) -> dict[str, Any]:
        try:
            value = json.loads(text)
        except ValueError:
            value = None
        if isinstance(value, dict):
            return value
        self.problems.append(f"the {what} it was recorded with cannot be read")
        return {}


def open_drive(path: Path | str) -> Drive:
    """Open a drive's folder, or one of its ``.mcap`` files, or any other MCAP file.

    Reads summaries and message indexes, not the data; a segment that was not closed is read record by
    record up to where it is cut, which `Drive.problems` says. Raises `DriveError` if there is no drive
    or nothing in it can be read.
    """
    path = Path(path).absolute()
    segments, problems = read_segments(path)
    return Drive(path, segments, problems)


def _by_topic(segments: list[Segment], problems: list[str]) -> dict[str, Entries]:
    found: dict[str, list[Entries]] = {}
    for number, segment in enumerate(segments):
        for channel_id, entries in segment.entries.items():
            channel = segment.channels.get(channel_id)
            if channel is None:
                problems.append(f"{segment.name}: {len(entries)} messages of an unknown channel")
            elif len(entries):
                entries["segment"] = number
                found.setdefault(channel.topic, []).append(entries)
    return {topic: _in_time(lists) for topic, lists in found.items()}


def _in_time(lists: list[Entries]) -> Entries:
    """Merged by log time; what has the same time stays in order."""
    entries = np.concatenate(lists) if lists else np.zeros(0, ENTRY)
    times = entries["log_time"]
    if np.all(times[1:] >= times[:-1]):
        return entries
    return entries[np.argsort(times, kind="stable")]


def _number(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        return 0
