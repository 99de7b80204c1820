"""A GNSS receiver on a serial line that speaks NMEA 0183, such as the BU-353."""

import errno
import fcntl
import termios
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType

import serial
from serial.tools.list_ports_linux import SysFS

from recorder.clock import SYSTEM_CLOCK, Clock
from recorder.config import GnssSection
from recorder.drivers.nmea import FixAssembler, SentenceSplitter
from recorder.errors import DeviceAbsent, DeviceBusy, DeviceDenied, DeviceError, DeviceLost, DeviceUnsuitable
from recorder.samples import Fix, NmeaSentence

SILENCE_S = 0.1
"""After so long without a byte a burst has ended. A receiver at 4800 baud pauses for 0.14 s or more
between bursts, and for at most 33 ms within one; also how soon the caller gets the word back."""
IDLE_NS = 100_000_000
"""None is yielded after so long without a sample, also while bytes trickle in."""

_REFUSALS: dict[int, tuple[type[DeviceError], str, str]] = {
    errno.ENOENT: (DeviceAbsent, "no such device", "plug the receiver in, or name its port in drivers.gnss"),
    errno.ENXIO: (DeviceAbsent, "no device behind this port", "plug the receiver in"),
    errno.ENODEV: (DeviceAbsent, "no device behind this port", "plug the receiver in"),
    errno.EACCES: (DeviceDenied, "no permission", "add the user to the group dialout"),
    errno.EPERM: (DeviceDenied, "no permission", "add the user to the group dialout"),
    errno.EAGAIN: (DeviceBusy, "another program holds it", "end it (gpsd, ModemManager, another recorder)"),
    errno.EBUSY: (DeviceBusy, "another program holds it", "end it (gpsd, ModemManager, another recorder)"),
}


class GnssReceiver:
    """Yields every `NmeaSentence` as it arrives, and a `Fix` after each burst of them.

    The port is locked against a second program, raw and without echo at once, and what the kernel
    had buffered before is thrown away: its arrival is not known. Nothing is written to the device.
    """

    live = True

    def __init__(self, settings: GnssSection, *, name: str = "gnss", clock: Clock = SYSTEM_CLOCK) -> None:
        self.name = name
        self._path, self._baud, self._clock = settings.source, settings.baud, clock
        self._port: serial.Serial | None = None

    def open(self) -> None:
        """Open and set up the port.

        Raises `DeviceAbsent`, `DeviceDenied`, `DeviceBusy`, or `DeviceUnsuitable` if it is no
        serial line or refuses the rate.
        """
        self.close()
        try:
            # pyserial opens with O_NOCTTY and O_NONBLOCK, takes flock, sets raw, flushes the input.
            self._port = serial.Serial(self._path, self._baud, timeout=SILENCE_S, exclusive=True)
            fcntl.ioctl(self._port.fileno(), termios.TIOCEXCL)  # for programs that take no flock
        except (OSError, ValueError, termios.error) as error:
            self.close()
            raise self._refused(error) from error

    def samples(self) -> Iterator[NmeaSentence | Fix | None]:
        """Sentences and fixes; None at least every 0.2 s. Raises `DeviceLost` if it is unplugged."""
        splitter, assembler = SentenceSplitter(), FixAssembler()
        yielded_ns = self._clock.raw_ns()
        while True:
            told: list[NmeaSentence | Fix] = []
            try:
                reads = self._read()
            except DeviceLost:
                yield from splitter.flush()  # what had arrived is kept, also half a line
                if fix := assembler.silence():
                    yield fix
                raise
            for data, raw_ns in reads:
                for sentence in splitter.feed(data, raw_ns):
                    fix = assembler.add(sentence)
                    told += [sentence] if fix is None else [fix, sentence]
            if not reads and (fix := assembler.silence()):
                told.append(fix)
            yield from told
            now_ns = self._clock.raw_ns()
            if told:
                yielded_ns = now_ns
            elif not reads or now_ns - yielded_ns >= IDLE_NS:
                yielded_ns = now_ns
                yield None

    def describe(self) -> MappingProxyType[str, str]:
        """Port, rate, and what USB says of the adapter."""
        told = {"port": self._path, "baud": str(self._baud)}
        port = Path(self._path)
        if port.exists():
            usb = SysFS(str(port.resolve()))
            facts = (("vendor", usb.manufacturer), ("model", usb.product), ("serial", usb.serial_number))
            told |= {key: str(value) for key, value in facts if value}
        return MappingProxyType(told)

    def close(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            with suppress(OSError):
                fcntl.ioctl(port.fileno(), termios.TIOCNXCL)
            port.close()

    def _read(self) -> list[tuple[bytes, int]]:
        """Wait for a byte, then take what else is there, each with the raw time right after.

        Two stamps, not one: the first byte after a pause is what the time of a burst stands on,
        and a stamp that is too early would spoil more than one that is too late.
        """
        if self._port is None:
            raise DeviceLost("not open", where=self._path)
        try:
            first = bytes(self._port.read(1))
            raw_ns = self._clock.raw_ns()
            if not first:
                return []
            rest = bytes(self._port.read(self._port.in_waiting))
            return [(first, raw_ns), (rest, self._clock.raw_ns())] if rest else [(first, raw_ns)]
        except OSError as error:
            todo = "check plug and cable"
            raise DeviceLost("the receiver went away", where=self._path, todo=todo) from error

    def _refused(self, error: Exception) -> DeviceError:
        code = error.errno if isinstance(error, OSError) else None
        if code in _REFUSALS:
            kind, what, todo = _REFUSALS[code]
            return kind(what, where=self._path, todo=todo)
        what = f"not a serial line that can be set to {self._baud} baud"
        return DeviceUnsuitable(what, where=self._path, todo="name the receiver's port, such as /dev/ttyUSB0")
