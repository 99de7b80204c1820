"""The twin of a GenICam camera: real GVCP and GVSP over loopback, in its own process.

``python -m recorder.simulation.gige_camera --address 127.0.0.1 --serial RC01`` serves Aravis'
GigE Vision camera, whose description is extended when it starts by the 10- to 16-bit formats,
ExposureTime, Gain, BlackLevel and the like, and whose pixels come from a file or a pattern that
tests can compute. It says "ready" on standard output and ends at SIGTERM.

One camera an address: it binds UDP port 3956. Another than 127.0.0.1 must first be given to the
loopback interface (``ip addr add 127.0.0.2/8 dev lo``).
"""

import argparse
import select
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import IO, Self

from recorder.errors import DeviceError, RecorderError, SourceError
from recorder.simulation.gige_pixels import BIT_DEPTHS, PIXEL_FORMAT_CODES, LeftAligned, Pattern, Stack
from recorder.simulation.gige_server import GigeCamera, aravis


def aravis_problem() -> str:
    """Why no twin can be served on this machine; empty if one can."""
    try:
        aravis()
    except DeviceError as error:
        return str(error)
    return ""


class GigeCameraProcess:
    """A twin in a process of its own, from ``with`` to its end at the latest.

    Args:
        address: where it serves; one twin an address.
        serial: its serial number.
        frames: a ``.npy`` stack or an image folder instead of the built-in pattern.
        options: any other of the command line, such as ``width=320, pixel_format="Mono10"``.

    The process also ends when this one does, however that comes about.
    """

    def __init__(
        self,
        *,
        address: str = "127.0.0.1",
        serial: str = "RC01",
        frames: Path | None = None,
        **options: str | float,
    ) -> None:
        self.address, self.serial = address, serial
        given: dict[str, object] = {"address": address, "serial": serial, "frames": frames, **options}
        self._arguments = [_argument(key, value) for key, value in given.items() if value is not None]
        self._process: subprocess.Popen[bytes] | None = None
        self._errors: IO[bytes] | None = None
        self._last_words = ""

    @property
    def pid(self) -> int:
        return self._running().pid

    def start(self, timeout_s: float = 20.0) -> Self:
        """Start and wait until it serves. Raises `DeviceError` with what it says if it does not."""
        command = [sys.executable, "-m", "recorder.simulation.gige_camera", "--until-stdin-closes"]
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - closed in _end; a pipe could fill up
        self._process = subprocess.Popen(
            [*command, *self._arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
        )
        out = self._process.stdout
        assert out is not None
        ready, _, _ = select.select([out], [], [], timeout_s)
        if not ready or out.readline().strip() != b"ready":
            self.kill()
            raise DeviceError(self._last_words or "did not start", where=f"camera twin at {self.address}")
        return self

    def stop(self) -> None:
        """End it as an operator would, which frees the address; safe twice."""
        self._end(signal.SIGTERM)

    def kill(self) -> None:
        """End it as a power cut would; safe twice."""
        self._end(signal.SIGKILL)

    def pause(self) -> None:
        """Freeze it: it neither sends nor answers until `resume`."""
        self._running().send_signal(signal.SIGSTOP)

    def resume(self) -> None:
        self._running().send_signal(signal.SIGCONT)

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _running(self) -> subprocess.Popen[bytes]:
        if self._process is None:
            raise DeviceError("is not running", where=f"camera twin at {self.address}")
        return self._process

    def _end(self, how: signal.Signals) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        for sent in (how, signal.SIGCONT):  # a frozen process takes no SIGTERM
            process.send_signal(sent)
        try:
            process.communicate(timeout=5)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
        assert self._errors is not None
        self._errors.seek(0)
        self._last_words = self._errors.read().decode(errors="replace").strip().rpartition("\n")[2]
        self._errors.close()


def _argument(key: str, value: object) -> str:
    name = f"--{key.replace('_', '-')}"
    return name if value is True else f"{name}={value}"


def main(arguments: list[str] | None = None) -> int:
    """Serve until SIGTERM, SIGINT or, if asked, until standard input closes."""
    parser = argparse.ArgumentParser(prog="gige_camera", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--address", default="127.0.0.1")
    parser.add_argument("--serial", default="RC01")
    parser.add_argument("--frames", type=Path, help=".npy of uint16 (N, H, W), or a folder of images")
    parser.add_argument("--width", type=int, default=1280)
    parser.add_argument("--height", type=int, default=1024)
    parser.add_argument("--pixel-format", choices=sorted(PIXEL_FORMAT_CODES))
    parser.add_argument("--formats", default=",".join(BIT_DEPTHS), help="what PixelFormat offers")
    parser.add_argument("--rate", type=float, default=59.82, help="images a second until a client sets it")
    parser.add_argument("--packet-bytes", type=int, default=9000, help="until a client sets it")
    parser.add_argument("--loss", type=float, default=0.0, help="share of packets that are dropped")
    parser.add_argument("--left-aligned", action="store_true", help="a fault: Mono10 in the upper bits")
    parser.add_argument("--until-stdin-closes", action="store_true", help="end when the parent does")
    options = parser.parse_args(arguments)
    # As KeyboardInterrupt, caught below: the camera's thread must end before the interpreter does.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if options.until_stdin_closes:  # Ctrl-C reaches the parent too, which is to end first
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        stack = Stack(options.frames) if options.frames else None
        formats = [name for name in options.formats.split(",") if stack is None or stack.fits(name)]
        start = options.pixel_format or next(iter(formats), "none")
        if start not in formats:
            deep = f"frames of {stack.bit_depth} bits need another pixel format" if stack else "not offered"
            raise SourceError(f"{start}: {deep}", todo="choose --pixel-format out of --formats")
        source = stack or Pattern()
        camera = GigeCamera(
            address=options.address,
            serial=options.serial,
            source=LeftAligned(source) if options.left_aligned else source,
            width=stack.width if stack else options.width,
            height=stack.height if stack else options.height,
            pixel_format=start,
            formats=formats,
            rate_hz=options.rate,
            packet_bytes=options.packet_bytes,
            loss=options.loss,
        )
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        if options.until_stdin_closes:
            sys.stdin.read()
        else:
            signal.pause()
        del camera
    except RecorderError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    except KeyboardInterrupt:
        pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
