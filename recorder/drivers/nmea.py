"""NMEA 0183 as GNSS receivers speak it: bytes to sentences, sentences to fixes.

No byte is lost on the way: whatever is not a sound sentence is handed out too, with its problem.
"""

import re
from dataclasses import dataclass
from datetime import date
from math import isfinite

from pynmeagps import VALCKSUM, NMEAReader
from pynmeagps.exceptions import NMEAMessageError, NMEAParseError, NMEATypeError

from recorder.samples import Fix, NmeaSentence, Stamp

SECOND_NS = 1_000_000_000
DAY_NS = 86_400 * SECOND_NS
LONGEST_LINE = 256
"""Bytes; the standard allows 82, proprietary sentences are longer."""
READ_KINDS = ("RMC", "GGA", "ZDA", "GSA")
"""The sentences that carry what a `Fix` holds (report 3.2.6.2)."""

_READ_HEADS = tuple(f"{kind},".encode() for kind in READ_KINDS)
_PIECE = re.compile(rb"[$!]?[^\n$!]*\n?")
_SENTENCE = re.compile(rb"[$!]([ -~]*)\*([0-9A-Fa-f]{2})[\r\n]*")
_TAIL = re.compile(rb"[ -~]*\*[0-9A-Fa-f]{2}\r*\n")
_BROKEN_OFF = re.compile(rb"[$!][ -~]*[\r\n]*")
_TIME = re.compile(r"(\d\d)(\d\d)(\d\d)(?:\.(\d*))?", re.ASCII)
_ANGLE = re.compile(r"(\d{0,3})(\d\d)(?:\.(\d*))?", re.ASCII)
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)", re.ASCII)
_KNOT_M_S = 1852 / 3600
_EPOCH_DAY = date(1970, 1, 1).toordinal()
_SATELLITE_MODES = frozenset("ADFPR")
"""Of RMC: autonomous, differential, float RTK, precise, RTK. E, M, S and N are not fixes."""
_OTHER_MODES = {"E": "estimated", "M": "manual", "S": "simulated", "N": "no fix"}
_SATELLITE_QUALITIES = frozenset("123459")
"""Of GGA: GPS, differential, PPS, RTK, float RTK, SBAS. 0, 6, 7 and 8 are not fixes."""
_OTHER_QUALITIES = {"0": "no fix", "6": "estimated", "7": "manual", "8": "simulated"}
_DATE_KEPT_NS = DAY_NS // 2


class SentenceSplitter:
    """Cuts a byte stream into lines; joined again they are the stream, byte for byte.

    A piece begins at ``$`` or ``!`` and ends after a line feed or before the next beginning; what
    stands between pieces ends likewise. After 256 bytes without an end a piece is cut off. The
    result does not depend on how the stream was divided into reads. Holds at most 256 bytes.
    """

    def __init__(self) -> None:
        self._pending = b""
        self._pending_raw_ns = 0

    def feed(self, data: bytes, raw_ns: int) -> list[NmeaSentence]:
        """The pieces that are complete with ``data``, all of which arrived at ``raw_ns``."""
        buffer, arrived_ns = self._pending + data, self._pending_raw_ns if self._pending else raw_ns
        pieces: list[NmeaSentence] = []
        start = 0
        while start < len(buffer):
            end = _piece_end(buffer, start)
            if end is None:
                break
            pieces.append(_piece(buffer[start:end], arrived_ns))
            start, arrived_ns = end, raw_ns
        self._pending, self._pending_raw_ns = buffer[start:], arrived_ns
        return pieces

    def flush(self) -> list[NmeaSentence]:
        """What is left when the stream has ended."""
        pieces = [_piece(self._pending, self._pending_raw_ns)] if self._pending else []
        self._pending = b""
        return pieces


def _piece_end(buffer: bytes, start: int) -> int | None:
    match = _PIECE.match(buffer, start)
    end = match.end() if match else start
    if end - start > LONGEST_LINE:
        return start + LONGEST_LINE
    return end if end < len(buffer) or buffer.endswith(b"\n") else None


def _piece(data: bytes, raw_ns: int) -> NmeaSentence:
    return NmeaSentence(Stamp(raw_ns=raw_ns), data, _problem(data))


def _problem(data: bytes) -> str:
    """Empty, "checksum", "fields" (sound, but they cannot be read), "cut" or "garbage".

    A line without a checksum counts as cut: it cannot be told from one that lost its end.
    """
    if match := _SENTENCE.fullmatch(data):
        if checksum(match[1]) != int(match[2], 16):
            return "checksum"
        return "fields" if _is_read(data) and _read(data) is None else ""
    if len(data) < LONGEST_LINE and (_BROKEN_OFF.fullmatch(data) or _TAIL.fullmatch(data)):
        return "cut"
    return "garbage"


def checksum(body: bytes) -> int:
    """Exclusive or of what stands between ``$`` and ``*``."""
    total = 0
    for byte in body:
        total ^= byte
    return total


@dataclass(frozen=True, slots=True)
class Told:
    """What one RMC, GGA, ZDA or GSA sentence says; whatever it leaves empty is None or ""."""

    kind: str
    talker: str
    time_of_day_ns: int | None
    """Up to and including the leap second 23:59:60; None in GSA, which tells none."""
    day: int | None = None
    """Days since 1970-01-01."""
    status: str = ""
    """RMC: A or V."""
    mode: str = ""
    """RMC of NMEA 2.3 and newer: A, D, E, F, M, N, P, R, S."""
    quality: str = ""
    """GGA: 0 to 9."""
    satellites: int | None = None
    hdop: float | None = None
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    altitude_m: float | None = None
    speed_m_s: float | None = None
    course_deg: float | None = None
    dimensions: int | None = None
    """GSA: 1 for no fix, 2, 3."""


def parse(sentence: NmeaSentence) -> Told | None:
    """What a sound RMC, GGA, ZDA or GSA sentence says; None for any other."""
    return None if sentence.problem or not _is_read(sentence.data) else _read(sentence.data)


def _is_read(data: bytes) -> bool:
    """Garmin's ``$PGRMC`` is not one of them: behind P stands a maker, not a talker."""
    return data[:1] == b"$" and data[1:2] != b"P" and data[3:7] in _READ_HEADS


def _read(data: bytes) -> Told | None:
    """None if the fields are not what they should be."""
    try:
        message = NMEAReader.parse(data, validate=VALCKSUM)
    except (NMEAParseError, NMEAMessageError, NMEATypeError):
        return None
    if message is None:
        return None
    # The fields are taken as text: pynmeagps's own time loses :60 and its positions are rounded.
    fields = [*map(str, message.payload), *[""] * 15]
    kind, talker = str(message.msgID), str(message.talker)
    if kind == "GSA":
        return Told(kind, talker, None, dimensions=int(fields[1]) if fields[1] in ("1", "2", "3") else None)
    time_ns = time_of_day(fields[0])
    if kind == "ZDA":
        return Told(kind, talker, time_ns, day=_day(fields[3], fields[2], fields[1]))
    if kind == "GGA":
        return Told(
            kind,
            talker,
            time_ns,
            quality=fields[5],
            satellites=int(fields[6]) if fields[6].isdecimal() else None,
            hdop=_number(fields[7]),
            latitude_deg=degrees(fields[1], fields[2]),
            longitude_deg=degrees(fields[3], fields[4]),
            altitude_m=_number(fields[8]),
        )
    speed_knots = _number(fields[6])
    return Told(
        kind,
        talker,
        time_ns,
        day=_day(fields[8][4:], fields[8][2:4], fields[8][:2]) if len(fields[8]) == 6 else None,
        status=fields[1],
        mode=fields[11],
        latitude_deg=degrees(fields[2], fields[3]),
        longitude_deg=degrees(fields[4], fields[5]),
        speed_m_s=None if speed_knots is None else speed_knots * _KNOT_M_S,
        course_deg=_number(fields[7]),
    )


def time_of_day(text: str) -> int | None:
    """``hhmmss.sss`` in nanoseconds since midnight, or None; second 60 is let through."""
    match = _TIME.fullmatch(text)
    if match is None:
        return None
    hour, minute, second = int(match[1]), int(match[2]), int(match[3])
    if hour > 23 or minute > 59 or second > 60:
        return None
    return (hour * 3600 + minute * 60 + second) * SECOND_NS + int((match[4] or "").ljust(9, "0")[:9])


def degrees(text: str, hemisphere: str) -> float | None:
    """``dddmm.mmmm`` and N, S, E or W in signed degrees, or None; rounded once, at the end."""
    match = _ANGLE.fullmatch(text)
    largest = {"N": 90, "S": 90, "E": 180, "W": 180}.get(hemisphere)
    if match is None or largest is None or int(match[2]) > 59:
        return None
    fraction = match[3] or ""
    scale: int = 10 ** len(fraction)
    minutes = (int(match[1] or 0) * 60 + int(match[2])) * scale + int(fraction or 0)
    if minutes > largest * 60 * scale:
        return None
    return (-minutes if hemisphere in "SW" else minutes) / (60 * scale)


def _number(text: str) -> float | None:
    value = float(text) if _NUMBER.fullmatch(text) else None
    return value if value is not None and isfinite(value) else None


def _day(year: str, month: str, day: str) -> int | None:
    """Days since 1970; a year of two digits is after 1980, when GPS began."""
    if not (year.isdecimal() and month.isdecimal() and day.isdecimal()):
        return None
    full = int(year) if len(year) > 2 else int(year) + (1900 if int(year) >= 80 else 2000)
    try:
        return date(full, int(month), int(day)).toordinal() - _EPOCH_DAY
    except ValueError:
        return None


class FixAssembler:
    """Gathers the sentences that speak of one instant into a `Fix`.

    A burst ends when a sentence tells another time or comes a second time, or after silence. What
    comes late for a burst that silence had ended is not taken for a new one: the fuller fix is
    told again, with the first one's arrival. A burst that was not heard from its beginning tells
    no ``gps_raw_ns``: when its first byte arrived is not known.
    """

    def __init__(self) -> None:
        self._burst: _Burst | None = None
        self._after_silence, self._whole = True, True
        self._lead_raw_ns: int | None = None
        self._date = _LastDate()

    def add(self, sentence: NmeaSentence, *, dated: bool = True) -> Fix | None:
        """Take a sentence; the fix of the burst that it ends, if it does. ``dated`` is False for one
        that had waited before it was read: its stamp is not its arrival."""
        if sentence.problem or sentence.stamp.raw_ns is None:
            return None
        if self._after_silence:
            self._after_silence, self._lead_raw_ns = False, sentence.stamp.raw_ns
        told = parse(sentence)
        if told is None:
            return None
        ended = None
        if self._burst is None or not self._burst.takes(told):
            ended, self._whole = self._end(), dated and (self._whole or self._burst is not None)
            lead_ns = self._lead_raw_ns
            self._burst = _Burst(sentence.stamp.raw_ns if lead_ns is None else lead_ns, whole=self._whole)
        self._burst.add(told)
        self._lead_raw_ns = None
        return ended

    def silence(self) -> Fix | None:
        """The receiver has paused or the stream has ended: the fix told so far, if it is new."""
        self._after_silence, self._lead_raw_ns, self._whole = True, None, True
        return self._end()

    def interrupted(self) -> Fix | None:
        """The line was not listened to until now, or not at the right rate: a burst may be under
        way. The fix of the one before, if it is new."""
        ended, self._burst = self._end(), None
        self._after_silence, self._lead_raw_ns, self._whole = True, None, False
        return ended

    def _end(self) -> Fix | None:
        if self._burst is None or not self._burst.is_new:
            return None
        self._burst.is_new = False
        return self._burst.fix(self._date)


class _LastDate:
    """The date last told, for a burst that tells only a time of day."""

    def __init__(self) -> None:
        self._day: int | None = None
        self._time_ns = self._raw_ns = 0

    def of(self, day: int | None, time_ns: int, raw_ns: int) -> int | None:
        """The date of a burst: its own, or the last one unless midnight may lie between."""
        if day is None and time_ns >= self._time_ns and raw_ns - self._raw_ns < _DATE_KEPT_NS:
            day = self._day
        if day is not None:
            self._raw_ns = raw_ns
        self._day, self._time_ns = day, time_ns
        return day


class _Burst:
    """The sentences of one instant; of two that say the same the first counts, or the better GGA
    or GSA."""

    def __init__(self, raw_ns: int, *, whole: bool) -> None:
        self.is_new = False
        self._raw_ns, self._whole = raw_ns, whole
        self._time_ns: int | None = None
        self._seen: set[tuple[str, str]] = set()
        self._rmc: Told | None = None
        self._gga: Told | None = None
        self._zda: Told | None = None
        self._dimensions: int | None = None

    def takes(self, told: Told) -> bool:
        """Whether a sentence may belong to this burst; several GSAs may, one a constellation."""
        if told.kind == "GSA":
            return True
        same = told.time_of_day_ns is None or self._time_ns in (None, told.time_of_day_ns)
        return same and (told.talker, told.kind) not in self._seen

    def add(self, told: Told) -> None:
        self.is_new = True
        self._seen.add((told.talker, told.kind))
        if self._time_ns is None:
            self._time_ns = told.time_of_day_ns
        if told.kind == "RMC":
            self._rmc = self._rmc or told
        elif told.kind == "ZDA":
            self._zda = self._zda or told
        elif told.kind == "GSA":
            self._dimensions = max(self._dimensions or 0, told.dimensions or 0) or None
        elif self._gga is None or self._gga.quality not in _SATELLITE_QUALITIES:
            self._gga = told

    def fix(self, last_date: _LastDate) -> Fix:
        rmc, gga = self._rmc, self._gga
        place = gga if gga and gga.latitude_deg is not None else rmc or gga
        gps_ns, gps_raw_ns = self._gps_ns(last_date), self._raw_ns if self._whole else None
        problem = self._problem(place)
        return Fix(
            stamp=Stamp(raw_ns=self._raw_ns, gps_ns=gps_ns, gps_raw_ns=gps_raw_ns),
            valid=not problem,
            problem=problem,
            mode="/".join(
                word or "-"
                for word in (rmc.status if rmc else "", rmc.mode if rmc else "", gga.quality if gga else "")
            ),
            satellites=gga.satellites if gga else None,
            hdop=gga.hdop if gga else None,
            latitude_deg=place.latitude_deg if place else None,
            longitude_deg=place.longitude_deg if place else None,
            altitude_m=gga.altitude_m if gga else None,
            speed_m_s=rmc.speed_m_s if rmc else None,
            course_deg=rmc.course_deg if rmc else None,
            dimensions=self._dimensions,
            leap_second=self._time_ns is not None and self._time_ns >= DAY_NS,
        )

    def _gps_ns(self, last_date: _LastDate) -> int | None:
        """Unix-like; the leap second 23:59:60 falls on the next day's first, as gpsd has it."""
        if self._time_ns is None:
            return None
        told = [one.day for one in (self._zda, self._rmc) if one and one.day is not None]
        day = last_date.of(told[0] if told else None, self._time_ns, self._raw_ns)
        return None if day is None else day * DAY_NS + self._time_ns

    def _problem(self, place: Told | None) -> str:
        """Why position and time do not come from satellites now; empty if they do."""
        rmc, gga = self._rmc, self._gga
        if rmc and rmc.status != "A":
            return f"status {rmc.status or 'empty'}"
        if rmc and rmc.mode and rmc.mode not in _SATELLITE_MODES:
            return f"mode {rmc.mode}, {_OTHER_MODES.get(rmc.mode, 'unknown')}"
        if gga and gga.quality not in _SATELLITE_QUALITIES:
            return f"quality {gga.quality or 'empty'}, {_OTHER_QUALITIES.get(gga.quality, 'unknown')}"
        # Some receivers claim quality 1 before they use any satellite; others never count them.
        if gga and gga.satellites == 0 and rmc is None:
            return "no satellite used"
        if self._dimensions == 1:
            return "no fix, says GSA"
        if self._time_ns is None:
            return "no time"
        if place is None or place.latitude_deg is None or place.longitude_deg is None:
            return "no position"
        return ""
