"""The whole recording path against a real GigE Vision peer: what is lost, what it costs.

A camera process sends 1280x1024 at 59.82 Hz over loopback, a receiver speaks NMEA at 4800 baud
on a pty, ``recorder record`` runs as a process of its own. Measured: frames that are not in the
drive, processor time of the recorder alone, bytes on disk. The peer is the plain mcap writer
with the raw pixels of the same frames.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from figures import Figure, Measured, report
from mcap.writer import CompressionType, Writer

from recorder import open_drive
from recorder.simulation.gige_camera import GigeCameraProcess
from recorder.simulation.nmea_pty import NmeaPty, moving_train
from recorder.simulation.scene import Scene
from recorder.storage import verify

RATE_HZ = 59.82
WIDTH, HEIGHT, BITS = 1280, 1024, 10
PACKED_BYTES = WIDTH * HEIGHT * BITS // 8
REPORT_RATIO = 0.645
"""Compressed over packed size in the source report, Table 3-3."""


@dataclass(frozen=True, slots=True)
class Run:
    """What one recording came to."""

    lost: int
    frames: int
    cores: float
    bytes_per_s: float
    ratio: float
    sound: bool


def record(frames: Path, pixel_format: str, seconds: float) -> Run:
    """One recording of ``seconds``, verified."""
    with (
        tempfile.TemporaryDirectory(prefix="recorder-bench-") as out,
        NmeaPty(
            moving_train(46.9533, 7.4826, speed_m_s=24.0, course_deg=135.0, clock_ns=time.time_ns)
        ) as gnss,
        GigeCameraProcess(frames=frames, pixel_format=pixel_format) as camera,
    ):
        command = [
            sys.executable, "-m", "recorder", "record", f"genicam://{camera.address}",
            "--nmea", str(gnss.path), "--pixel-format", pixel_format, "--rate", str(RATE_HZ),
            "--seconds", str(seconds), "--out", out, "--json",
        ]  # fmt: skip
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        told: dict[str, Any] = json.loads(process.stdout.read())
        process.stdout.close()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise SystemExit(f"recording failed: {told}")
        topic = told["topics"]["/camera/front/image"]
        with open_drive(Path(told["drive"])) as drive:
            sound = verify(drive).ok
        return Run(
            lost=topic["gaps"],
            frames=topic["messages"],
            cores=(usage.ru_utime + usage.ru_stime) / seconds,
            bytes_per_s=topic["bytes"] / seconds,
            ratio=topic["bytes"] / topic["messages"] / PACKED_BYTES,
            sound=sound,
        )


def plain_mcap_cores(frames: np.ndarray, seconds: float) -> float:
    """Cores that the plain mcap writer needs for the same frames, unencoded."""
    with (
        tempfile.TemporaryDirectory(prefix="recorder-bench-") as out,
        (Path(out) / "raw.mcap").open("wb") as file,
    ):
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start()
        channel = writer.register_channel("/raw", "raw", 0)
        count = round(seconds * RATE_HZ)
        before = time.process_time()
        for number in range(count):
            writer.add_message(channel, number, frames[number % len(frames)].tobytes(), number)
        writer.finish()  # type: ignore[no-untyped-call]
        return (time.process_time() - before) / seconds


def measure(quick: bool) -> Measured:
    """Record from a GigE Vision camera and a receiver; see the top of the file."""
    seconds = 15.0 if quick else 60.0
    frames = Scene().loop(60, 24.0)
    with tempfile.TemporaryDirectory(prefix="recorder-bench-") as folder:
        loop = Path(folder) / "loop.npy"
        np.save(loop, frames)
        runs = {name: record(loop, name, seconds) for name in ("Mono10", "Mono10p")}
    raw = {"plain mcap, raw pixels": plain_mcap_cores(frames, min(seconds, 15.0))}
    figures: list[Figure] = []
    for name, run in runs.items():
        key = name.lower()
        expected = seconds * RATE_HZ
        figures += [
            Figure(f"{key}_frames_lost", run.lost, "frames", 0, "lower", run.frames),
            Figure(f"{key}_frames_of_expected", run.frames / expected, "", 0.97, "higher", run.frames),
            Figure(f"{key}_cpu_cores", run.cores, "cores", 1.5, "lower", run.frames, raw),
            Figure(f"{key}_bytes_per_s", run.bytes_per_s, "B/s", PACKED_BYTES * RATE_HZ, "lower", run.frames,
                   {"packed": PACKED_BYTES * RATE_HZ}),
            Figure(f"{key}_size_of_packed", run.ratio, "", 0.66, "lower", run.frames,
                   {"report": REPORT_RATIO}),
            Figure(f"{key}_sound", float(run.sound), "", 1, "higher", run.frames),
        ]  # fmt: skip
    return Measured(figures)


if __name__ == "__main__":
    report("pipeline", measure)
