"""The bytes of a ``recorder.FelicsFrame``: a small head, then the image.

The head is a message of its own without ``data``; field 99 is the CRC-32 of the bytes before it,
field 100 the image. So stamps and ids are read, and trusted, without touching the pixels.
"""

import zlib
from dataclasses import dataclass

from recorder.samples import EncodedFrame
from recorder.storage.recorder_pb2 import FelicsFrame
from recorder.storage.stamps import settings_to_proto, stamp_to_proto

HEAD_BYTES = 512
"""Enough to read for any head as it is written today, which takes about 150."""

HEAD_BYTES_MAX = 1 << 16
"""What is read of a message whose head does not end in `HEAD_BYTES`."""

_BYTES, _FIXED32 = 2, 5
_CRC_BYTES = 4
_MAX_VARINT_BYTES = 10


def _tag(number: int, wire_type: int) -> bytes:
    return _varint(number << 3 | wire_type)


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


_CRC_TAG = _tag(FelicsFrame.HEAD_CRC32_FIELD_NUMBER, _FIXED32)
_DATA_TAG = _tag(FelicsFrame.DATA_FIELD_NUMBER, _BYTES)


def frame_to_bytes(frame: EncodedFrame) -> bytes:
    """The message of one frame. The image is copied once."""
    head = FelicsFrame(
        id=frame.id,
        stamp=stamp_to_proto(frame.stamp),
        settings=settings_to_proto(frame.settings),
        complete=True,
        width=frame.width,
        height=frame.height,
        bit_depth=frame.bit_depth,
        frame_id=f"camera_{frame.camera}",
    ).SerializeToString()
    crc = zlib.crc32(head).to_bytes(4, "little")
    return b"".join((head, _CRC_TAG, crc, _DATA_TAG, _varint(len(frame.data)), frame.data))


@dataclass(frozen=True, slots=True)
class FrameHead:
    """A frame's message without its image, and where the image stands in the message."""

    message: FelicsFrame
    data_offset: int
    data_size: int


def read_head(start: bytes) -> FrameHead:
    """Read the head from the first bytes of a message: it ends where its checksum says so.

    Raises ValueError if there is no sound head in them.
    """
    at = start.find(_CRC_TAG)
    while at >= 0:
        told = at + len(_CRC_TAG)
        data = told + _CRC_BYTES
        if start.startswith(_DATA_TAG, data) and _is_head(start[:at], start[told:data]):
            size, offset = _read_varint(start, data + len(_DATA_TAG))
            return FrameHead(_parse(start[:at]), offset, size)
        at = start.find(_CRC_TAG, at + 1)
    raise ValueError("the head of a frame is damaged (checksum)")


def _is_head(head: bytes, stated: bytes) -> bool:
    return zlib.crc32(head) == int.from_bytes(stated, "little")


def _parse(head: bytes) -> FelicsFrame:
    try:
        return FelicsFrame.FromString(head)
    except Exception as error:
        raise ValueError("the head of a frame cannot be read") from error


def _read_varint(data: bytes, at: int) -> tuple[int, int]:
    value = 0
    for count, byte in enumerate(data[at : at + _MAX_VARINT_BYTES]):
        value |= (byte & 0x7F) << 7 * count
        if byte < 0x80:
            return value, at + count + 1
    raise ValueError("the length of an image is damaged")
