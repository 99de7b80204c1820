"""A recorded NMEA log, played as if the receiver spoke."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import BinaryIO

from recorder.clock import SYSTEM_CLOCK, Clock
from recorder.drivers.nmea import DAY_NS, SECOND_NS, FixAssembler, SentenceSplitter, parse
from recorder.errors import SourceError
from recorder.samples import Fix, NmeaSentence, Stamp

NAP_NS = 100_000_000
"""The longest sleep before the caller may look at its stop event."""
BACK_NS = 10 * SECOND_NS
FORWARD_NS = 3600 * SECOND_NS
"""A log whose time falls back or leaps ahead by more had its clock set: the replay goes on from
where it is. A smaller step back is disorder and is waited out; a smaller leap is a real pause."""


class NmeaLog:
    """Yields the log's sentences, stamped by the log's own seconds, and a `Fix` after each burst.

    A log holds no arrival times. All sentences from one that tells a new time of day up to the
    next such arrive at one instant: the origin plus the time told since the first one. Those
    before the first told time arrive at the origin; the arrival never goes backwards. Comment
    lines (``#``) are not data.

    Args:
        path: the log.
        origin_raw_ns: arrival of the first sentence; when `samples` is first asked if None.
        realtime: each sentence not before the instant it is stamped with, rather than at once.
    """

    live = False

    def __init__(
        self,
        path: Path,
        *,
        name: str = "gnss",
        origin_raw_ns: int | None = None,
        realtime: bool,
        clock: Clock = SYSTEM_CLOCK,
    ) -> None:
        self.name = name
        self._path, self._origin_ns, self._realtime, self._clock = Path(path), origin_raw_ns, realtime, clock
        self._file: BinaryIO | None = None

    def open(self) -> None:
        """Open the log and look for a first sound sentence. Raises `SourceError`."""
        self.close()
        try:
            if self._path.exists() and not self._path.is_file():  # a pipe would be waited for, for ever
                todo = "give the path of an NMEA log"
                raise SourceError("not a file", where=str(self._path), todo=todo)
            self._file = self._path.open("rb")
            sound = any(not sentence.problem for sentence in _sentences(self._file))
            self._file.seek(0)
        except OSError as error:
            self.close()
            what = f"cannot be read ({error.strerror or error})"
            raise SourceError(what, where=str(self._path), todo="give the path of an NMEA log") from error
        if not sound:
            self.close()
            what, todo = (
                "no sound NMEA sentence in it",
                "give a log of lines such as $GPRMC,…*hh, with checksums",
            )
            raise SourceError(what, where=str(self._path), todo=todo)

    def samples(self) -> Iterator[NmeaSentence | Fix | None]:
        """Sentences and fixes; with ``realtime`` None every 0.1 s in between. Raises `SourceError`."""
        if self._file is None:
            raise SourceError("not open", where=str(self._path))
        origin_ns = self._clock.raw_ns() if self._origin_ns is None else self._origin_ns
        seconds, assembler = _LogTime(), FixAssembler()
        try:
            for sentence in _sentences(self._file):
                told = parse(sentence)
                elapsed_ns = seconds.elapsed_ns(told.time_of_day_ns if told else None)
                stamped = replace(sentence, stamp=Stamp(raw_ns=origin_ns + elapsed_ns))
                if fix := assembler.add(stamped):
                    yield fix  # before the wait: it is known since the former burst
                if self._realtime:
                    yield from self._wait(origin_ns + elapsed_ns)
                yield stamped
        except OSError as error:
            raise SourceError(f"cannot be read ({error.strerror})", where=str(self._path)) from error
        if fix := assembler.silence():
            yield fix

    def describe(self) -> MappingProxyType[str, str]:
        return MappingProxyType({"log": str(self._path)})

    def close(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            file.close()

    def _wait(self, due_ns: int) -> Iterator[None]:
        while (left_ns := due_ns - self._clock.raw_ns()) > 0:
            time.sleep(min(left_ns, NAP_NS) / SECOND_NS)
            yield None


class _LogTime:
    """From times of day to a time since the first one that never goes backwards."""

    def __init__(self) -> None:
        self._last_ns: int | None = None
        self._told_ns = 0
        self._elapsed_ns = 0

    def elapsed_ns(self, time_of_day_ns: int | None) -> int:
        if time_of_day_ns is not None:
            if self._last_ns is not None:
                # The shorter way round the clock: over midnight is one second, not minus a day.
                step_ns = (time_of_day_ns - self._last_ns + DAY_NS // 2) % DAY_NS - DAY_NS // 2
                self._told_ns += step_ns
                if not self._elapsed_ns - BACK_NS <= self._told_ns <= self._elapsed_ns + FORWARD_NS:
                    self._told_ns = self._elapsed_ns
                self._elapsed_ns = max(self._elapsed_ns, self._told_ns)
            self._last_ns = time_of_day_ns
        return self._elapsed_ns


def _sentences(file: BinaryIO) -> Iterator[NmeaSentence]:
    """The log's pieces, not yet stamped, without its comments."""
    splitter = SentenceSplitter()
    at_line_start = True
    while line := file.readline(4096):
        if not (at_line_start and line.startswith(b"#") and _is_text(line)):
            yield from splitter.feed(line, 0)
        at_line_start = line.endswith(b"\n")
    yield from splitter.flush()


def _is_text(line: bytes) -> bool:
    """Whether it may be a comment: in a binary log ``#`` is a byte like any other."""
    return all(byte >= 32 or byte in b"\t\r\n" for byte in line)
