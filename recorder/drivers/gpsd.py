"""A receiver that gpsd holds, through gpsd's socket: ``gpsd://HOST:PORT``.

The protocol is JSON, an object a line, and between them what the receiver said (gpsd_json(5)).
"""

import json
import socket
from collections.abc import Iterator
from datetime import datetime
from math import isfinite
from types import MappingProxyType
from typing import Any
from urllib.parse import SplitResult, urlsplit

from recorder.clock import SYSTEM_CLOCK, Clock
from recorder.config import GnssSection
from recorder.drivers.nmea import SECOND_NS, FixAssembler, SentenceSplitter, parse
from recorder.errors import DeviceAbsent, DeviceLost, DeviceUnsuitable
from recorder.samples import Fix, LogLine, NmeaSentence, PpsEdge, Stamp

PORT = 2947
CONNECT_S = 2.0
POLL_S = 0.1
SILENCE_NS = 300_000_000
"""After so long without a line a burst has ended: gpsd hands on whole sentences, and one takes up to
0.17 s at 4800 baud."""
OLDEST_NS = 2_000_000_000
"""A first byte cannot be longer ago when gpsd tells of it; what says so has had its clock set."""
LONGEST_LINE = 1 << 16
"""Bytes; gpsd's own limit is 10240."""
_NO_FIX = {5: "dead reckoning", 8: "simulated"}
"""States of a TPV in which position and time do not come from satellites."""

Told = NmeaSentence | Fix | PpsEdge | LogLine


class GpsdClient:
    """Yields every line of gpsd's as it arrives, a `Fix` for each burst, and a `PpsEdge` a pulse.

    Where gpsd hands on NMEA the fixes are read from that, as from a serial line: gpsd's own reports
    shift dates that it holds for wrong. They serve where the receiver speaks a binary protocol. A
    report is recorded as a line with the problem "json". A sentence arrives here when it is whole;
    where gpsd says when its first byte came (TOFF) it is stamped with that.
    """

    live = True

    def __init__(self, settings: GnssSection, *, name: str = "gnss", clock: Clock = SYSTEM_CLOCK) -> None:
        self.name = name
        self._source, self._clock = settings.source, clock
        self._socket: socket.socket | None = None
        self._told: dict[str, str] = {}

    def open(self) -> None:
        """Connect and ask for everything. Raises `DeviceAbsent` or `DeviceUnsuitable`."""
        self.close()
        address = self._address()
        watch: dict[str, bool | int | str] = {"enable": True, "json": True, "raw": 1, "pps": True}
        if len(address.path) > 1:
            watch["device"] = address.path
        try:
            where = (address.hostname or "localhost", address.port or PORT)
            self._socket = socket.create_connection(where, timeout=CONNECT_S)
            self._socket.sendall(f"?WATCH={json.dumps(watch)};\n".encode())
            self._socket.settimeout(POLL_S)
        except OSError as error:
            self.close()
            what = f"no gpsd answers ({error.strerror or error})"
            raise DeviceAbsent(
                what, where=self._source, todo="start gpsd, or name its host and port"
            ) from error
        self._told = {"port": self._source}

    def samples(self) -> Iterator[Told | None]:
        """What gpsd says; None at least every 0.2 s. Raises `DeviceLost` if it ends the connection,
        `DeviceUnsuitable` if it is no gpsd."""
        stream = _Stream(self.name, self._clock)
        while True:
            data = self._receive()
            raw_ns = self._clock.raw_ns()
            if data == b"":
                yield from stream.end()
                raise DeviceLost("gpsd ended the connection", where=self._source, todo="look at its log")
            told = stream.silence(raw_ns) if data is None else stream.feed(data, raw_ns)
            if stream.is_alien:
                raise DeviceUnsuitable(
                    "it is no gpsd that answers there", where=self._source, todo="name gpsd's host and port"
                )
            self._told |= stream.description
            yield from told
            if not told:
                yield None

    def describe(self) -> MappingProxyType[str, str]:
        """gpsd's version and its receiver, once they are known."""
        return MappingProxyType(dict(self._told))

    def close(self) -> None:
        connection, self._socket = self._socket, None
        if connection is not None:
            connection.close()

    def _receive(self) -> bytes | None:
        """None after a silence, empty at the end."""
        if self._socket is None:
            raise DeviceLost("not open", where=self._source)
        try:
            return self._socket.recv(1 << 16)
        except TimeoutError:
            return None
        except OSError as error:
            raise DeviceLost(f"gpsd was lost ({error.strerror})", where=self._source) from error

    def _address(self) -> SplitResult:
        try:
            address = urlsplit(self._source)
            _ = address.port  # raises ValueError if it is none
        except ValueError as error:
            todo = "say gpsd://HOST:PORT, such as gpsd://localhost:2947"
            raise DeviceUnsuitable(f"not an address ({error})", where=self._source, todo=todo) from error
        return address


class _Stream:
    """From what arrives on the socket to samples."""

    def __init__(self, name: str, clock: Clock) -> None:
        self._name, self._clock = name, clock
        self._pending, self._pending_raw_ns = b"", 0
        self._last_raw_ns = clock.raw_ns()
        self._first_byte_raw_ns: int | None = None
        self._dated: tuple[int | None, int] | None = None
        self._splitter, self._assembler = SentenceSplitter(), FixAssembler()
        self._assembler.interrupted()
        self._has_nmea = self._greeted = self.is_alien = False
        self._satellites: int | None = None
        self._hdop: float | None = None
        self._pulses = 0
        self.description: dict[str, str] = {}

    def feed(self, data: bytes, raw_ns: int) -> list[Told]:
        told: list[Told] = []
        self._last_raw_ns = raw_ns
        begun_ns = self._pending_raw_ns if self._pending else raw_ns
        *lines, self._pending = (self._pending + data).split(b"\n")
        for line in lines:
            told += self._line(line + b"\n", begun_ns, raw_ns)
            begun_ns = raw_ns
        self._pending_raw_ns = begun_ns
        self.is_alien = self.is_alien or len(self._pending) > LONGEST_LINE
        return told

    def silence(self, raw_ns: int) -> list[Told]:
        """Nothing has come until now."""
        ended = self._has_nmea and raw_ns - self._last_raw_ns >= SILENCE_NS
        fix = self._assembler.silence() if ended else None
        return [] if fix is None else [fix]

    def end(self) -> list[Told]:
        """What is left when the connection has ended."""
        rest, self._pending = self._pending, b""
        told: list[Told] = [*self._splitter.feed(rest, self._pending_raw_ns), *self._splitter.flush()]
        fix = self._assembler.silence()
        return told if fix is None else [*told, fix]

    def _line(self, line: bytes, begun_ns: int, raw_ns: int) -> list[Told]:
        report = _report(line)
        if report is not None:
            return [NmeaSentence(Stamp(raw_ns=begun_ns), line, "json"), *self._read(report, begun_ns, raw_ns)]
        self.is_alien = not self._greeted
        told: list[Told] = []
        first_ns, self._first_byte_raw_ns = self._first_byte_raw_ns, None
        for sentence in self._splitter.feed(line, begun_ns if first_ns is None else first_ns):
            self._has_nmea = self._has_nmea or parse(sentence) is not None
            fix = self._assembler.add(sentence)
            told += [sentence] if fix is None else [fix, sentence]
        return told

    def _read(self, report: dict[str, Any], begun_ns: int, raw_ns: int) -> list[Told]:
        kind = report.get("class")
        self._greeted = self._greeted or kind == "VERSION"
        self.is_alien = not self._greeted
        if kind == "VERSION":
            self.description["gpsd"] = str(report.get("release", ""))
            return []
        if kind in ("DEVICE", "DEVICES"):
            return self._devices(report.get("devices", [report]), raw_ns)
        if kind == "SKY":
            self._satellites, self._hdop = _number(report, "uSat", int), _number(report, "hdop", float)
        elif kind == "PPS" and (clock_ns := _clock_ns(report)) is not None:
            self._pulses += 1
            return [PpsEdge(Stamp(raw_ns=raw_ns, realtime_ns=clock_ns), self._pulses)]
        elif kind == "TOFF" and (clock_ns := _clock_ns(report)) is not None:
            ago_ns = self._clock.realtime_ns() - clock_ns
            self._first_byte_raw_ns = self._clock.raw_ns() - ago_ns if 0 <= ago_ns < OLDEST_NS else None
        elif kind == "ERROR":
            return [LogLine(raw_ns, "warning", self._name, f"gpsd says: {report.get('message', '')}")]
        elif kind == "TPV" and not self._has_nmea:
            return [self._fix(report, begun_ns)]
        return []

    def _devices(self, devices: list[Any], raw_ns: int) -> list[Told]:
        known = [one for one in devices if isinstance(one, dict) and one.get("activated")]
        if not known:
            self.description.pop("receiver", None)
            return [LogLine(raw_ns, "warning", self._name, "gpsd has no receiver that speaks")]
        names = ", ".join(f"{one.get('path', '?')} ({one.get('driver', 'unknown')})" for one in known)
        if names == self.description.get("receiver"):
            return []
        self.description["receiver"] = names
        return [LogLine(raw_ns, "info", self._name, f"gpsd has {names}")]

    def _fix(self, report: dict[str, Any], begun_ns: int) -> Fix:
        """A TPV; of several that tell the same time the first one's arrival counts."""
        mode, status = _number(report, "mode", int) or 0, _number(report, "status", int)
        gps_ns = _time(report.get("time"))
        if self._dated is None or self._dated[0] != gps_ns:
            self._dated = gps_ns, begun_ns
        problem = ""
        if mode < 2:
            problem = f"mode {mode}, no fix"
        elif status in _NO_FIX:
            problem = f"status {status}, {_NO_FIX[status]}"
        elif gps_ns is None:
            problem = "no time"
        elif "lat" not in report or "lon" not in report:
            problem = "no position"
        return Fix(
            stamp=Stamp(raw_ns=self._dated[1], gps_ns=gps_ns, gps_raw_ns=self._dated[1]),
            valid=not problem,
            mode=f"gpsd/{mode}/{'-' if status is None else status}",
            problem=problem,
            dimensions=mode or None,
            satellites=self._satellites,
            hdop=self._hdop,
            latitude_deg=_number(report, "lat", float),
            longitude_deg=_number(report, "lon", float),
            altitude_m=_number(report, "altMSL", float),
            speed_m_s=_number(report, "speed", float),
            course_deg=_number(report, "track", float),
        )


def _report(line: bytes) -> dict[str, Any] | None:
    if not line.startswith(b"{"):
        return None
    try:
        report = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return report if isinstance(report, dict) else None


def _clock_ns(report: dict[str, Any]) -> int | None:
    """CLOCK_REALTIME that a report of a pulse or of a first byte tells."""
    seconds, nanoseconds = _number(report, "clock_sec", int), _number(report, "clock_nsec", int)
    return None if seconds is None or nanoseconds is None else seconds * SECOND_NS + nanoseconds


def _number(report: dict[str, Any], key: str, kind: type[Any]) -> Any:
    value = report.get(key)
    known = isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
    return kind(value) if known else None


def _time(text: object) -> int | None:
    """``2024-02-05T12:00:00.000Z`` in nanoseconds, Unix-like."""
    if not isinstance(text, str):
        return None
    whole, _, rest = text.removesuffix("Z").partition(".")
    try:
        seconds = int(datetime.fromisoformat(whole + "+00:00").timestamp())
    except ValueError:
        return None
    return seconds * SECOND_NS + int(rest.ljust(9, "0")[:9]) if rest.isdecimal() or not rest else None
