"""Reads a segment record by record: one that a crash or a cut left without a summary."""

from mcap.opcode import Opcode

from recorder.storage.records import (
    MAGIC,
    Span,
    chunk_head,
    decompress,
    message_head,
    parse,
    span_at,
    walk,
)
from recorder.storage.segment import PLAIN, EntryList, PackedChunk, Segment
from recorder.storage.source import Damaged, MemorySource, Source

Lists = dict[int, EntryList]


def scan_segment(source: Source, segment: Segment) -> None:
    """Fill ``segment`` with every whole record up to its end, or up to the first damage.

    Only the heads of messages are read. Never raises on what the file holds; `Segment.problems`
    tells where reading stopped.
    """
    lists: Lists = {}
    at = len(MAGIC)
    try:
        for span in walk(source, at, source.size):
            at = span.start
            if span.opcode == Opcode.DATA_END:
                break
            _scan_record(source, segment, span, lists)
    except Damaged as damage:
        rest = source.size - damage.offset
        segment.problem(f"{damage}: {rest} bytes from there are not read" if rest else "cut")
        _scan_cut_chunk(source, segment, lists, damage.offset)
    segment.entries = {channel: entries.entries() for channel, entries in lists.items()}


def scan_chunk(source: Source, segment: Segment, start: int, place: int, lists: Lists) -> None:
    """The messages of the chunk at ``start``. Raises `Damaged` behind the last whole one."""
    span = span_at(source, start, source.size)
    if span.opcode != Opcode.CHUNK:
        raise Damaged("no chunk", start)
    head = chunk_head(source, span)
    if not head.compression:
        _scan_messages(source, segment, head.data, head.data + head.size, PLAIN, lists)
        return
    data = decompress(source.read(head.data, head.size), head.compression, head.uncompressed_size, start)
    if place == PLAIN:
        place = len(segment.packed)
        segment.packed.append(PackedChunk(head.data, head.size, head.uncompressed_size, head.compression))
    _scan_messages(MemorySource(data), segment, 0, len(data), place, lists)


def _scan_record(source: Source, segment: Segment, span: Span, lists: Lists) -> None:
    if span.opcode == Opcode.CHUNK:
        try:
            scan_chunk(source, segment, span.start, PLAIN, lists)
        except Damaged as damage:
            segment.problem(f"{damage}: a chunk is not read to its end")
    elif span.opcode == Opcode.METADATA:
        try:
            record = parse(source, span)
        except Damaged as damage:
            segment.problem(str(damage))
            return
        segment.metadata.append((record.name, record.metadata))
    elif span.opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
        _scan_one(source, segment, span, PLAIN, lists)


def _scan_cut_chunk(source: Source, segment: Segment, lists: Lists, start: int) -> None:
    """The whole messages of a chunk that the end of the file cuts."""
    try:
        opcode = source.read(start, 1)[0]
        length = int.from_bytes(source.read(start + 1, 8), "little")
        if opcode != Opcode.CHUNK:
            return
        head = chunk_head(source, Span(opcode, start, length))
        if not head.compression:
            end = min(source.size, head.data + head.size)
            _scan_messages(source, segment, head.data, end, PLAIN, lists)
    except Damaged:
        return  # behind the last whole message, which is what was asked for


def _scan_messages(source: Source, segment: Segment, start: int, end: int, place: int, lists: Lists) -> None:
    for span in walk(source, start, end):
        _scan_one(source, segment, span, place, lists)


def _scan_one(source: Source, segment: Segment, span: Span, place: int, lists: Lists) -> None:
    if span.opcode == Opcode.MESSAGE:
        head = message_head(source, span)
        if head.channel not in segment.channels:
            raise Damaged("a message of no channel", span.start)
        entries = lists.setdefault(head.channel, EntryList(head.channel))
        entries.add(head.log_time_ns, span.start, head.size, place)
    elif span.opcode == Opcode.SCHEMA:
        schema = parse(source, span)
        segment.schemas[schema.id] = schema
    elif span.opcode == Opcode.CHANNEL:
        channel = parse(source, span)
        segment.channels[channel.id] = channel
