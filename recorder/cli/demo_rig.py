"""The demo rig: a simulated train in front of the real drivers, on this machine alone."""

import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recorder.clock import SYSTEM_CLOCK
from recorder.config import Settings, parse
from recorder.drivers.base import Driver
from recorder.errors import UsageError
from recorder.service.build import build_drivers
from recorder.simulation.embedded import EmbeddedCamera
from recorder.simulation.gige_camera import GigeCameraProcess, aravis_problem
from recorder.simulation.nmea_pty import NmeaPty, moving_train
from recorder.simulation.scene import Scene

RIGS = ("auto", "gige", "embedded")
_RATE_HZ = 59.82
_LOOP_FRAMES = 60
_LOOP_METRES = 24.0
"""60 frames of 0.4 m: 86 km/h."""
_START_DEG = (46.9533, 7.4826)
"""Ostermundigen, where the report's drive OT_1H began."""


@dataclass(frozen=True, slots=True)
class DemoRig:
    """Twins that are running, and the drivers that record from them."""

    settings: Settings
    drivers: Sequence[Driver]
    told: str
    """What it is, for people."""


@contextmanager
def demo_rig(kind: str, out: Path) -> Iterator[DemoRig]:
    """Start the twins of one camera and one GNSS receiver; end them on leaving.

    ``gige``: the camera is a process of its own that speaks GigE Vision over loopback and is
    recorded through Aravis. ``embedded``: it lives in this process and needs nothing
    installed. ``auto``: gige where Aravis is there. The receiver speaks NMEA at 4800 baud on a
    pseudo-terminal in either case.
    """
    if kind not in RIGS:
        raise UsageError(f"unknown rig {kind!r}", where="--rig", todo=f"use one of {', '.join(RIGS)}")
    problem = aravis_problem()
    if kind == "gige" and problem:
        raise UsageError(problem, where="--rig gige", todo="or use --rig embedded")
    frames = Scene().loop(_LOOP_FRAMES, _LOOP_METRES)
    speed_m_s = _LOOP_METRES / _LOOP_FRAMES * _RATE_HZ
    with ExitStack() as twins:
        bursts = moving_train(*_START_DEG, speed_m_s=speed_m_s, course_deg=135.0, clock_ns=time.time_ns)
        receiver = twins.enter_context(NmeaPty(bursts))
        gnss = {"source": str(receiver.path)}
        if kind == "embedded" or problem:
            settings = parse({"drivers": {"gnss": gnss}, "storage": {"out": out}}, where="demo")
            drivers = [
                EmbeddedCamera("front", frames, rate_hz=_RATE_HZ),
                *build_drivers(settings, clock=SYSTEM_CLOCK),
            ]
            yield DemoRig(
                settings, drivers, "a simulated camera in this process and a GNSS receiver on a pty"
            )
            return
        folder = Path(twins.enter_context(tempfile.TemporaryDirectory(prefix="recorder-demo-")))
        np.save(folder / "loop.npy", frames)
        camera = twins.enter_context(GigeCameraProcess(frames=folder / "loop.npy", pixel_format="Mono10p"))
        front = {"source": f"genicam://{camera.address}", "pixel_format": "Mono10p", "rate_hz": _RATE_HZ}
        values = {"drivers": {"camera": {"front": front}, "gnss": gnss}, "storage": {"out": out}}
        settings = parse(values, where="demo")
        drivers = list(build_drivers(settings, clock=SYSTEM_CLOCK))
        yield DemoRig(settings, drivers, "a GigE Vision camera over loopback and a GNSS receiver on a pty")
