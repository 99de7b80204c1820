"""Reads a segment by its summary: as quick for 4 GiB as for one frame."""

import struct
import zlib
from collections.abc import Container

import numpy as np
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Footer, Statistics

from recorder.storage.records import (
    CHUNK_HEAD,
    MAGIC,
    MESSAGE_HEAD,
    RECORD_HEAD,
    message_head,
    parse,
    span_at,
    walk,
)
from recorder.storage.scan import scan_chunk
from recorder.storage.segment import PLAIN, EntryList, Numbers, PackedChunk, Segment
from recorder.storage.source import Damaged, Source

FOOTER_BYTES = RECORD_HEAD + 20
_INDEX_HEAD = struct.Struct("<HI")


def read_footer(source: Source) -> Footer:
    """Raises `Damaged` if the file does not end as an MCAP file does."""
    at = source.size - len(MAGIC) - FOOTER_BYTES
    if at < len(MAGIC) or source.read(source.size - len(MAGIC), len(MAGIC)) != MAGIC:
        raise Damaged("no end", source.size)
    span = span_at(source, at, source.size)
    if span.opcode != Opcode.FOOTER or span.length != FOOTER_BYTES - RECORD_HEAD:
        raise Damaged("no footer", at)
    footer = parse(source, span)
    assert isinstance(footer, Footer)
    return footer


def read_summary(source: Source, segment: Segment) -> None:
    """Fill ``segment`` from its summary and its message indexes.

    Raises `Damaged` if there is no summary, or one that does not tell of every message.
    """
    footer = read_footer(source)
    end = source.size - len(MAGIC) - FOOTER_BYTES
    if not len(MAGIC) <= footer.summary_start <= end:
        raise Damaged("no summary", source.size)
    _check_crc(source, footer, end)
    statistics: Statistics | None = None
    for span in walk(source, footer.summary_start, end):
        if span.opcode == Opcode.SCHEMA:
            schema = parse(source, span)
            segment.schemas[schema.id] = schema
        elif span.opcode == Opcode.CHANNEL:
            channel = parse(source, span)
            segment.channels[channel.id] = channel
        elif span.opcode == Opcode.CHUNK_INDEX:
            segment.chunks.append(parse(source, span))
        elif span.opcode == Opcode.STATISTICS:
            statistics = parse(source, span)
        elif span.opcode == Opcode.METADATA_INDEX:
            _read_metadata(source, segment, parse(source, span).offset)
    segment.chunks.sort(key=lambda chunk: chunk.chunk_start_offset)
    _read_messages(source, segment)
    if statistics is None or segment.messages != statistics.message_count:
        raise Damaged("an incomplete index", footer.summary_start)
    segment.indexed = True


def _check_crc(source: Source, footer: Footer, end: int) -> None:
    if footer.summary_crc == 0:
        return
    covered = source.read(footer.summary_start, end + FOOTER_BYTES - 4 - footer.summary_start)
    if zlib.crc32(covered) != footer.summary_crc:
        raise Damaged("a damaged summary", footer.summary_start)


def _read_metadata(source: Source, segment: Segment, offset: int) -> None:
    try:
        span = span_at(source, offset, source.size)
        if span.opcode != Opcode.METADATA:
            raise Damaged("no metadata", offset)
        record = parse(source, span)
    except Damaged as damage:
        segment.problem(str(damage))
        return
    segment.metadata.append((record.name, record.metadata))


def _read_messages(source: Source, segment: Segment) -> None:
    lists: dict[int, EntryList] = {}
    for chunk in segment.chunks:
        place = PLAIN
        start = chunk.chunk_start_offset + RECORD_HEAD + CHUNK_HEAD + len(chunk.compression.encode())
        if chunk.compression:
            place = len(segment.packed)
            segment.packed.append(
                PackedChunk(start, chunk.compressed_size, chunk.uncompressed_size, chunk.compression)
            )
        try:
            _read_message_index(source, chunk, start, place, lists)
        except Damaged as damage:
            if chunk.message_index_offsets:
                segment.problem(f"message index: {damage}; its chunk is read instead")
            try:
                scan_chunk(source, segment, chunk.chunk_start_offset, place, lists)
            except Damaged as worse:
                segment.problem(f"{worse}: a chunk is not read to its end")
    segment.entries = {channel: entries.entries() for channel, entries in lists.items()}


def _read_message_index(
    source: Source, chunk: ChunkIndex, start: int, place: int, lists: dict[int, EntryList]
) -> None:
    """One chunk's messages from its message indexes, all or none. Raises `Damaged`."""
    after = chunk.chunk_start_offset + chunk.chunk_length
    if not chunk.message_index_offsets or chunk.message_index_length == 0:
        raise Damaged("no message index", after)
    block = source.read(after, chunk.message_index_length)
    found: dict[int, Numbers] = {}
    at = 0
    while at < len(block):
        if len(block) - at < RECORD_HEAD + _INDEX_HEAD.size or block[at] != Opcode.MESSAGE_INDEX:
            raise Damaged("damaged message index", after + at)
        length = int.from_bytes(block[at + 1 : at + RECORD_HEAD], "little")
        channel, pairs = _INDEX_HEAD.unpack_from(block, at + RECORD_HEAD)
        first = at + RECORD_HEAD + _INDEX_HEAD.size
        if pairs % 16 or pairs != length - _INDEX_HEAD.size or first + pairs > len(block):
            raise Damaged("damaged message index", after + at)
        found[channel] = np.frombuffer(block, "<u8", pairs // 8, first).reshape(-1, 2)
        at += RECORD_HEAD + length
    sizes = _sizes(source, chunk, start, place, found, known=lists.keys())
    for channel, index in found.items():
        if len(index):
            entries = lists.setdefault(channel, EntryList(channel))
            base = np.uint64(start if place == PLAIN else 0)
            entries.extend(index[:, 0], index[:, 1] + base, sizes[channel], place)


def _sizes(
    source: Source,
    chunk: ChunkIndex,
    start: int,
    place: int,
    found: dict[int, Numbers],
    *,
    known: Container[int],
) -> dict[int, Numbers]:
    """The data size of each message: up to the next one, or as it says where records may stand between."""
    offsets = np.concatenate([index[:, 1] for index in found.values()])
    around = RECORD_HEAD + MESSAGE_HEAD
    edges = np.append(np.sort(offsets), np.uint64(chunk.uncompressed_size))
    if len(offsets) == 0 or int(edges[-2]) + around > chunk.uncompressed_size:
        raise Damaged("damaged message index", chunk.chunk_start_offset + chunk.chunk_length)
    if np.any(np.diff(edges) < around):
        raise Damaged("damaged message index", chunk.chunk_start_offset + chunk.chunk_length)
    if place == PLAIN and any(channel not in known for channel in found):
        return {channel: _told_sizes(source, chunk, start, index) for channel, index in found.items()}
    return {
        channel: edges[np.searchsorted(edges, index[:, 1]) + 1] - index[:, 1] - np.uint64(around)
        for channel, index in found.items()
    }


def _told_sizes(source: Source, chunk: ChunkIndex, start: int, index: Numbers) -> Numbers:
    end = start + chunk.uncompressed_size
    spans = (span_at(source, start + int(offset), end) for offset in index[:, 1])
    return np.array([message_head(source, span).size for span in spans], np.uint64)
