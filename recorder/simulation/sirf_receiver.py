"""The twin of a SiRF receiver such as the BU-353: two protocols, commands, and a rate of its own."""

import math
import struct
import termios
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime

from recorder.simulation.nmea_pty import NmeaPty, burst, sentence

SECOND_NS = 1_000_000_000
COLD_BOOT_NS = 1_140_000_000 * SECOND_NS
"""What the receiver's clock says after a cold boot: a day in February 2006, before its firmware."""
_NUMBERS = {0: "GGA", 1: "GLL", 2: "GSA", 3: "GSV", 4: "RMC", 5: "VTG", 6: "MSS", 8: "ZDA"}
_GPS_EPOCH_NS = 315_964_800 * SECOND_NS
_LEAP_S = 18
_EQUATOR_M, _ECCENTRICITY_2 = 6_378_137.0, 0.00669437999014
"""Of the ellipsoid WGS 84."""
_HEIGHT_M = 540
_SPEEDS = {getattr(termios, f"B{rate}"): rate for rate in (4800, 9600, 19200, 38400, 57600, 115200)}


@dataclass(frozen=True, slots=True)
class Instant:
    """What the receiver knows at one second."""

    utc_ns: int
    latitude_deg: float
    longitude_deg: float
    speed_m_s: float = 0.0
    course_deg: float = 0.0
    fix: bool = True


class SirfReceiver(NmeaPty):
    """Speaks NMEA or SiRF binary about the instants it is given, and does what it is told:
    ``$PSRF100`` (protocol and rate), ``$PSRF103`` (which sentences), binary message 129 (NMEA).

    A pseudo-terminal has no rate. While its opener has set another than the receiver's, what either
    says arrives as a UART at the wrong rate would read it.

    Args:
        instants: None means that there is nothing to tell yet.
        baud: the receiver's own rate.
        binary: in which protocol it wakes up.
        obeys: False for one that ignores every command.
    """

    def __init__(
        self,
        instants: Iterable[Instant | None] = (),
        *,
        baud: int = 4800,
        binary: bool = False,
        obeys: bool = True,
    ) -> None:
        super().__init__(self._bursts_of(iter(instants)), baud=baud)
        self.binary, self.obeys = binary, obeys
        self.intervals = {"GGA": 1, "GSA": 1, "RMC": 1, "GSV": 5}
        """Seconds between two of a kind; as a BU-353 leaves the factory."""
        self._count = 0
        self._pending = bytearray()

    def reset(self, *, baud: int = 4800, binary: bool = False) -> None:
        """Fault: forget all settings, as after a long time without power."""
        self.baud, self.binary = baud, binary
        self.intervals = {"GGA": 1, "GSA": 1, "RMC": 1, "GSV": 5}

    def _bursts_of(self, instants: Iterator[Instant | None]) -> Iterator[Sequence[bytes]]:
        for instant in instants:
            if instant is None:
                yield []
                continue
            yield binary_burst(instant) if self.binary else self._sentences(instant)
            self._count += 1

    def _sentences(self, instant: Instant) -> list[bytes]:
        said = burst(
            instant.utc_ns,
            instant.latitude_deg,
            instant.longitude_deg,
            instant.speed_m_s,
            instant.course_deg,
            fix=instant.fix,
        )
        kinds = {one[3:6].decode("ascii"): [one] for one in said}
        kinds["GSV"] = [sentence(f"GPGSV,3,{n},12,15,40,083,46,17,17,308,41,28,57,212,40") for n in (1, 2, 3)]
        kinds["GLL"] = [sentence("GPGLL,4657.1980,N,00728.9560,E,120000.000,A,A")]
        kinds["VTG"] = [sentence("GPVTG,135.00,T,,M,46.65,N,86.40,K,A")]
        due = [kind for kind in kinds if (n := self.intervals.get(kind, 0)) and self._count % n == 0]
        return [one for kind in due for one in kinds[kind]]

    def _faulty(self, sentence: bytes) -> bytes:
        return sentence if self.binary else super()._faulty(sentence)

    def _say(self, data: bytes) -> None:
        self._put(misread(data, self.baud, self._opened_baud()))

    def _hear(self, data: bytes) -> None:
        super()._hear(data)
        self._pending += misread(data, self._opened_baud(), self.baud)
        while self.obeys and (found := _first_command(self._pending)) is not None:
            command, end = found
            del self._pending[:end]
            with suppress(ValueError, IndexError):  # a command that is none is ignored
                self._obey(command)
        del self._pending[:-200]

    def _obey(self, command: bytes) -> None:
        if command.startswith(b"\xa0\xa2"):
            payload = command[4:-4]
            if self.binary and payload[0] == 129:
                self.intervals = {_NUMBERS[n]: payload[2 + 2 * n] for n in _NUMBERS}
                self.binary, self.baud = False, int.from_bytes(payload[-2:], "big")
            return
        if self.binary:
            return
        words = command[1:-5].decode("ascii").split(",")
        if words[0] == "PSRF103" and words[2] == "00":
            self.intervals[_NUMBERS[int(words[1])]] = int(words[3])
        elif words[0] == "PSRF100" and words[3:] == ["8", "1", "0"]:
            self.binary, self.baud = words[1] == "0", int(words[2])

    def _opened_baud(self) -> int:
        """What the opener has set; the receiver's own if that is no rate of a serial line."""
        with suppress(termios.error):
            return _SPEEDS.get(termios.tcgetattr(self._master)[5], self.baud)
        return self.baud


def _first_command(data: bytes | bytearray) -> tuple[bytes, int] | None:
    """A sound NMEA input sentence or binary message and where it ends."""
    for start in range(len(data)):
        if data[start : start + 2] == b"\xa0\xa2":
            end = start + 8 + int.from_bytes(data[start + 2 : start + 4], "big")
            payload = bytes(data[start + 4 : end - 4])
            if data[start:end] == binary_message(payload):
                return bytes(data[start:end]), end
        elif data[start : start + 1] == b"$":
            end = data.find(b"\r\n", start) + 2
            line = bytes(data[start:end])
            with suppress(UnicodeDecodeError):
                if end > 1 and line == sentence(line[1:-5].decode("ascii")):
                    return line, end
    return None


def misread(data: bytes, said_baud: int, heard_baud: int) -> bytes:
    """What a UART at ``heard_baud`` reads of a line on which ``data`` is said at ``said_baud``.

    Bit for bit, 8N1, the line high before and after: a start bit where the line falls, then each bit
    as it stands in the middle of its time. After a missing stop bit it waits for the line to rise.
    """
    if said_baud == heard_baud:
        return data
    line: list[int] = []
    for byte in data:
        line += [0, *((byte >> n) & 1 for n in range(8)), 1]
    ratio = said_baud / heard_baud  # bits of the line in a bit of the reader

    def level(at: float) -> int:
        return line[int(at)] if at < len(line) else 1

    read, at = bytearray(), 0.0
    while at < len(line):
        if level(at):
            at = math.floor(at) + 1.0
            continue
        read.append(sum(level(at + (n + 1.5) * ratio) << n for n in range(8)))
        at += 9.5 * ratio
        while at < len(line) and not level(at):
            at = math.floor(at) + 1.0
    return bytes(read)


def binary_message(payload: bytes) -> bytes:
    """``A0 A2``, length, payload, the sum of its bytes in 15 bits, ``B0 B3``."""
    return (
        struct.pack(">HH", 0xA0A2, len(payload)) + payload + struct.pack(">HH", sum(payload) & 0x7FFF, 0xB0B3)
    )


def binary_burst(instant: Instant) -> list[bytes]:
    """Messages 2 (measured navigation data), 4 (tracker) and 41 (geodetic) of one instant."""
    seconds, rest_ns = divmod(instant.utc_ns, SECOND_NS)
    when = datetime.fromtimestamp(seconds, UTC)
    gps_ms = (instant.utc_ns - _GPS_EPOCH_NS) // 1_000_000 + _LEAP_S * 1000
    week, tow_ms = divmod(gps_ms, 7 * 86_400_000)
    latitude, longitude = math.radians(instant.latitude_deg), math.radians(instant.longitude_deg)
    normal_m = _EQUATOR_M / math.sqrt(1 - _ECCENTRICITY_2 * math.sin(latitude) ** 2)
    place = (
        round((normal_m + _HEIGHT_M) * math.cos(latitude) * math.cos(longitude)),
        round((normal_m + _HEIGHT_M) * math.cos(latitude) * math.sin(longitude)),
        round((normal_m * (1 - _ECCENTRICITY_2) + _HEIGHT_M) * math.sin(latitude)),
    )
    used = 8 if instant.fix else 0
    measured = struct.pack(
        ">B3i3hBBBHIB12B", 2, *place, 0, 0, 0, 4 if instant.fix else 0, 5, 0, week % 1024, tow_ms // 10, used,
        *range(1, 13),
    )  # fmt: skip
    tracker = struct.pack(">BHIB", 4, week % 1024, tow_ms // 10, 12) + bytes(12 * 15)
    millisecond = when.second * 1000 + rest_ns // 1_000_000
    geodetic = struct.pack(
        ">BHHHIH4BHI4iB2H3h3IHiIi2I2H3B",
        41, 0 if instant.fix else 1, 4 if instant.fix else 0, week, tow_ms,
        when.year, when.month, when.day, when.hour, when.minute, millisecond, 0,
        round(instant.latitude_deg * 1e7), round(instant.longitude_deg * 1e7), *[_HEIGHT_M * 100] * 2, 21,
        round(instant.speed_m_s * 100), round(instant.course_deg % 360 * 100), *[0] * 3,
        *[0] * 3, 0, *[0] * 5, 0, 0, used, 5, 0,
    )  # fmt: skip
    return [binary_message(one) for one in (measured, tracker, geodetic)]


def cold_boot(instants: Iterable[Instant], seconds: int) -> Iterator[Instant]:
    """As after a cold boot: no fix and the date of the receiver's own clock for so many instants."""
    for number, instant in enumerate(instants):
        if number < seconds:
            yield replace(instant, utc_ns=COLD_BOOT_NS + number * SECOND_NS, fix=False)
        else:
            yield instant
