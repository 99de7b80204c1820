"""Reads single messages of a drive, from wherever its index says that they stand."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from mcap.opcode import Opcode

from recorder.errors import DriveError
from recorder.samples import Record
from recorder.storage.messages import KINDS, decode
from recorder.storage.records import (
    MESSAGE_HEAD,
    RECORD_HEAD,
    MessageHead,
    decompress,
    message_head,
    span_at,
)
from recorder.storage.schemas import MessageClass, message_class, schema_data
from recorder.storage.segment import PLAIN, Segment
from recorder.storage.source import Damaged, MemorySource, Source, opened

_OWN = {(kind.schema, schema_data(kind.message)): kind.message for kind in KINDS.values()}


@dataclass(frozen=True, slots=True)
class Message:
    """One message of a drive."""

    topic: str
    log_time_ns: int
    publish_time_ns: int
    sequence: int
    raw_ns: int
    """``log_time_ns`` as CLOCK_MONOTONIC_RAW of the machine that recorded it."""
    schema: str
    data: bytes
    value: Any
    """The decoded protobuf message; for other encodings ``data``."""

    @property
    def sample(self) -> Record | None:
        """As a sample of `recorder.samples`, where there is one for its schema."""
        return decode(self.schema, self.value, raw_ns=self.raw_ns, sequence=self.sequence)


class Access:
    """Opens a segment's file for each read and keeps none; of compressed chunks it keeps the last.

    May be shared between threads. Every method raises `DriveError` for damage and for a disk that
    cannot be read.
    """

    def __init__(self, segments: tuple[Segment, ...], log_offset_ns: int) -> None:
        self._segments, self._log_offset_ns = segments, log_offset_ns
        self._classes: dict[tuple[int, int], MessageClass | None] = {}
        self._unpacked: tuple[tuple[int, int], bytes] | None = None
        self.closed = False

    def message(self, entry: Any) -> Message:
        """Read and decode one message."""
        head, data = self.start(entry, int(entry["size"]))
        segment = self._segments[entry["segment"]]
        channel = segment.channels[head.channel]
        schema = segment.schemas.get(channel.schema_id)
        try:
            kind = self._class(int(entry["segment"]), head.channel)
            value = kind.FromString(data) if kind is not None else data
        except Exception as error:
            raise self._damaged(entry, f"not decodable ({error})") from error
        return Message(
            topic=channel.topic,
            log_time_ns=head.log_time_ns,
            publish_time_ns=head.publish_time_ns,
            sequence=head.sequence,
            raw_ns=head.log_time_ns - self._log_offset_ns,
            schema=schema.name if schema is not None else "",
            data=data,
            value=value,
        )

    def start(self, entry: Any, size: int) -> tuple[MessageHead, bytes]:
        """The head of a message and up to ``size`` bytes of its data."""
        offset = int(entry["offset"])
        try:
            with self._source(entry) as source:
                wanted = RECORD_HEAD + MESSAGE_HEAD + min(size, int(entry["size"]))
                start = MemorySource(source.read(offset, wanted))
                span = span_at(start, 0, source.size - offset)
                head = message_head(start, span)
                told = (head.channel, head.log_time_ns)
                if span.opcode != Opcode.MESSAGE or told != (entry["channel"], entry["log_time"]):
                    raise Damaged("not the message that the index tells of", offset)
                if head.size > entry["size"]:
                    raise Damaged("longer than the index tells", offset)
                return head, start.read(head.data, min(size, head.size))
        except Damaged as damage:
            raise self._damaged(entry, damage.what) from damage

    def part(self, entry: Any, start: int, size: int) -> bytes:
        """A part of a message's data."""
        try:
            with self._source(entry) as source:
                return source.read(int(entry["offset"]) + RECORD_HEAD + MESSAGE_HEAD + start, size)
        except Damaged as damage:
            raise self._damaged(entry, damage.what) from damage

    def topic_of(self, entry: Any) -> str:
        return str(self._segments[entry["segment"]].channels[int(entry["channel"])].topic)

    @contextmanager
    def _source(self, entry: Any) -> Iterator[Source]:
        number, chunk = int(entry["segment"]), int(entry["chunk"])
        path = self._segments[number].path
        if self.closed:
            raise DriveError("the drive was closed", where=str(path), todo="open it again")
        if chunk != PLAIN:
            yield MemorySource(self._unpack(number, chunk))
            return
        with opened(path) as source:
            yield source

    def _unpack(self, number: int, chunk: int) -> bytes:
        """A compressed chunk's records; the last one is kept, as messages come one after another."""
        kept = self._unpacked
        if kept is not None and kept[0] == (number, chunk):
            return kept[1]
        packed = self._segments[number].packed[chunk]
        with opened(self._segments[number].path) as source:
            stored = source.read(packed.data, packed.size)
        data = decompress(stored, packed.compression, packed.uncompressed_size, packed.data)
        self._unpacked = ((number, chunk), data)
        return data

    def _class(self, number: int, channel_id: int) -> MessageClass | None:
        """The class of a channel's messages; None if it does not carry protobuf. Raises ValueError."""
        key = (number, channel_id)
        if key not in self._classes:
            segment = self._segments[number]
            channel = segment.channels[channel_id]
            schema = segment.schemas.get(channel.schema_id)
            found: MessageClass | None = None
            if schema is not None and schema.encoding == channel.message_encoding == "protobuf":
                own = _OWN.get((schema.name, schema.data))
                found = own or message_class(schema.name, schema.data)
            self._classes[key] = found
        return self._classes[key]

    def _damaged(self, entry: Any, what: str) -> DriveError:
        path = self._segments[entry["segment"]].path
        place = f"{path}, {self.topic_of(entry)} at byte {int(entry['offset'])}"
        return DriveError(what, where=place, todo="recorder verify tells what else is damaged")
