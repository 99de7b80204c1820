"""A slow, readable FELICS encoder and decoder, written from docs/felics.md alone."""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

RAW, FELICS, FELICS_LS = 0, 1, 2
USUAL_MASK = 0x3C
STREAMS = 32
FIXED_TABLE = (2, 2, 2, 2, 3, 4, 4, 4, 4, 5, 6, 7, 8, 9, 10, 11, 12)


class OracleError(Exception):
    """The image is malformed."""


def crc32c(data: bytes) -> int:
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0x82F63B78 if crc & 1 else 0)
    return crc ^ 0xFFFFFFFF


def stuff(data: bytes) -> bytes:
    return data.replace(b"\xff", b"\xff\x00")


def unstuff(data: bytes) -> bytes:
    out = bytearray()
    bytes_left = iter(data)
    for byte in bytes_left:
        out.append(byte)
        if byte == 0xFF and next(bytes_left, None) != 0:
            raise OracleError("FF without 00")
    return bytes(out)


def pixel_checksum(image: NDArray[np.uint16]) -> int:
    return crc32c(image.astype("<u2").tobytes())


@dataclass
class Parts:
    """An image taken apart; every field can be made wrong before it is put together."""

    width: int
    height: int
    bits: int
    streams: list[bytes]
    checksum: int
    version: int = 1
    model: int = FELICS
    mask: int = USUAL_MASK
    table: bytes = bytes(FIXED_TABLE)
    lengths: list[int] = field(default_factory=list)
    """The streams' own lengths if empty."""
    header_checksum: int | None = None
    """The right one if None."""

    def header(self) -> bytes:
        lengths = self.lengths or [len(stream) for stream in self.streams]
        head = struct.pack(
            "<BBBBIIHIH",
            self.version,
            self.model,
            self.bits,
            self.mask,
            self.width,
            self.height,
            len(lengths),
            self.checksum,
            len(self.table),
        )
        head += self.table + b"".join(struct.pack("<I", length) for length in lengths)
        right = crc32c(head)
        return head + struct.pack("<I", right if self.header_checksum is None else self.header_checksum)

    def join(self) -> bytes:
        payload = bytes(byte ^ self.mask for byte in b"".join(self.streams))
        return b"\xff\xe8" + stuff(self.header() + payload) + b"\xff\xe9"


def neighbours(image: NDArray[np.uint16], y: int, x: int, bits: int) -> tuple[int, int]:
    if y == 0 and x == 0:
        return 1 << (bits - 1), 1 << (bits - 1)
    if y == 0:
        return int(image[y, x - 1]), int(image[y, x - 1])
    if x == 0:
        return int(image[y - 1, x]), int(image[y - 1, x])
    return int(image[y, x - 1]), int(image[y - 1, x])


def binary(value: int, length: int) -> str:
    return f"{value:0{length}b}" if length else ""


def rice_length(d: int, k: int, bits: int) -> int:
    q = d >> k
    return q + 1 + 1 + k + 1 if q < 8 else 10 + bits


def code_word(x: int, a: int, b: int, table: Sequence[int], bits: int) -> str:
    low, high = min(a, b), max(a, b)
    size = high - low + 1
    c = size.bit_length() - 1
    if low <= x <= high:
        v, t = x - low, (2 << c) - size
        return "1" + (binary(v, c) if v < t else binary(v + t, c + 1))
    d = low - x - 1 if x < low else x - high - 1
    k = table[c]
    q = d >> k
    if q < 8:
        return "0" * (q + 1) + "1" + binary(d & ((1 << k) - 1), k) + ("1" if x > high else "0")
    return "0" * 9 + "1" + binary(x, bits)


GRADIENTS = (4, 8, 12, 16, 20, 24, 32, 40, 48, 64, 96, 128, 192, 256, 384)
INTENSITIES = (32, 96, 272)


def ls_neighbours(image: NDArray[np.uint16], y: int, x: int, bits: int) -> tuple[int, ...]:
    """a b c d e f."""
    middle = 1 << (bits - 1)
    last = image.shape[1] - 1

    def pixel(row: int, column: int) -> int:
        return int(image[row, column])

    if y == 0:
        a = pixel(0, x - 1) if x > 0 else middle
        return a, a, a, a, pixel(0, x - 2) if x > 1 else middle, a
    b = pixel(y - 1, x)
    f = pixel(y - 2, x) if y > 1 else b
    a = pixel(y, x - 1) if x > 0 else b
    e = pixel(y, x - 2) if x > 1 else pixel(y - 1, 0)
    corner = f if y > 1 else middle
    c = pixel(y - 1, x - 1) if x > 0 else corner
    d = pixel(y - 1, x + 1) if x < last else b
    return a, b, c, d, e, f


def ls_interval(around: tuple[int, ...], table: bytes, bits: int) -> tuple[int, int, int]:
    """low, m, k."""

    def ten(value: int) -> int:
        return value >> (bits - 10) if bits > 10 else value << (10 - bits)

    def held(value: int) -> int:
        return min(max(value, -32768), 32767)

    a, b, c, d, e, f = around
    slope = ten(abs(a - c) + abs(c - b) + abs(b - d) + abs(a - e))
    gradient = sum(slope >= limit for limit in GRADIENTS)
    level = ten((b + ((c + d + 1) >> 1) + 1) >> 1)
    code = table[4 * gradient + sum(level >= limit for limit in INTENSITIES)]
    weights = struct.unpack("<80h", table[64:])[gradient::16]
    p = [
        ((neighbour - a) * (1 << (14 - bits)) * weight + (1 << 14)) >> 15
        for neighbour, weight in zip((b, c, d, e, f), weights, strict=True)
    ]
    total = held(held(held(p[0] + p[1]) + held(p[2] + p[3])) + p[4])
    prediction = a + (held(total + (1 << (12 - bits))) >> (13 - bits))
    m, k = code & 15, code >> 4
    return min(max(prediction, 0), (1 << bits) - 1) - ((1 << m) >> 1), m, k


def ls_code_word(x: int, low: int, m: int, k: int, bits: int) -> str:
    if low <= x < low + (1 << m):
        return "1" + binary(x - low, m)
    d = low - x - 1 if x < low else x - low - (1 << m)
    q = d >> k
    if q < 8:
        return "0" * (q + 1) + "1" + binary(d & ((1 << k) - 1), k) + ("0" if x < low else "1")
    return "0" * 9 + "1" + binary(x, bits)


def trained_table(image: NDArray[np.uint16], bits: int) -> bytes:
    height, width = image.shape
    ks = range(min(15, bits) + 1)
    costs: dict[int, list[int]] = {}
    for y in range(min(32, height) // 2, height, 32):
        for x in range(1, width):
            a, b = neighbours(image, y, x, bits)
            low, high, value = min(a, b), max(a, b), int(image[y, x])
            if not low <= value <= high:
                d = low - value - 1 if value < low else value - high - 1
                cost = costs.setdefault((high - low + 1).bit_length() - 1, [0] * len(ks))
                for k in ks:
                    cost[k] += rice_length(d, k, bits)
    table = list(fixed_table(bits))
    for c, cost in costs.items():
        table[c] = cost.index(min(cost))
    return bytes(table)


def fixed_table(bits: int) -> bytes:
    return bytes(min(k, bits) for k in FIXED_TABLE)


def pack(bits: str) -> bytes:
    padded = bits + "0" * (-len(bits) % 8)
    return bytes(int(padded[i : i + 8], 2) for i in range(0, len(padded), 8))


def streams_of(image: NDArray[np.uint16], bits: int, model: int, table: bytes, count: int) -> list[bytes]:
    streams: list[list[str]] = [[] for _ in range(count)]
    for y, x in np.ndindex(image.shape):
        value = int(image[y, x])
        match model:
            case 1:
                word = code_word(value, *neighbours(image, y, x, bits), table, bits)
            case 2:
                word = ls_code_word(value, *ls_interval(ls_neighbours(image, y, x, bits), table, bits), bits)
            case _:
                word = binary(value, bits)
        streams[y % count].append(word)
    return [pack("".join(words)) for words in streams]


def take_apart(
    image: NDArray[np.uint16],
    bits: int,
    *,
    model: int = FELICS,
    table: bytes | None = None,
    count: int = STREAMS,
) -> Parts:
    """The image's parts in the given model, with the usual mask; ``table`` is trained if None."""
    if model == FELICS and table is None:
        table = trained_table(image, bits)
    used = table if model != RAW and table is not None else b""
    streams = streams_of(image, bits, model, used, count)
    height, width = image.shape
    return Parts(width, height, bits, streams, pixel_checksum(image), model=model, table=used)


def encode(image: NDArray[np.uint16], bits: int, *, model: int = FELICS, table: bytes | None = None) -> bytes:
    """What the product's encoder writes, byte for byte."""
    parts = take_apart(image, bits, model=model, table=table)
    if model != RAW:
        raw = take_apart(image, bits, model=RAW)
        if sum(map(len, parts.streams)) + len(parts.table) > sum(map(len, raw.streams)):
            parts = raw
    payload = b"".join(parts.streams)
    if payload.count(0xFF ^ USUAL_MASK) > len(payload) // 128:
        counts = [payload.count(byte) for byte in range(256)]
        parts.mask = counts.index(min(counts)) ^ 0xFF
    return parts.join()


def bits_of(stream: bytes) -> Iterator[int]:
    for byte in stream:
        for shift in range(7, -1, -1):
            yield byte >> shift & 1


def take(bits: Iterator[int], count: int) -> int:
    value = 0
    for _ in range(count):
        bit = next(bits, None)
        if bit is None:
            raise OracleError("a stream ends early")
        value = 2 * value + bit
    return value


def read_pixel(bits: Iterator[int], a: int, b: int, table: Sequence[int], depth: int) -> int:
    low, high = min(a, b), max(a, b)
    size = high - low + 1
    c = size.bit_length() - 1
    zeros = 0
    while take(bits, 1) == 0:
        zeros += 1
        if zeros > 9:
            raise OracleError("ten zeros")
    if zeros == 9:
        return take(bits, depth)
    if zeros == 0:
        t = (2 << c) - size
        v = take(bits, c)
        return low + (v if v < t else 2 * v + take(bits, 1) - t)
    k = table[c]
    d = (zeros - 1 << k) + take(bits, k)
    return high + 1 + d if take(bits, 1) else low - 1 - d


def read_ls_pixel(bits: Iterator[int], interval: tuple[int, int, int], depth: int) -> int:
    low, m, k = interval
    zeros = 0
    while take(bits, 1) == 0:
        zeros += 1
        if zeros > 9:
            raise OracleError("ten zeros")
    if zeros == 9:
        return take(bits, depth)
    if zeros == 0:
        return low + take(bits, m)
    d = (zeros - 1 << k) + take(bits, k)
    return low + (1 << m) + d if take(bits, 1) else low - 1 - d


def decode(data: bytes) -> NDArray[np.uint16]:
    """The pixels of a sound image; raises OracleError where the pixels cannot be read."""
    if data[:2] != b"\xff\xe8" or data[-2:] != b"\xff\xe9":
        raise OracleError("markers")
    body = unstuff(data[2:-2])
    version, model, depth, mask, width, height, count, checksum, table_length = struct.unpack_from(
        "<BBBBIIHIH", body
    )
    at = struct.calcsize("<BBBBIIHIH")
    table = body[at : at + table_length]
    at += table_length
    lengths = struct.unpack_from(f"<{count}I", body, at)
    at += 4 * count
    (header_checksum,) = struct.unpack_from("<I", body, at)
    if version != 1 or model not in (RAW, FELICS, FELICS_LS) or crc32c(body[:at]) != header_checksum:
        raise OracleError("header")
    at += 4
    streams = []
    for length in lengths:
        streams.append(bits_of(bytes(byte ^ mask for byte in body[at : at + length])))
        at += length
    if at != len(body):
        raise OracleError("lengths")
    image = np.zeros((height, width), np.uint16)
    for y, x in np.ndindex(height, width):
        bits = streams[y % count]
        match model:
            case 1:
                value = read_pixel(bits, *neighbours(image, y, x, depth), table, depth)
            case 2:
                value = read_ls_pixel(
                    bits, ls_interval(ls_neighbours(image, y, x, depth), table, depth), depth
                )
            case _:
                value = take(bits, depth)
        if not 0 <= value < 1 << depth:
            raise OracleError("value")
        image[y, x] = value
    if pixel_checksum(image) != checksum:
        raise OracleError("checksum")
    return image
