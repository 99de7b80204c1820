"""Does a video file end where its container says it ends?

The top-level boxes of MP4 and MOV (ISO/IEC 14496-12, 4.2), the RIFF chunks of AVI and the
segment of Matroska and WebM (RFC 8794, RFC 9559) all state their length up front, so a cut file
is told from a whole one without decoding anything.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

_EBML = b"\x1a\x45\xdf\xa3"
_SEGMENT = 0x18538067
_BOXES = (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide", b"styp", b"moof")


@dataclass(frozen=True, slots=True)
class ContainerEnd:
    """What a container says about its end."""

    missing_bytes: int
    """How many bytes the file is shorter than it says; 0 if it is whole or does not say."""
    known: bool
    """False for a container of another kind, whose end nobody can tell: MPEG-TS and the like."""
    counts_frames: bool
    """True if it has an index that counts frames: MP4, MOV (not fragmented) and AVI."""


def container_end(path: Path) -> ContainerEnd:
    """Read the headers of a video file. Raises `OSError`."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(12)
        file.seek(0)
        counts, known = False, True
        if head[4:8] in _BOXES:
            end, counts = _boxes_end(file, size)
        elif head[:4] == b"RIFF":
            end, counts = _riff_end(file, size), True
        elif head[:4] == _EBML:
            end = _segment_end(file, size)
        else:
            end, known = size, False
    return ContainerEnd(max(0, end - size), known, counts)


def _boxes_end(file: BinaryIO, size: int) -> tuple[int, bool]:
    """Where the last box ends, and whether all samples stand in one index (no movie fragments)."""
    position, whole = 0, True
    while position < size:
        file.seek(position)
        header = file.read(16)
        if len(header) < 8:
            return position + 8, whole
        whole = whole and header[4:8] != b"moof"
        length = int.from_bytes(header[:4], "big")
        if length == 1:
            length = int.from_bytes(header[8:16], "big")
        elif length == 0:  # to the end of the file
            return size, whole
        if length < 8:  # not a box: whatever follows the last one is not ours to judge
            return size, whole
        position += length
    return position, whole


def _riff_end(file: BinaryIO, size: int) -> int:
    position = 0
    while position < size:  # OpenDML puts further RIFF chunks behind the first
        file.seek(position)
        header = file.read(8)
        if len(header) < 8 or header[:4] != b"RIFF":
            return position or size
        position += 8 + int.from_bytes(header[4:8], "little")
        position += position & 1
    # Writers differ in whether the padding of an odd chunk is there.
    return position if position - size > 1 else size


def _segment_end(file: BinaryIO, size: int) -> int:
    while file.tell() < size:
        identity = _vint(file, keep_marker=True)
        length = _vint(file, keep_marker=False)
        if identity is None or length is None:  # cut, or a length "unknown" as live streams write it
            return size
        if identity == _SEGMENT:
            return file.tell() + length
        file.seek(length, os.SEEK_CUR)
    return size


def _vint(file: BinaryIO, *, keep_marker: bool) -> int | None:
    """A variable-size integer of EBML (RFC 8794, 4); None at the end or if all its bits are ones."""
    first = file.read(1)
    if not first or not first[0]:
        return None
    width = 9 - first[0].bit_length()
    data = first + file.read(width - 1)
    value = int.from_bytes(data, "big")
    if keep_marker:
        return value
    value &= (1 << 7 * width) - 1
    return None if value == (1 << 7 * width) - 1 else value
