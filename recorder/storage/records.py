"""MCAP records one by one, on bytes that may be damaged (mcap.dev/spec).

The ``mcap`` package parses what stands inside a record; where records begin and end is found here,
since its readers stop at the first fault.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import lz4.frame
import zstandard
from mcap import records as mcap_records
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode

from recorder.storage.source import Damaged, Source

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD = 9
"""Opcode and length before each record's content."""
MESSAGE_HEAD = 22
"""Channel, sequence, log time and publish time before a message's data."""
CHUNK_HEAD = 40
"""Times, size, checksum, length of the compression's name and of the data: all but that name."""

_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")

_PARSERS: dict[int, Any] = {
    Opcode.HEADER: mcap_records.Header,
    Opcode.FOOTER: mcap_records.Footer,
    Opcode.SCHEMA: mcap_records.Schema,
    Opcode.CHANNEL: mcap_records.Channel,
    Opcode.MESSAGE_INDEX: mcap_records.MessageIndex,
    Opcode.CHUNK_INDEX: mcap_records.ChunkIndex,
    Opcode.ATTACHMENT: mcap_records.Attachment,
    Opcode.ATTACHMENT_INDEX: mcap_records.AttachmentIndex,
    Opcode.STATISTICS: mcap_records.Statistics,
    Opcode.METADATA: mcap_records.Metadata,
    Opcode.METADATA_INDEX: mcap_records.MetadataIndex,
    Opcode.SUMMARY_OFFSET: mcap_records.SummaryOffset,
    Opcode.DATA_END: mcap_records.DataEnd,
}


@dataclass(frozen=True, slots=True)
class Span:
    """Where one record stands."""

    opcode: int
    start: int
    """Of the opcode byte."""
    length: int
    """Of the content."""

    @property
    def content(self) -> int:
        return self.start + RECORD_HEAD

    @property
    def end(self) -> int:
        return self.content + self.length


@dataclass(frozen=True, slots=True)
class ChunkHead:
    """What a chunk says of itself, and where its data stand."""

    start_time_ns: int
    end_time_ns: int
    uncompressed_size: int
    crc32: int
    compression: str
    data: int
    size: int
    """As stored."""


@dataclass(frozen=True, slots=True)
class MessageHead:
    """A message without its data."""

    channel: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: int
    """Offset of the data in the source."""
    size: int


def walk(source: Source, start: int, end: int) -> Iterator[Span]:
    """Every whole record from ``start`` up to ``end``.

    Raises `Damaged` where the next record is cut or none can begin.
    """
    at = start
    while at < end:
        span = span_at(source, at, end)
        yield span
        at = span.end


def span_at(source: Source, at: int, end: int) -> Span:
    """The record at ``at``. Raises `Damaged`."""
    if at + RECORD_HEAD > end:
        raise Damaged("cut", at)
    opcode, length = _RECORD.unpack(source.read(at, RECORD_HEAD))
    if opcode == 0:
        raise Damaged("no record", at)
    if length > end - at - RECORD_HEAD:
        raise Damaged("cut or damaged record", at)
    return Span(opcode, at, length)


def parse(source: Source, span: Span) -> Any:
    """The record at ``span`` as the ``mcap`` package sees it. Raises `Damaged`."""
    stream = ReadDataStream(BytesIO(source.read(span.content, span.length)))
    try:
        return _PARSERS[span.opcode].read(stream)
    except Exception as error:
        raise Damaged(f"unreadable {name_of(span.opcode)} record", span.start) from error


def serialised(record: Any) -> bytes:
    """A record as the ``mcap`` package writes it."""
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def name_of(opcode: int) -> str:
    try:
        return Opcode(opcode).name.lower().replace("_", " ")
    except ValueError:
        return f"unknown ({opcode:#04x})"


def message_head(source: Source, span: Span) -> MessageHead:
    """Raises `Damaged`."""
    if span.length < MESSAGE_HEAD:
        raise Damaged("damaged message", span.start)
    channel, sequence, log_time, publish_time = _MESSAGE.unpack(source.read(span.content, MESSAGE_HEAD))
    data = span.content + MESSAGE_HEAD
    return MessageHead(channel, sequence, log_time, publish_time, data, span.length - MESSAGE_HEAD)


def chunk_head(source: Source, span: Span) -> ChunkHead:
    """Of a chunk whose record may be cut: ``size`` is what it says. Raises `Damaged`."""
    times = source.read(span.content, 32)
    start, end, uncompressed, crc, name_length = struct.unpack("<QQQII", times)
    if name_length > 16:
        raise Damaged("damaged chunk", span.start)
    rest = source.read(span.content + 32, name_length + 8)
    (size,) = struct.unpack("<Q", rest[name_length:])
    if size != span.length - CHUNK_HEAD - name_length:
        raise Damaged("damaged chunk", span.start)
    compression = rest[:name_length].decode("ascii", "replace")
    data = span.content + CHUNK_HEAD + name_length
    return ChunkHead(start, end, uncompressed, crc, compression, data, size)


def decompress(data: bytes, compression: str, size: int, offset: int) -> bytes:
    """A chunk's records. Raises `Damaged`, also if the compression is unknown."""
    try:
        if compression == "zstd":
            return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
        if compression == "lz4":
            return bytes(lz4.frame.decompress(data))
    except Exception as error:
        raise Damaged("chunk that cannot be decompressed", offset) from error
    if compression:
        raise Damaged(f"chunk compressed by unknown {compression!r}", offset)
    return data
