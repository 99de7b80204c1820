"""Binary protocols of GNSS receivers, told from their bytes: whole frames with sound checksums."""

import re
from collections import Counter
from collections.abc import Callable

DLE, ETX = 0x10, 0x03
_LONGEST = 2048
"""Bytes of a frame; SiRF allows 2047 in a payload, in practice a few hundred."""

Frame = Callable[[bytes, int], int | None]
"""The end of the sound frame that begins at an offset, or None."""


def recognise(data: bytes) -> Counter[str]:
    """Sound frames in ``data`` by protocol, of each begun anywhere; text between them is passed over.

    A protocol of which one frame was found may still be chance where its check is short: ask for
    two. Any place to begin will do: what is cut off in front is passed over too.
    """
    found: Counter[str] = Counter()
    at = 0
    while match := _LEADER.search(data, at):
        at = match.start()
        for name, leader, frame in _PROTOCOLS:
            if data.startswith(leader, at) and (end := frame(data, at)) is not None:
                found[name] += 1
                at = end
                break
        else:
            at += 1
    return found


def _sirf(data: bytes, at: int) -> int | None:
    """A0 A2, length, payload, its sum in 15 bits, B0 B3."""
    length = int.from_bytes(data[at + 2 : at + 4], "big")
    end = at + 8 + length
    payload = data[at + 4 : end - 4]
    sound = (
        0 < length < _LONGEST
        and data[end - 2 : end] == b"\xb0\xb3"
        and int.from_bytes(data[end - 4 : end - 2], "big") & 0x7FFF == sum(payload) & 0x7FFF
    )
    return end if sound else None


def _ubx(data: bytes, at: int) -> int | None:
    """B5 62, class, id, length, payload, Fletcher's checksum of all after the leader."""
    end = at + 8 + int.from_bytes(data[at + 4 : at + 6], "little")
    if end - at > _LONGEST or end > len(data):
        return None
    first = second = 0
    for byte in data[at + 2 : end - 2]:
        first = (first + byte) & 0xFF
        second = (second + first) & 0xFF
    return end if data[end - 2 : end] == bytes((first, second)) else None


def _skytraq(data: bytes, at: int) -> int | None:
    """A0 A1, length, payload, its exclusive or, CR LF."""
    length = int.from_bytes(data[at + 2 : at + 4], "big")
    end = at + 7 + length
    payload = data[at + 4 : end - 3]
    sound = 0 < length < _LONGEST and data[end - 3 : end] == bytes((_xor(payload), 0x0D, 0x0A))
    return end if sound else None


def _navcom(data: bytes, at: int) -> int | None:
    """02 99 66, command, length, data, exclusive or of all after the leader, 03; the length counts
    from the command through the checksum."""
    length = int.from_bytes(data[at + 4 : at + 6], "little")
    end = at + 4 + length
    body = data[at + 3 : end - 2]
    sound = 4 <= length < _LONGEST and data[end - 2 : end] == bytes((_xor(body), ETX))
    return end if sound else None


def _zodiac(data: bytes, at: int) -> int | None:
    """FF 81 in words of 16 bits: leader, id, length in words, flags, header check, data, check."""
    words = [int.from_bytes(data[at + 2 * n : at + 2 * n + 2], "little") for n in range(5)]
    if len(data) < at + 10 or sum(words) & 0xFFFF or words[2] > _LONGEST // 2:
        return None
    if not words[2]:
        return at + 10
    end = at + 12 + 2 * words[2]
    rest = [int.from_bytes(data[n : n + 2], "little") for n in range(at + 10, end, 2)]
    return end if end <= len(data) and not sum(rest) & 0xFFFF else None


def _italk(data: bytes, at: int) -> int | None:
    """``<!``, four bytes, length in words, payload, check, ``>``."""
    if len(data) < at + 10:
        return None
    length = data[at + 6]
    end = at + 7 + 2 * length + 3
    check = 0
    for n in range(length):
        word = int.from_bytes(data[at + 7 + 2 * n : at + 9 + 2 * n], "little")
        product = ((check + 1) * (word + n)) & 0xFFFFFFFF
        check ^= (product ^ product >> 16) & 0xFFFF
    sound = length and data[end - 3 : end] == check.to_bytes(2, "little") + b">"
    return end if sound else None


def _rtcm3(data: bytes, at: int) -> int | None:
    """D3, six zero bits and ten of length, payload, CRC-24Q."""
    if len(data) < at + 6 or data[at + 1] & 0xFC:
        return None
    length = int.from_bytes(data[at + 1 : at + 3], "big")
    end = at + 6 + length
    if not length or end > len(data):
        return None
    crc = 0
    for byte in data[at:end]:
        crc ^= byte << 16
        for _ in range(8):
            crc = crc << 1 ^ 0x1864CFB if crc & 0x800000 else crc << 1
    return None if crc else end


def _oncore(data: bytes, at: int) -> int | None:
    """``@@``, two letters, data, exclusive or of all after the leader, CR LF; no length is told."""
    if not data[at + 2 : at + 4].isalpha():
        return None
    end = data.find(b"\r\n", at + 4)
    while 0 <= end - at < 300:
        if end >= at + 5 and _xor(data[at + 2 : end - 1]) == data[end - 1]:
            return end + 2
        end = data.find(b"\r\n", end + 1)
    return None


def _unstuffed(data: bytes, at: int) -> tuple[bytes, int] | None:
    """What stands between DLE and DLE ETX with doubled DLEs made single, and the end."""
    inner = bytearray()
    n = at + 1
    while n + 1 < min(len(data), at + _LONGEST):
        if data[n] != DLE:
            inner.append(data[n])
            n += 1
        elif data[n + 1] == DLE:
            inner.append(DLE)
            n += 2
        else:
            return (bytes(inner), n + 2) if data[n + 1] == ETX else None
    return None


def _garmin(data: bytes, at: int) -> int | None:
    """DLE, id, length, data, two's complement of their sum, DLE ETX; DLEs after the id doubled."""
    told = _unstuffed(data, at)
    if told is None:
        return None
    inner, end = told
    sound = len(inner) >= 3 and inner[1] == len(inner) - 3 and not sum(inner) & 0xFF
    return end if sound else None


def _tsip(data: bytes, at: int) -> int | None:
    """DLE, report id, data, DLE ETX. There is no checksum: the id and the length must be a report's."""
    told = _unstuffed(data, at)
    if told is None or not told[0]:
        return None
    report, length = told[0][0], len(told[0]) - 1
    if report == 0x6D:  # satellites: their count stands in the upper half of the first byte
        return told[1] if length == 17 + (told[0][1] >> 4 if length else 0) else None
    return told[1] if length in _TSIP_LENGTHS.get(report, ()) else None


def _xor(data: bytes) -> int:
    total = 0
    for byte in data:
        total ^= byte
    return total


_TSIP_LENGTHS = {
    0x41: (10,), 0x42: (16,), 0x43: (20,), 0x45: (10,), 0x46: (2,), 0x4A: (20,), 0x4B: (3,), 0x55: (4,),
    0x56: (20,), 0x5C: (24,), 0x82: (1,), 0x83: (36,), 0x84: (36,), 0x8F: (17, 22, 69),
}  # fmt: skip
"""Trimble's reports by id: time, positions, versions, health, status, velocity, super packets."""
_PROTOCOLS: tuple[tuple[str, bytes, Frame], ...] = (
    ("SiRF binary", b"\xa0\xa2", _sirf),
    ("UBX", b"\xb5\x62", _ubx),
    ("SkyTraq binary", b"\xa0\xa1", _skytraq),
    ("Navcom", b"\x02\x99\x66", _navcom),
    ("Zodiac", b"\xff\x81", _zodiac),
    ("iTalk", b"<!", _italk),
    ("RTCM 3", b"\xd3", _rtcm3),
    ("Motorola Oncore", b"@@", _oncore),
    ("Garmin binary", b"\x10", _garmin),
    ("TSIP", b"\x10", _tsip),
)
_LEADER = re.compile(b"[%s]" % b"".join(re.escape(leader[:1]) for _, leader, _ in _PROTOCOLS))
