"""Checks a segment byte by byte: every record is what the writer would have written.

Chunks, attachments, metadata and the summary have checksums. What stands between them (record
heads, chunk heads, message indexes) is built again from the chunks' contents and compared.
"""

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field

from mcap.opcode import Opcode
from mcap.records import ChunkIndex, MessageIndex

from recorder.storage import head as heads
from recorder.storage.records import (
    MAGIC,
    RECORD_HEAD,
    Span,
    chunk_head,
    decompress,
    message_head,
    name_of,
    parse,
    serialised,
    walk,
)
from recorder.storage.segment import Segment
from recorder.storage.source import Damaged, MemorySource, Source
from recorder.storage.summary import FOOTER_BYTES, read_footer

_DATA = (Opcode.HEADER, Opcode.METADATA, Opcode.ATTACHMENT, Opcode.CHUNK, Opcode.MESSAGE_INDEX)
_FOREIGN_DATA = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)


@dataclass(slots=True)
class Found:
    """What the data section holds, as the summary should tell it."""

    chunks: list[ChunkIndex] = field(default_factory=list)
    counts: dict[Opcode, int] = field(default_factory=dict)
    message_counts: dict[int, int] = field(default_factory=dict)
    times: list[int] = field(default_factory=list)
    schemas: dict[int, bytes] = field(default_factory=dict)
    channels: dict[int, bytes] = field(default_factory=dict)
    places: dict[Opcode, list[tuple[int, int]]] = field(default_factory=dict)
    """Offset and length of the metadata and attachment records."""


class Structure:
    """One segment's check.

    Args:
        source: its bytes.
        segment: what the reader made of it.
        report: takes one line for each problem.
        advance: takes the number of bytes done.
    """

    def __init__(
        self,
        source: Source,
        segment: Segment,
        report: Callable[[str], None],
        advance: Callable[[int], None],
    ) -> None:
        self._source, self._segment, self._report, self._advance = source, segment, report, advance
        self._found = Found()
        self._pending: dict[int, list[tuple[int, int]]] = {}
        self._own = segment.last_metadata(heads.DRIVE) is not None
        self.bad_chunks: list[Span] = []
        """Chunks of which something is damaged."""

    def check(self) -> None:
        """Never raises on what the file holds."""
        at = len(MAGIC)
        while at < self._source.size:
            try:
                for span in walk(self._source, at, self._source.size):
                    at = span.end
                    if span.opcode == Opcode.DATA_END:
                        self._check_end(span)
                        return
                    self._check_record(span)
                    self._advance(span.end)
            except Damaged as damage:
                self._report(str(damage))
                at = self._next_known(max(at, damage.offset))
        if self._segment.indexed:
            self._report("its data have no end")

    def _next_known(self, offset: int) -> int:
        """Where the next chunk begins behind a damage, as the summary has it."""
        starts = (chunk.chunk_start_offset for chunk in self._segment.chunks)
        return min((start for start in starts if start > offset), default=self._source.size)

    def _check_record(self, span: Span) -> None:
        allowed = _DATA if self._own else _DATA + _FOREIGN_DATA
        if span.opcode not in allowed:
            if self._own or span.opcode <= Opcode.DATA_END:
                raise Damaged(f"a {name_of(span.opcode)} record where none belongs", span.start)
            return
        if span.opcode != Opcode.MESSAGE_INDEX and self._pending:
            self._report(f"no message index before byte {span.start}")
            self._pending = {}
        kind = Opcode(span.opcode)
        self._found.counts[kind] = self._found.counts.get(kind, 0) + 1
        try:
            if kind == Opcode.CHUNK:
                self._check_chunk(span)
            elif kind == Opcode.MESSAGE_INDEX:
                self._check_index(span)
            elif kind == Opcode.ATTACHMENT:
                self._check_attachment(span)
            elif kind in (Opcode.HEADER, Opcode.METADATA):
                self._check_written(span)
            else:
                self._check_content(self._source, span, {})
        except Damaged as damage:
            self._report(str(damage))
        if kind in (Opcode.METADATA, Opcode.ATTACHMENT):
            self._found.places.setdefault(kind, []).append((span.start, span.end - span.start))

    def _check_written(self, span: Span) -> None:
        record = parse(self._source, span)
        if serialised(record) != self._bytes(span):
            raise Damaged(f"damaged {name_of(span.opcode)} record", span.start)
        if span.opcode == Opcode.METADATA:
            if record.name.startswith("recorder.") and not heads.is_sound(record.name, record.metadata):
                raise Damaged(f"damaged metadata {record.name}", span.start)
            if self._own and not record.name.startswith("recorder."):
                raise Damaged(f"unknown metadata {record.name!r}", span.start)
        elif self._own:
            told = self._segment.last_metadata(heads.DRIVE) or {}
            is_first = span.start == len(MAGIC)
            if record.profile or record.library != told.get("software") or not is_first:
                raise Damaged("damaged header", span.start)

    def _check_attachment(self, span: Span) -> None:
        content = self._source.read(span.content, span.length)
        told = int.from_bytes(content[-4:], "little")
        if zlib.crc32(content[:-4]) != told and (told or self._own):
            raise Damaged("damaged attachment (checksum)", span.start)

    def _check_chunk(self, span: Span) -> None:
        try:
            self._check_sound_chunk(span)
        except Damaged:
            self.bad_chunks.append(span)
            raise

    def _check_sound_chunk(self, span: Span) -> None:
        head = chunk_head(self._source, span)
        stored = self._source.read(head.data, head.size)
        data = decompress(stored, head.compression, head.uncompressed_size, span.start)
        if len(data) != head.uncompressed_size:
            raise Damaged("chunk of another size than it says", span.start)
        if zlib.crc32(data) != head.crc32 and (head.crc32 or self._own):
            raise Damaged("damaged chunk (checksum)", span.start)
        index: dict[int, list[tuple[int, int]]] = {}
        inner = MemorySource(data)
        for record in walk(inner, 0, len(data)):
            self._check_content(inner, record, index)
        times = [time for pairs in index.values() for time, _ in pairs]
        if (head.start_time_ns, head.end_time_ns) != (min(times, default=0), max(times, default=0)):
            raise Damaged("chunk of other times than it says", span.start)
        self._pending = dict(index)
        self._found.chunks.append(
            ChunkIndex(
                chunk_length=span.end - span.start,
                chunk_start_offset=span.start,
                compression=head.compression,
                compressed_size=head.size,
                message_end_time=head.end_time_ns,
                message_index_length=0,
                message_index_offsets={},
                message_start_time=head.start_time_ns,
                uncompressed_size=head.uncompressed_size,
            )
        )

    def _check_content(self, source: Source, span: Span, index: dict[int, list[tuple[int, int]]]) -> None:
        """A record of those that may stand in a chunk."""
        if span.opcode == Opcode.MESSAGE:
            head = message_head(source, span)
            index.setdefault(head.channel, []).append((head.log_time_ns, span.start))
            self._found.times.append(head.log_time_ns)
            self._found.message_counts[head.channel] = self._found.message_counts.get(head.channel, 0) + 1
        elif span.opcode == Opcode.SCHEMA:
            self._found.schemas[parse(source, span).id] = source.read(span.start, span.end - span.start)
        elif span.opcode == Opcode.CHANNEL:
            self._found.channels[parse(source, span).id] = source.read(span.start, span.end - span.start)
        elif self._own:
            raise Damaged(f"a {name_of(span.opcode)} record in a chunk", span.start)

    def _check_index(self, span: Span) -> None:
        record = parse(self._source, span)
        assert isinstance(record, MessageIndex)
        expected = self._pending.pop(record.channel_id, None)
        if expected is None and not record.records and not self._own:
            return
        if expected is None or sorted(expected) != sorted(record.records):
            raise Damaged("message index that does not fit its chunk", span.start)
        if serialised(record) != self._bytes(span):
            raise Damaged("damaged message index", span.start)
        chunk = self._found.chunks[-1]
        chunk.message_index_offsets[record.channel_id] = span.start
        chunk.message_index_length += span.end - span.start

    def _check_end(self, span: Span) -> None:
        if self._pending:
            self._report("the last chunk has no message index")
        told = parse(self._source, span).data_section_crc
        if told and _crc(self._source, span.start) != told:
            self._report("damaged data section (checksum)")
        if span.length != 4:
            self._report(str(Damaged("damaged data end record", span.start)))
        self._check_summary(span.end)
        self._advance(self._source.size)

    def _check_summary(self, start: int) -> None:
        try:
            footer = read_footer(self._source)
        except Damaged as damage:
            self._report(str(damage))
            return
        end = self._source.size - len(MAGIC) - FOOTER_BYTES
        if footer.summary_start == 0 and not self._own:
            return
        covered = self._source.read(start, end + FOOTER_BYTES - 4 - start)
        crc_fits = zlib.crc32(covered) == footer.summary_crc
        if footer.summary_start != start or (not crc_fits and (footer.summary_crc or self._own)):
            self._report("damaged summary (checksum)")
            return
        try:
            records = [(span, parse(self._source, span)) for span in walk(self._source, start, end)]
        except Damaged as damage:
            self._report(str(damage))
            return
        for problem in _summary_problems(self._source, records, self._found):
            self._report(f"the summary does not fit the data: {problem}")

    def _bytes(self, span: Span) -> bytes:
        return self._source.read(span.start, RECORD_HEAD + span.length)


def _summary_problems(source: Source, records: list[tuple[Span, object]], found: Found) -> list[str]:
    by_kind: dict[int, list[tuple[Span, object]]] = {}
    for span, record in records:
        by_kind.setdefault(span.opcode, []).append((span, record))
    problems = []
    told_chunks = [record for _, record in by_kind.get(Opcode.CHUNK_INDEX, [])]
    if told_chunks and told_chunks != found.chunks:
        problems.append("chunk indexes")
    for kind, there in ((Opcode.SCHEMA, found.schemas), (Opcode.CHANNEL, found.channels)):
        for span, record in by_kind.get(kind, []):
            written = there.get(record.id)  # type: ignore[attr-defined]
            if written is not None and written != source.read(span.start, span.end - span.start):
                problems.append(name_of(kind))
    pairs = ((Opcode.METADATA_INDEX, Opcode.METADATA), (Opcode.ATTACHMENT_INDEX, Opcode.ATTACHMENT))
    for index, kind in pairs:
        told = [(record.offset, record.length) for _, record in by_kind.get(index, [])]  # type: ignore[attr-defined]
        if told and told != found.places.get(kind, []):
            problems.append(name_of(index))
    for _, record in by_kind.get(Opcode.STATISTICS, []):
        told_counts = {id_: count for id_, count in record.channel_message_counts.items() if count}  # type: ignore[attr-defined]
        times = (record.message_start_time, record.message_end_time)  # type: ignore[attr-defined]
        seen = (min(found.times, default=0), max(found.times, default=0))
        if told_counts != found.message_counts or times != seen:
            problems.append("statistics")
    return problems


def _crc(source: Source, end: int) -> int:
    crc = 0
    for start in range(0, end, 1 << 20):
        crc = zlib.crc32(source.read(start, min(1 << 20, end - start)), crc)
    return crc
