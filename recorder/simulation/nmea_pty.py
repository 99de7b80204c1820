"""The twin of a GNSS receiver: a pseudo-terminal that speaks NMEA at a serial line's pace.

``python -m recorder.simulation.nmea_pty`` prints the path of the terminal and plays a train that
runs on a straight course, until it is ended.
"""

import math
import os
import pty
import select
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Self

SECOND_NS = 1_000_000_000
CHUNK_BYTES = 16
"""What a serial adapter hands over at a time; 33 ms at 4800 baud."""
EARTH_RADIUS_M = 6_371_000.0
_POLL_S = 0.02
_KNOT_M_S = 1852 / 3600


class NmeaPty:
    """Speaks the bursts it is given, one after the other; an empty one means not yet.

    The terminal is left as the kernel makes it, cooked and with echo, like a real port: what its
    opener does about that shows in `received`. Nobody listening is no reason to wait.

    Args:
        bursts: each a sequence of sentences (or one sentence), bytes with their line end.
        baud: the pace; ten bits a byte.
    """

    def __init__(self, bursts: Iterable[Sequence[bytes] | bytes] = (), *, baud: int = 4800) -> None:
        self._bursts = iter(bursts)
        self.baud = baud
        self._master, self._slave = pty.openpty()
        os.set_blocking(self._master, False)
        self.path = Path(os.ttyname(self._slave))
        """What the driver opens."""
        self.silent = False
        """Fault: stop talking while True (what would have been said is lost)."""
        self.spoil_checksums = False
        """Fault: every sentence with a wrong checksum while True."""
        self.cut_lines = False
        """Fault: the second half of every third sentence is missing while True."""
        self.chunk_bytes = CHUNK_BYTES
        """Fault: with 1, every byte comes in a write of its own."""
        self.echo = False
        """Fault: say back what was written to the receiver while True."""
        self._said = 0
        self._stop, self._lock = threading.Event(), threading.Lock()
        self._received, self._injected = bytearray(), bytearray()
        self._thread = threading.Thread(target=self._run, name="nmea-pty")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.unplug()

    @property
    def received(self) -> bytes:
        """All that was written to the receiver, and what the terminal echoed."""
        with self._lock:
            return bytes(self._received)

    def inject(self, data: bytes) -> None:
        """Fault: say these bytes next, between two chunks of what is being said."""
        with self._lock:
            self._injected += data

    def unplug(self) -> None:
        """Fault, and the end: the line goes dead under whoever holds it. Safe to call twice."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        with self._lock:
            ends, self._master, self._slave = (self._master, self._slave), -1, -1
        for end in ends:
            if end >= 0:
                os.close(end)

    def _run(self) -> None:
        due_s = time.monotonic()
        queue = bytearray()
        while not self._stop.is_set():
            if not queue:
                queue += self._next_burst()
            with self._lock:
                say, self._injected[:] = bytes(self._injected), b""
            if not say:
                say = bytes(queue[: self.chunk_bytes])
                del queue[: self.chunk_bytes]
            if say and not self.silent:
                self._say(say)
            self._listen()
            now_s = time.monotonic()
            line_s = 10 * len(say) / self.baud
            due_s = due_s + line_s if say else now_s + _POLL_S
            due_s = max(due_s, now_s - line_s)
            self._stop.wait(max(0.0, due_s - now_s))

    def _next_burst(self) -> bytes:
        burst = next(self._bursts, b"")
        sentences = [burst] if isinstance(burst, bytes) else burst
        return b"".join(map(self._faulty, sentences))

    def _faulty(self, sentence: bytes) -> bytes:
        self._said += 1
        if self.cut_lines and self._said % 3 == 0:
            return sentence[: len(sentence) // 2]
        return spoilt(sentence) if self.spoil_checksums else sentence

    def _say(self, data: bytes) -> None:
        self._put(data)

    def _put(self, data: bytes) -> None:
        with suppress(BlockingIOError):  # nobody reads: lost, as on a serial line
            os.write(self._master, data)

    def _listen(self) -> None:
        while select.select([self._master], [], [], 0)[0]:
            self._hear(os.read(self._master, 4096))

    def _hear(self, data: bytes) -> None:
        with self._lock:
            self._received += data
            if self.echo:
                self._injected += data


def sentence(body: str) -> bytes:
    """``$body*hh`` with its checksum and line end."""
    total = 0
    for byte in body.encode("ascii"):
        total ^= byte
    return f"${body}*{total:02X}\r\n".encode("ascii")


def spoilt(line: bytes) -> bytes:
    """The sentence with one bit of its checksum wrong."""
    body, mark, rest = line.rpartition(b"*")
    return body + mark + (b"%02X" % (int(rest[:2], 16) ^ 1)) + rest[2:] if mark else line


def burst(
    utc_ns: int,
    latitude_deg: float,
    longitude_deg: float,
    speed_m_s: float,
    course_deg: float,
    *,
    fix: bool = True,
) -> list[bytes]:
    """GGA, GSA, RMC and ZDA of one instant, in the order and the formats of a BU-353S4 with ZDA on.

    Args:
        utc_ns: Unix-like; told to the millisecond, cut off.
        fix: False while no satellite is received: then the time is the receiver's own idea.
    """
    seconds, rest_ns = divmod(utc_ns, SECOND_NS)
    when = datetime.fromtimestamp(seconds, UTC)
    clock = f"{when:%H%M%S}.{rest_ns // 1_000_000:03d}"
    if not fix:
        return [
            sentence(f"GPGGA,{clock},,,,,0,00,,,M,0.0,M,,0000"),
            sentence("GPGSA,A,1,,,,,,,,,,,,,,,"),
            sentence(f"GPRMC,{clock},V,,,,,,,{when:%d%m%y},,,N"),
            sentence(f"GPZDA,{clock},{when:%d,%m,%Y},00,00"),
        ]
    latitude = _angle(latitude_deg, 2, "NS")
    longitude = _angle(longitude_deg, 3, "EW")
    speed = f"{speed_m_s / _KNOT_M_S:.2f},{course_deg % 360:.2f}"
    return [
        sentence(f"GPGGA,{clock},{latitude},{longitude},1,08,0.9,540.0,M,48.0,M,,0000"),
        sentence("GPGSA,A,3,15,17,30,28,01,19,24,11,,,,,1.8,0.9,1.5"),
        sentence(f"GPRMC,{clock},A,{latitude},{longitude},{speed},{when:%d%m%y},,,A"),
        sentence(f"GPZDA,{clock},{when:%d,%m,%Y},00,00"),
    ]


def _angle(degrees: float, digits: int, signs: str) -> str:
    """``dddmm.mmmm,N``; rounded before it is divided, so that no minute reads 60."""
    whole, parts = divmod(round(abs(degrees) * 600_000), 600_000)
    minutes, fraction = divmod(parts, 10_000)
    return f"{whole:0{digits}d}{minutes:02d}.{fraction:04d},{signs[degrees < 0]}"


def moving_train(
    latitude_deg: float,
    longitude_deg: float,
    *,
    speed_m_s: float,
    course_deg: float,
    clock_ns: Callable[[], int],
    delay_ns: int = 600_000_000,
) -> Iterator[list[bytes]]:
    """A train on a straight course: a burst for each whole second of the clock, else an empty one.

    The first instant is at the given place. Plane geometry: good for some tens of kilometres.

    Args:
        clock_ns: UTC, Unix-like.
        delay_ns: how long after its second a burst begins to be said.
    """
    start_s = told_s = (clock_ns() - delay_ns) // SECOND_NS
    course = math.radians(course_deg)
    while True:
        now_s = (clock_ns() - delay_ns) // SECOND_NS
        if now_s <= told_s:
            yield []
            continue
        told_s = now_s
        way_m = speed_m_s * (now_s - start_s - 1)
        north_deg = math.degrees(way_m * math.cos(course) / EARTH_RADIUS_M)
        east_deg = math.degrees(way_m * math.sin(course) / EARTH_RADIUS_M)
        east_deg /= math.cos(math.radians(latitude_deg))
        place = latitude_deg + north_deg, longitude_deg + east_deg
        yield burst(now_s * SECOND_NS, *place, speed_m_s, course_deg)


def main() -> None:
    train = moving_train(46.9533, 7.4826, speed_m_s=24.0, course_deg=135.0, clock_ns=time.time_ns)
    with NmeaPty(train) as receiver:
        sys.stdout.write(f"{receiver.path}\n")
        sys.stdout.flush()
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            return


if __name__ == "__main__":
    main()
