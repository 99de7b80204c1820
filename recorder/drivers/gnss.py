"""A GNSS receiver on a serial line that speaks NMEA 0183, such as the BU-353."""

import errno
import fcntl
import struct
import termios
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType

import serial
from serial.tools.list_ports_linux import SysFS

from recorder.clock import SYSTEM_CLOCK, Clock
from recorder.config import GnssSection
from recorder.drivers.gnss_setup import RATES, Action, ReceiverSetup, Say, SetBaud
from recorder.drivers.nmea import FixAssembler, SentenceSplitter
from recorder.errors import DeviceAbsent, DeviceBusy, DeviceDenied, DeviceError, DeviceLost, DeviceUnsuitable
from recorder.samples import Fix, LogLine, NmeaSentence

SILENCE_S = 0.1
"""After so long without a byte a burst has ended. A receiver at 4800 baud pauses for 0.14 s or more
between bursts, and for at most 33 ms within one; also how soon the caller gets the word back."""
IDLE_NS = 100_000_000
"""None is yielded after so long without a sample, also while bytes trickle in."""

_ICOUNTER = struct.Struct("20i")
"""``struct serial_icounter_struct`` of linux/serial.h; framing errors are the seventh."""

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
    """Yields every `NmeaSentence` as it arrives, a `Fix` after each burst of them, and a `LogLine`
    for what is found out about the receiver.

    The port is locked against a second program, and raw and without echo at once. Every byte that
    arrives from then on is handed out, also at the wrong rate and in another protocol; the arrival
    of what the kernel had buffered before `samples` is not known and dates no fix. What is done to
    bring the receiver to say what serves: `gnss_setup`.
    """

    live = True

    def __init__(self, settings: GnssSection, *, name: str = "gnss", clock: Clock = SYSTEM_CLOCK) -> None:
        self.name = name
        self._path, self._clock, self._configure = settings.source, clock, settings.configure
        self._rates: tuple[int, ...] = RATES if settings.baud == "auto" else (settings.baud,)
        self._port: serial.Serial | None = None
        self._setup = self._new_setup()
        self._framing_errors: int | None = None

    def open(self) -> None:
        """Open and set up the port, at the rate that served last.

        Raises `DeviceAbsent`, `DeviceDenied`, `DeviceBusy`, or `DeviceUnsuitable` if it is no
        serial line or refuses the rate.
        """
        self.close()
        if self._setup.speaks:
            self._rates = (self._setup.baud, *(rate for rate in self._rates if rate != self._setup.baud))
        self._setup = self._new_setup()
        try:
            # pyserial opens with O_NOCTTY and O_NONBLOCK, takes flock, sets raw, flushes the input.
            self._port = serial.Serial(
                self._path, self._setup.baud, timeout=SILENCE_S, write_timeout=SILENCE_S, exclusive=True
            )
            fcntl.ioctl(self._port.fileno(), termios.TIOCEXCL)  # for programs that take no flock
        except (OSError, ValueError, termios.error) as error:
            self.close()
            raise self._refused(error) from error
        self._framing_errors = _framing_errors(self._port.fileno())

    def samples(self) -> Iterator[NmeaSentence | Fix | LogLine | None]:
        """Sentences, fixes and events; None at least every 0.2 s. Raises `DeviceLost` if it is
        unplugged, `DeviceUnsuitable` if it speaks a protocol that it can't be brought out of."""
        splitter, assembler = SentenceSplitter(), FixAssembler()
        try:
            yield from self._listen(splitter, assembler)
        except DeviceError:
            yield from splitter.flush()  # what had arrived is kept, also half a line
            if fix := assembler.silence():
                yield fix
            raise

    def _listen(
        self, splitter: SentenceSplitter, assembler: FixAssembler
    ) -> Iterator[NmeaSentence | Fix | LogLine | None]:
        assembler.interrupted()
        yielded_ns = self._clock.raw_ns()
        reads, dated = self._read_buffered(), False
        while True:
            told: list[NmeaSentence | Fix | LogLine] = []
            sentences: list[NmeaSentence] = []
            for data, raw_ns in reads:
                for sentence in splitter.feed(data, raw_ns):
                    fix = assembler.add(sentence, dated=dated)
                    told += [sentence] if fix is None else [fix, sentence]
                    sentences.append(sentence)
            if dated and not reads and (fix := assembler.silence()):
                told.append(fix)
            dated = True
            yield from told
            for action in self._setup.hear(
                b"".join(data for data, _ in reads),
                sentences,
                self._clock.raw_ns(),
                framing_errors=self._new_framing_errors(),
            ):
                if isinstance(action, SetBaud) and (fix := assembler.interrupted()):
                    yield fix
                if line := self._do(action):
                    yield line
            now_ns = self._clock.raw_ns()
            if told:
                yielded_ns = now_ns
            elif not reads or now_ns - yielded_ns >= IDLE_NS:
                yielded_ns = now_ns
                yield None
            reads = self._read()

    def describe(self) -> MappingProxyType[str, str]:
        """Port, rate, what it speaks as far as that is known, and what USB says of the adapter."""
        told = {"port": self._path, "baud": str(self._setup.baud)}
        if self._setup.speaks:
            told["protocol"] = self._setup.speaks
        if self._setup.obeys is not None:
            told["obeys"] = "yes" if self._setup.obeys else "no"
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

    def _new_setup(self) -> ReceiverSetup:
        return ReceiverSetup(self._rates, configure=self._configure, where=self._path)

    def _do(self, action: Action) -> LogLine | None:
        """Do what the setup asks for; an event if there is something to tell."""
        port = self._open_port()
        if isinstance(action, Say):
            return LogLine(self._clock.raw_ns(), action.level, self.name, action.message)
        try:
            if isinstance(action, SetBaud):
                port.flush()  # what was said to it leaves at the old rate
                port.baudrate = action.baud
            else:
                port.write(action.data)
        except (OSError, termios.error) as error:  # an unplugged one shows at the next read
            return LogLine(self._clock.raw_ns(), "warning", self.name, f"cannot be set up: {error}")
        return None

    def _open_port(self) -> serial.Serial:
        if self._port is None:
            raise DeviceLost("not open", where=self._path)
        return self._port

    def _read(self) -> list[tuple[bytes, int]]:
        """Wait for a byte, then take what else is there, each with the raw time right after.

        Two stamps, not one: the first byte after a pause is what the time of a burst stands on,
        and a stamp that is too early would spoil more than one that is too late.
        """
        port = self._open_port()
        try:
            first = bytes(port.read(1))
            raw_ns = self._clock.raw_ns()
            if not first:
                return []
            rest = bytes(port.read(port.in_waiting))
            return [(first, raw_ns), (rest, self._clock.raw_ns())] if rest else [(first, raw_ns)]
        except OSError as error:
            todo = "check plug and cable"
            raise DeviceLost("the receiver went away", where=self._path, todo=todo) from error

    def _read_buffered(self) -> list[tuple[bytes, int]]:
        """What has arrived since the port was opened, while nobody asked for it."""
        port = self._open_port()
        with suppress(OSError):  # an unplugged one shows at the next read
            if data := bytes(port.read(port.in_waiting)):
                return [(data, self._clock.raw_ns())]
        return []

    def _new_framing_errors(self) -> int:
        """Since the last call; none where the line does not count them."""
        if self._framing_errors is None or self._port is None or not self._setup.hunting:
            return 0
        count = _framing_errors(self._port.fileno())
        if count is None:
            return 0
        new, self._framing_errors = count - self._framing_errors, count
        return max(new, 0)

    def _refused(self, error: Exception) -> DeviceError:
        code = error.errno if isinstance(error, OSError) else None
        if code in _REFUSALS:
            kind, what, todo = _REFUSALS[code]
            return kind(what, where=self._path, todo=todo)
        what = f"not a serial line that can be set to {self._setup.baud} baud"
        return DeviceUnsuitable(what, where=self._path, todo="name the receiver's port, such as /dev/ttyUSB0")


def _framing_errors(port: int) -> int | None:
    """As the kernel has counted them; None where the line has no such count."""
    try:
        counts = fcntl.ioctl(port, termios.TIOCGICOUNT, bytes(_ICOUNTER.size))
    except OSError:
        return None
    return int(_ICOUNTER.unpack(counts)[6])
