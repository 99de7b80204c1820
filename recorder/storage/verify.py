"""Whether a drive holds exactly what it claims: every byte, every frame, every loss."""

import json
import os
from collections import Counter, deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from typing import Any

from recorder import codec
from recorder.errors import CodecError, DriveError
from recorder.samples import Loss
from recorder.storage import head as heads
from recorder.storage.drive import FRAME_SCHEMA, Drive
from recorder.storage.frame_message import read_head
from recorder.storage.frames import check_image
from recorder.storage.ledger import Range, settle
from recorder.storage.messages import SHARED_TOPICS
from recorder.storage.segment import Segment
from recorder.storage.source import opened
from recorder.storage.structure import Structure

Progress = Callable[[int, int], None]
"""Takes what is done and the total, in bytes here."""

PROBLEMS_MAX = 100
WORKERS = min(4, os.cpu_count() or 1)
_IN_FLIGHT = 2 * WORKERS
"""Frames that wait for a decoder: bounds memory."""


@dataclass(frozen=True, slots=True)
class Verification:
    """The outcome. ``ok`` only if nothing at all is wrong."""

    ok: bool
    frames: int
    """Images that decode to the pixels that were recorded."""
    damaged: int
    """Frames that do not, other messages that cannot be read, and chunks damaged elsewhere."""
    unaccounted: int
    """Ids that are missing and stated nowhere, and ids that are stated as lost and are there."""
    problems: list[str]
    """One line each, the first `PROBLEMS_MAX`."""

    def to_dict(self) -> dict[str, Any]:
        """Fit for JSON."""
        return asdict(self)


def verify(drive: Drive, progress: Progress | None = None) -> Verification:
    """Read every byte and decode every message of a drive.

    Never raises on what the drive holds. Raises `DriveError` if its files cannot be read any more.
    """
    with ThreadPoolExecutor(WORKERS, thread_name_prefix="verify") as pool:
        check = _Check(drive, pool, progress or (lambda done, total: None))
        return check.run()


@dataclass(slots=True)
class _Stream:
    """One topic on the way through the segments."""

    last_ns: int = -1
    messages: int = 0
    ids: list[int] = field(default_factory=list)


class _Check:
    def __init__(self, drive: Drive, pool: ThreadPoolExecutor, progress: Progress) -> None:
        self._drive, self._pool, self._progress = drive, pool, progress
        self._problems: dict[str, None] = dict.fromkeys(drive.problems)
        self._streams: dict[str, _Stream] = {}
        self._losses: dict[str, list[Range]] = {}
        self._jobs: deque[tuple[Future[None], int, str]] = deque()
        self._damaged_at: set[int] = set()
        self._frames = self._damaged = 0
        self._total = sum(segment.size_bytes for segment in drive.segments)
        self._done = 0

    def run(self) -> Verification:
        counts_hold = self._drive.path.is_dir()
        for segment in self._drive.segments:
            self._check_segment(segment)
            if counts_hold and segment.number is not None:
                counts_hold = self._check_counts(segment)
            self._done += segment.size_bytes
        self._progress(self._total, self._total)
        unaccounted = sum(self._settle(topic, stream.ids) for topic, stream in self._streams.items())
        unseen = {topic for topic in self._losses if topic not in self._streams}
        unaccounted += sum(self._settle(topic, []) for topic in unseen)
        lines = list(self._problems)
        if len(lines) > PROBLEMS_MAX:
            lines[PROBLEMS_MAX:] = [f"{len(lines) - PROBLEMS_MAX} more problems"]
        sound = not lines and not self._damaged and not unaccounted
        return Verification(sound, self._frames, self._damaged, unaccounted, lines)

    def _problem(self, line: str) -> None:
        self._problems.setdefault(line)

    def _check_segment(self, segment: Segment) -> None:
        with opened(segment.path) as source:
            structure = Structure(
                source,
                segment,
                lambda line: self._problem(f"{segment.name}: {line}"),
                lambda done: self._progress(self._done + done // 2, self._total),
            )
            structure.check()
        self._damaged_at.clear()
        entries = [entry for entries in segment.entries.values() for entry in entries]
        entries.sort(key=lambda entry: (entry["chunk"], entry["offset"]))
        half = segment.size_bytes // 2
        for number, entry in enumerate(entries):
            if int(entry["channel"]) in segment.channels:
                self._check_message(segment, entry)
            self._progress(self._done + half + half * number // len(entries), self._total)
        self._collect(0)
        for chunk in structure.bad_chunks:
            if not any(chunk.start <= offset < chunk.end for offset in self._damaged_at):
                self._damaged += 1

    def _check_message(self, segment: Segment, entry: Any) -> None:
        topic = self._drive.access.topic_of(entry)
        stream = self._streams.setdefault(topic, _Stream())
        stream.messages += 1
        time, offset = int(entry["log_time"]), int(entry["offset"])
        place = f"{segment.name}: {topic} at byte {offset}"
        if time < stream.last_ns and topic not in SHARED_TOPICS:
            self._problem(f"{place}: its time goes back by {stream.last_ns - time} ns")
        stream.last_ns = max(stream.last_ns, time)
        if self._drive.topics[topic].schema == FRAME_SCHEMA:
            self._check_frame(entry, stream, place)
            return
        try:
            message = self._drive.access.message(entry)
            sample = message.sample
        except (DriveError, ValueError) as error:
            self._note_damage(offset, f"{place}: {error}")
            return
        if message.publish_time_ns != time:
            self._note_damage(offset, f"{place}: publish time and log time differ")
        if isinstance(sample, Loss):
            self._losses.setdefault(sample.stream, []).append((sample.first_id, sample.last_id))
            if sample.count != message.value.count or sample.count < 1:
                self._note_damage(offset, f"{place}: a loss that does not count its own ids")

    def _check_frame(self, entry: Any, stream: _Stream, place: str) -> None:
        offset = int(entry["offset"])
        try:
            head, data = self._drive.access.start(entry, int(entry["size"]))
            frame = read_head(data)
        except (DriveError, ValueError) as error:
            self._note_damage(offset, f"{place}: {error}")
            return
        told = frame.message
        if stream.ids and told.id <= stream.ids[-1]:
            self._problem(f"{place}: id {told.id} after {stream.ids[-1]}")
        stream.ids.append(told.id)
        image = data[frame.data_offset :]
        if len(image) != frame.data_size or head.sequence != told.id & 0xFFFF_FFFF or not told.complete:
            self._note_damage(offset, f"{place}: frame {told.id} does not fit its message")
            return
        job = self._pool.submit(_decode, image, told.width, told.height, told.bit_depth)
        self._jobs.append((job, offset, f"{place}: frame {told.id}"))
        self._collect(_IN_FLIGHT)

    def _collect(self, in_flight: int) -> None:
        """Take results until no more than so many are awaited."""
        while len(self._jobs) > in_flight:
            job, offset, place = self._jobs.popleft()
            try:
                job.result()
            except (CodecError, ValueError) as error:
                self._note_damage(offset, f"{place}: {error}")
            else:
                self._frames += 1

    def _note_damage(self, offset: int, line: str) -> None:
        self._damaged += 1
        self._damaged_at.add(offset)
        self._problem(line)

    def _check_counts(self, segment: Segment) -> bool:
        """Whether the drive up to here holds as many messages as the segment's end says."""
        end = segment.last_metadata(heads.END)
        if end is None:
            return False  # said already; later counts cannot be compared
        try:
            told = Counter(json.loads(end.get("messages", "")))
        except (ValueError, TypeError):
            return False
        there = Counter({topic: stream.messages for topic, stream in self._streams.items()})
        for topic in sorted(told.keys() | there.keys()):
            if told[topic] != there[topic]:
                counts = f"{there[topic]} messages of {topic}, {told[topic]} were written"
                self._problem(f"{segment.name}: {counts}")
        return told == there

    def _settle(self, topic: str, ids: list[int]) -> int:
        """Compare the ids of an image topic with the ledger. Other streams have no ids in the drive."""
        if not topic.endswith("/image"):
            return 0
        whole = self._drive.path.is_dir()  # ids begin at 0; a segment alone begins where it does
        account = settle(ids, self._losses.get(topic, []), first=0 if whole else None)
        self._tell(topic, "missing and not in the ledger", account.missing)
        self._tell(topic, "in the ledger as lost, but there", account.contradicted)
        self._tell(topic, "in the ledger more than once", account.repeated)
        return account.unaccounted

    def _tell(self, topic: str, what: str, ranges: Iterable[Range]) -> None:
        for first, last in ranges:
            ids = f"id {first}" if first == last else f"ids {first} to {last}"
            self._problem(f"{topic}: {ids} {what}")


def _decode(image: bytes, width: int, height: int, bit_depth: int) -> None:
    """Raises `CodecError`."""
    check_image(image, width, height, bit_depth)
    codec.decode(image)
