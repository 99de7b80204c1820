"""``recorder demo`` and ``recorder record``: one-shot recordings."""

import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from recorder.cli.output import Json, print_json, print_table, progress, size
from recorder.errors import RecorderError, StorageError, UsageError

if TYPE_CHECKING:
    from recorder.config import Settings
    from recorder.drivers.base import Driver
    from recorder.service.recording import Outcome


LONGEST_S = 30 * 86_400.0
"""A month."""


def register(app: typer.Typer) -> None:
    app.command()(demo)
    app.command()(record)


def demo(
    seconds: Annotated[float, typer.Option(min=1, max=LONGEST_S, help="How long to record.")] = 20,
    out: Annotated[Path, typer.Option(help="Parent folder of the drive.")] = Path("drives"),
    rig: Annotated[str, typer.Option(help="auto, gige (camera over GigE Vision) or embedded.")] = "auto",
    json: Json = False,
) -> int:
    """Record a simulated train for a while, verify the drive and say what is in it."""
    from recorder.cli.demo_rig import demo_rig
    from recorder.storage import inspect, open_drive, verify

    if not json:
        print("rendering a stretch of line", flush=True)
    with demo_rig(rig, out) as demo:
        if not json:
            print(f"recording {seconds:g} s of {demo.told}", flush=True)
        outcome = record_one(demo.settings, demo.drivers, seconds=seconds)
    print_failures(outcome)
    with open_drive(outcome.drive) as drive:
        with progress("verifying") as report:
            verification = verify(drive, progress=report)
        inspection = inspect(drive)
    if json:
        print_json({"drive": str(outcome.drive), "verify": verification.to_dict(), **inspection.to_dict()})
    else:
        print_outcome(outcome, inspection)
        if verification.ok:
            print("verified: every frame decodes to the pixels that were recorded")
        print(outcome.drive)
    for line in verification.problems:
        print(f"recorder: {line}", file=sys.stderr)
    return 0 if verification.ok and not outcome.failures and verification.frames else 1


def record(
    sources: Annotated[
        list[str],
        typer.Argument(
            metavar="SOURCE...",
            help="Video files, image folders, .npy stacks, genicam://ADDRESS, a serial device, or"
            " gpsd://HOST:PORT; the first camera is called front, the second tag, or say front=SOURCE.",
        ),
    ],
    out: Annotated[Path, typer.Option(help="Parent folder of the drive.")],
    nmea: Annotated[
        str | None, typer.Option(help="An NMEA log, a serial GNSS receiver, or gpsd://HOST:PORT.")
    ] = None,
    realtime: Annotated[bool, typer.Option(help="Play files at their own pace.")] = False,
    seconds: Annotated[
        float | None,
        typer.Option(min=0.1, max=LONGEST_S, help="Stop after this long; else when files end, or Ctrl-C."),
    ] = None,
    pixel_format: Annotated[str, typer.Option(help="Of GenICam cameras.")] = "auto",
    rate: Annotated[float | None, typer.Option(help="Frames a second.")] = None,
    exposure: Annotated[float | None, typer.Option(help="Exposure time, µs.")] = None,
    gain: Annotated[float | None, typer.Option(help="In the camera's units.")] = None,
    baud: Annotated[str, typer.Option(help="Of a serial GNSS receiver; auto finds out.")] = "auto",
    times: Annotated[Path | None, typer.Option(help="CSV with the times of a file's images.")] = None,
    json: Json = False,
) -> int:
    """Record from files or devices once, without a configuration file."""
    from recorder.clock import SYSTEM_CLOCK
    from recorder.config import parse
    from recorder.service.build import build_drivers
    from recorder.storage import inspect, open_drive

    cameras, receivers = _sort_sources(sources)
    if nmea is not None:
        receivers.append(nmea)
    if len(receivers) > 1:
        raise UsageError("only one GNSS source can be recorded", where=", ".join(receivers))
    live = _has_live([*cameras.values(), *receivers])
    camera_values: dict[str, Any] = {
        "pixel_format": pixel_format, "rate_hz": rate, "exposure_us": exposure, "gain": gain,
        "times": times, "realtime": realtime or live,
    }  # fmt: skip
    drivers: dict[str, Any] = {
        "camera": {name: {"source": s, **camera_values} for name, s in cameras.items()}
    }
    if receivers:
        rate_baud = int(baud) if baud.isdecimal() else baud
        drivers["gnss"] = {"source": receivers[0], "baud": rate_baud, "realtime": realtime or live}
    settings = parse({"drivers": drivers, "storage": {"out": out}}, where="command line")
    outcome = record_one(settings, build_drivers(settings, clock=SYSTEM_CLOCK), seconds=seconds)
    print_failures(outcome)
    if not outcome.drive.is_dir():
        raise StorageError("the drive is gone", where=str(outcome.drive))
    with open_drive(outcome.drive) as drive:
        inspection = inspect(drive)
    empty = not any(topic in inspection.topics for topic in _data_topics(settings))
    if empty and not outcome.failures:
        lost = ", ".join(f"{count} by the {cause}" for cause, count in inspection.losses.items())
        why = f"all that came was lost, {lost}" if lost else "no device said anything"
        outcome.failures.append(RecorderError(f"nothing was recorded: {why}"))
        print_failures(outcome)
    if json:
        errors = [str(failure) for failure in outcome.failures]
        print_json({"drive": str(outcome.drive), "errors": errors, **inspection.to_dict()})
    else:
        print_outcome(outcome, inspection)
        print(outcome.drive)
    return 1 if outcome.failures else 0


def print_failures(outcome: "Outcome") -> None:
    """What went wrong, before anything else that may."""
    for failure in outcome.failures:
        print(f"recorder: {failure}", file=sys.stderr, flush=True)


def record_one(settings: "Settings", drivers: Sequence["Driver"], *, seconds: float | None) -> "Outcome":
    """A whole one-shot recording; SIGINT, SIGTERM and SIGHUP end it cleanly."""
    from recorder.service.recording import Recording

    stop = threading.Event()
    recording = Recording(settings, drivers, one_shot=True)
    with stop_on_signals(stop), progress("recording") as report:
        recording.start(stop)
        timer = threading.Timer(seconds, stop.set) if seconds else None
        if timer:
            timer.start()
        try:
            recording.wait(stop, tick=lambda: report(recording.frames, 0))
        finally:
            if timer:
                timer.cancel()
                timer.join()
            outcome = recording.close()
    return outcome


@contextmanager
def stop_on_signals(stop: threading.Event) -> Iterator[None]:
    """While inside, SIGTERM, SIGINT and SIGHUP set ``stop``; a second SIGINT ends the process at once."""

    def handle(number: int, _: object) -> None:
        stop.set()
        if number == signal.SIGINT:
            signal.signal(number, signal.default_int_handler)

    signals = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
    before = {number: signal.signal(number, handle) for number in signals}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def print_outcome(outcome: "Outcome", inspection: Any) -> None:
    """Frames, size, losses of a finished recording, for people."""
    rows = [
        (
            name,
            topic.messages,
            f"{topic.rate_hz:.2f}" if topic.rate_hz else "",
            size(topic.bytes),
            topic.lost or "",
        )
        for name, topic in sorted(inspection.topics.items())
    ]
    print_table(
        f"{outcome.drive.name}: {inspection.duration_s:.1f} s",
        ("topic", "messages", "Hz", "size", "lost"),
        rows,
    )
    for camera, ratio in inspection.ratios.items():
        print(f"{camera}: {100 * ratio:.1f} % of the packed size")


def _sort_sources(sources: Sequence[str]) -> tuple[dict[str, str], list[str]]:
    """Cameras by name, and GNSS receivers."""
    from recorder.config import CAMERA_NAMES
    from recorder.service.build import is_receiver

    cameras: dict[str, str] = {}
    receivers: list[str] = []
    for source in sources:
        name, equals, rest = source.partition("=")
        named = bool(equals) and name.isidentifier() and not Path(source).exists()
        if is_receiver(source):
            receivers.append(source)
        elif named and name not in CAMERA_NAMES:
            known = ", ".join(CAMERA_NAMES)
            raise UsageError(f"camera {name!r} is not known", where=source, todo=f"use one of {known}")
        else:
            free = [camera for camera in CAMERA_NAMES if camera not in cameras]
            name = name if named else next(iter(free), "")
            if not name or name in cameras:
                raise UsageError("more cameras than names", where=source, todo=f"known: {CAMERA_NAMES}")
            cameras[name] = rest if named else source
    return cameras, receivers


def _has_live(sources: Sequence[str]) -> bool:
    from recorder.service.build import is_receiver

    return any(source.startswith("genicam:") or is_receiver(source) for source in sources)


def _data_topics(settings: "Settings") -> list[str]:
    from recorder.samples import image_topic

    gnss = ["/gnss/raw"] if settings.drivers.gnss else []
    return [image_topic(name) for name in settings.drivers.camera] + gnss
