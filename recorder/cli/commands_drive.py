"""``recorder inspect``, ``retime``, ``verify`` and ``export``: drives on disk."""

import sys
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from recorder.cli.output import Json, print_json, print_table, progress, size

Drive = Annotated[Path, typer.Argument(help="The folder of a drive, or one .mcap segment.")]


class Format(StrEnum):
    """What a topic can be exported as."""

    FELICS = "felics"
    PNG = "png"
    NPY = "npy"
    CSV = "csv"
    MKV = "mkv"


def register(app: typer.Typer) -> None:
    app.command()(inspect)
    app.command()(retime)
    app.command()(verify)
    app.command()(export)


def inspect(
    drive: Drive,
    plot: Annotated[
        Path | None, typer.Option(help="Draw UTC over the drive into this .png: offset, interval, fixes.")
    ] = None,
    json: Json = False,
) -> int:
    """Say what a drive holds: segments, topics, times, rates, gaps, sizes, and what is known of UTC."""
    from recorder.storage import inspect as inspect_drive
    from recorder.storage import open_drive

    with open_drive(drive) as opened:
        inspection = inspect_drive(opened)
        if plot is not None:
            from recorder.cli.time_plot import write_plot

            write_plot(opened, plot)
    if json:
        told = {"drive": str(drive.resolve()), **inspection.to_dict()}
        print_json(told | ({"plot": str(plot.resolve())} if plot else {}))
    else:
        _print_inspection(inspection)
    return 0


def retime(drive: Drive, json: Json = False) -> int:
    """Solve the time of a whole drive again, by all fixes before and after; nothing recorded is altered.

    The result lies beside the segments, in retimed.mcap; running it again replaces it.
    """
    from recorder.storage import open_drive
    from recorder.storage import retime as retime_drive

    with open_drive(drive) as opened, progress("solving") as report:
        retiming = retime_drive(opened, progress=report)
    for line in retiming.problems:
        print(f"recorder: {line}", file=sys.stderr)
    if json:
        print_json({"drive": str(drive.resolve()), **retiming.to_dict()})
        return 1 if retiming.problems else 0
    by = f"{retiming.fixes} fixes" + (f" and {retiming.pulses} pulses" if retiming.pulses else "")
    print(f"{retiming.seconds:.1f} s solved by {by}, UTC ± {retiming.half_width_ns / 1e6:.3g} ms (95 %)")
    for camera, count in retiming.frames.items():
        print(f"{camera}: {count} frames")
    if retiming.largest_change_ns is not None:
        print(f"largest change of a frame's UTC: {retiming.largest_change_ns / 1e6:.3g} ms")
    if retiming.problems:
        print(f"recorder: {drive}: damaged; solved by what can be read", file=sys.stderr)
    print(retiming.file)
    return 1 if retiming.problems else 0


def verify(drive: Drive, json: Json = False) -> int:
    """Decode everything; check checksums, order, and that every missing frame is accounted for."""
    from recorder.storage import open_drive
    from recorder.storage import verify as verify_drive

    with open_drive(drive) as opened, progress("verifying") as report:
        verification = verify_drive(opened, progress=report)
    if json:
        print_json({"drive": str(drive.resolve()), **verification.to_dict()})
    else:
        word = "sound" if verification.ok else "damaged"
        print(
            f"{drive}: {word}: {verification.frames} frames, {verification.damaged} damaged,"
            f" {verification.unaccounted} unaccounted for"
        )
    if not verification.ok:
        for line in verification.problems:
            print(f"recorder: {line}", file=sys.stderr)
    return 0 if verification.ok else 1


def export(
    drive: Drive,
    topic: Annotated[str, typer.Option(help="Such as /camera/front/image or /gnss/fix.")],
    format: Annotated[
        Format,
        typer.Option(
            help="felics: the marker-framed stream; png, npy: a folder; csv: times and numbers; mkv: FFV1."
        ),
    ],
    out: Annotated[Path, typer.Option(help="The file, or the folder for png and npy.")],
    json: Json = False,
) -> int:
    """Write one topic of a drive in another format, without loss."""
    from recorder.storage import export as export_topic
    from recorder.storage import open_drive

    with open_drive(drive) as opened, progress("exporting") as report:
        count = export_topic(opened, topic, format.value, out, progress=report)
    if json:
        print_json(
            {"drive": str(drive.resolve()), "topic": topic, "messages": count, "out": str(out.resolve())}
        )
    else:
        print(f"{count} messages of {topic} written to {out}")
    return 0


def _print_inspection(inspection: Any) -> None:
    told = inspection.to_dict()
    rows = [
        (s["name"], size(s["bytes"]), "closed" if s["closed"] else "not closed") for s in told["segments"]
    ]
    print_table(f"{told['path']}: {told['duration_s']:.1f} s", ("segment", "size", "state"), rows)
    topics = [
        (
            name,
            t["messages"],
            f"{t['rate_hz']:.2f}" if t["rate_hz"] else "",
            size(t["bytes"]),
            t["gaps"] or "",
            t["lost"] or "",
        )
        for name, t in sorted(told["topics"].items())
    ]
    print_table("topics", ("topic", "messages", "Hz", "size", "gaps", "lost"), topics)
    for word in ("first", "last"):
        time = told[f"{word}_time"]
        if time and time.get("utc_ns") is not None:
            at = datetime.fromtimestamp(time["utc_ns"] // 10**9, UTC) + timedelta(
                microseconds=time["utc_ns"] % 10**9 // 1000
            )
            print(f"{word}: {at:%Y-%m-%d %H:%M:%S.%f} UTC ± {time['utc_sigma_ns'] / 1e6:.0f} ms")
        elif time:
            print(f"{word}: raw {time['raw_ns']} ns, UTC unknown")
    _print_time(told)
    for camera, ratio in told["ratios"].items():
        print(f"{camera}: {100 * ratio:.1f} % of the packed size")
    for cause, count in told["losses"].items():
        print(f"lost: {count} by {cause}")
    for problem in told["problems"]:
        print(f"problem: {problem}")


def _print_time(told: dict[str, Any]) -> None:
    if told["time"]:
        origin_ns = told["time"][0]["offset_ns"]
        rows = [
            (
                f"{point['at_s']:.1f}",
                point["source"],
                f"{(point['offset_ns'] - origin_ns) / 1e6:+.3f}",
                f"{point['drift_ppb'] / 1000:+.2f}",
                f"± {point['half_width_ns'] / 1e6:.3g}",
            )
            for point in told["time"]
        ]
        title = f"{told['time_topic']}: UTC is log time {origin_ns / 1e9:+.6f} s at first"
        print_table(title, ("at, s", "source", "offset, ms", "drift, ppm", "95 %, ms"), rows)
    for step in told["clock_steps"]:
        print(f"the wall clock was set by {step['by_ns'] / 1e9:+.6f} s at {step['at_s']:.1f} s")
