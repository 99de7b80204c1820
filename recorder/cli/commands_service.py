"""``recorder run``, ``recorder status`` and ``recorder config``: the service."""

import logging
import threading
from pathlib import Path
from typing import Annotated, Any

import typer

from recorder.cli.commands_record import print_failures, stop_on_signals
from recorder.cli.log import log_to_stderr
from recorder.cli.output import Json, print_json, print_table, size


def register(app: typer.Typer) -> None:
    app.command()(run)
    app.command()(status)
    config = typer.Typer(no_args_is_help=True, help="The configuration file.")
    config.command("check")(config_check)
    app.add_typer(config, name="config")


def run(
    config: Annotated[Path, typer.Option(help="The recorder.toml to run by.")],
    json: Json = False,
) -> int:
    """Record in the foreground until SIGTERM or SIGINT, which close the drive cleanly."""
    from recorder.clock import SYSTEM_CLOCK
    from recorder.config import load
    from recorder.service.build import build_drivers
    from recorder.service.recording import Recording
    from recorder.service.status import StatusServer, socket_path

    settings = load(config)
    stop = threading.Event()
    recording = Recording(settings, build_drivers(settings, clock=SYSTEM_CLOCK), one_shot=False)
    server = StatusServer(socket_path(settings.service.socket), recording.status)
    with stop_on_signals(stop), log_to_stderr():
        server.start()
        try:
            drive = recording.start()
            logging.getLogger("recorder").info("recording to %s", drive)
            recording.wait(stop)
            outcome = recording.close()
        finally:
            server.close()
    print_failures(outcome)
    if json:
        errors = [str(failure) for failure in outcome.failures]
        told = {"messages": outcome.messages, "lost": outcome.lost}
        print_json({"drive": str(outcome.drive), "errors": errors, **told})
    else:
        topics = sorted({*outcome.messages, *outcome.lost})
        rows = [(topic, outcome.messages.get(topic, 0), outcome.lost.get(topic, "")) for topic in topics]
        title = f"{outcome.drive.name}: {outcome.seconds:.1f} s"
        print_table(title, ("topic", "messages", "lost"), rows)
        print(outcome.drive)
    return 1 if outcome.failures else 0


def status(
    socket: Annotated[
        Path | None, typer.Option(help="Default: $RECORDER_SOCKET, else /run/recorder/status.sock.")
    ] = None,
    json: Json = False,
) -> int:
    """Say how a running service is: exit code 0 healthy, 1 degraded, 3 not running."""
    from recorder.service.status import read_status, socket_path

    told = read_status(socket or socket_path())
    if json:
        print_json(told)
    else:
        _print_status(told)
    return 0 if told.get("healthy") and told.get("recording") else 1


def config_check(
    file: Annotated[Path, typer.Argument(help="A recorder.toml.")],
    json: Json = False,
) -> int:
    """Check a configuration file and say what it would record."""
    from recorder.config import load

    settings = load(file)
    if json:
        print_json({"ok": True, "settings": settings.model_dump(mode="json")})
        return 0
    rows = [(f"camera {name}", camera.source) for name, camera in settings.drivers.camera.items()]
    if settings.drivers.gnss is not None:
        rows.append(("gnss", settings.drivers.gnss.source))
        rows += [("pps", settings.drivers.gnss.pps)] if settings.drivers.gnss.pps else []
    print_table(f"{file}: sound", ("device", "source"), [*rows, ("drives", settings.storage.out)])
    return 0


def _print_status(told: dict[str, Any]) -> None:
    devices = told.get("devices", {})
    rows = [
        (name, device["state"], device["samples"], device["lost"], device["reason"])
        for name, device in devices.items()
    ]
    state = "recording" if told.get("recording") else "not recording"
    print_table(f"{state} to {told.get('drive')}", ("device", "state", "samples", "lost", "reason"), rows)
    disk, time = told.get("disk", {}), told.get("time", {})
    behind_s = ((time.get("raw_ns") or 0) - (told.get("durable_raw_ns") or 0)) / 1e9
    print(f"on disk up to {behind_s:.1f} s ago, {size(disk.get('free_bytes', 0))} free")
    if time.get("utc_ns") is not None:
        print(f"UTC by {time.get('source')}, ± {time['utc_half_width_ns'] / 1e6:.2f} ms (95 %)")
    else:
        print("UTC unknown: no GNSS fix yet")
    for problem in told.get("problems", []):
        print(f"problem: {problem}")
