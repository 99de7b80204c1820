"""The kernel's pulse per second, ``/dev/pps*`` (RFC 2783 as linux/pps.h has it)."""

import errno
import fcntl
import os
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType

from recorder.clock import SYSTEM_CLOCK, Clock
from recorder.errors import DeviceAbsent, DeviceDenied, DeviceError, DeviceLost, DeviceUnsuitable
from recorder.samples import PpsEdge, Stamp

SECOND_NS = 1_000_000_000
WAIT_NS = 150_000_000
"""For an edge, until the caller gets the word back."""
FETCH = struct.Struct("@II qiI qiI i4x qiI")
"""``struct pps_fdata``: assert and clear sequence, assert and clear time, mode, timeout; a time is
seconds, nanoseconds and flags."""
PARAMETERS = struct.Struct("@ii qiI qiI")
"""``struct pps_kparams``: version, mode, assert and clear offset."""
CAPTURE_ASSERT = 0x01
CAN_WAIT = 0x100

_POINTER = struct.calcsize("P")
"""What the kernel's macros take for the size: they name a pointer, not what it points to."""


def _request(direction: int, number: int) -> int:
    return direction << 30 | _POINTER << 16 | ord("p") << 8 | number


PPS_GETPARAMS = _request(2, 0xA1)
PPS_GETCAP = _request(2, 0xA3)
PPS_FETCH = _request(3, 0xA4)


class PpsSource:
    """Yields a `PpsEdge` for each rising edge that the kernel stamps."""

    live = True

    def __init__(self, path: str, *, name: str = "pps", clock: Clock = SYSTEM_CLOCK) -> None:
        self.name = name
        self._path, self._clock = path, clock
        self._file: int | None = None

    def open(self) -> None:
        """Raises `DeviceAbsent`, `DeviceDenied`, or `DeviceUnsuitable` if it stamps no rising edges."""
        self.close()
        try:
            self._file = os.open(self._path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
            (able,) = struct.unpack("i", fcntl.ioctl(self._file, PPS_GETCAP, bytes(4)))
            mode = PARAMETERS.unpack(fcntl.ioctl(self._file, PPS_GETPARAMS, bytes(PARAMETERS.size)))[1]
        except (OSError, ValueError) as error:
            self.close()
            raise self._refused(error) from error
        if not (mode & CAPTURE_ASSERT and able & CAN_WAIT):
            self.close()
            raise self._unsuitable("it captures no rising edges")

    def samples(self) -> Iterator[PpsEdge | None]:
        """Edges; None at least every 0.2 s. Raises `DeviceLost` if the source goes away."""
        while True:
            yield self._fetch()

    def describe(self) -> MappingProxyType[str, str]:
        """The node, and what its driver calls the source."""
        told = {"port": self._path}
        with suppress(OSError):
            source = Path("/sys/class/pps", Path(self._path).resolve().name)
            told["model"] = (source / "name").read_text("ascii").strip()
        return MappingProxyType(told)

    def close(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            os.close(file)

    def _fetch(self) -> PpsEdge | None:
        """Wait for the next edge; None if there is none in time."""
        if self._file is None:
            raise DeviceLost("not open", where=self._path)
        ask = bytearray(FETCH.pack(*[0] * 9, 0, WAIT_NS, 0))
        try:
            fcntl.ioctl(self._file, PPS_FETCH, ask)
        except OSError as error:
            if error.errno in (errno.ETIMEDOUT, errno.EINTR):
                return None
            todo = "check the receiver and its line"
            raise DeviceLost("the source of pulses went away", where=self._path, todo=todo) from error
        return edge(bytes(ask), self._clock.raw_ns())

    def _refused(self, error: Exception) -> DeviceError:
        code = error.errno if isinstance(error, OSError) else None
        if code in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
            return DeviceAbsent("no such device", where=self._path, todo="load the driver of its line")
        if code in (errno.EACCES, errno.EPERM):
            return DeviceDenied("no permission", where=self._path, todo="give the user access to it")
        return self._unsuitable("it is no PPS device")

    def _unsuitable(self, what: str) -> DeviceUnsuitable:
        return DeviceUnsuitable(what, where=self._path, todo="name a source of pulses, such as /dev/pps0")


def edge(fetched: bytes, raw_ns: int) -> PpsEdge:
    """The rising edge in what `PPS_FETCH` handed over before ``raw_ns``."""
    sequence, _, seconds, nanoseconds, *_ = FETCH.unpack(fetched)
    return PpsEdge(Stamp(raw_ns=raw_ns, realtime_ns=seconds * SECOND_NS + nanoseconds), sequence)
