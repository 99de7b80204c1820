"""How well frames are timed, and what a wall clock that is set or slewed does to it (simulated clocks)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from random import Random

from recorder.config import TimebaseSection
from recorder.samples import Fix, Stamp
from recorder.simulation.clocks import SimulatedCamera, SimulatedClock, SimulatedFrame
from recorder.timebase import CameraClock, CameraClockSettings, Timebase

SECOND_NS = 1_000_000_000
DAY_NS = 86_400 * SECOND_NS
CONVERGED_S = 10
"""The line needs some frames before it stands."""


def frame_errors_ns(camera: SimulatedCamera, seconds: int, seed: int = 1) -> list[int]:
    """Solved minus true middle of the exposure of every frame, as it is known when the frame comes."""
    clock = CameraClock(CameraClockSettings(event=camera.event, transfer_ns=camera.transfer_ns))
    errors = []
    for frame in camera.frames(seconds * camera.rate_hz, 10**12, seed):
        told = clock.observe(frame.id, frame.ticks_ns, frame.arrival_ns, frame.exposure_ns)
        errors.append(told.raw_ns - frame.middle_ns)
    return errors


def frame_jitter_us(seconds: int = 600, seed: int = 1, camera: SimulatedCamera | None = None) -> float:
    """RMS of the solved frame times about their mean, exact ticks of 0.1 us, arrival 1 to 7 ms late.

    The least delay is given (``transfer_us``), as no clock can tell it. The first `CONVERGED_S` are left out.
    """
    camera = camera or SimulatedCamera()
    return rms_ns(frame_errors_ns(camera, seconds, seed)[CONVERGED_S * camera.rate_hz :]) / 1000


def rms_ns(errors_ns: Sequence[int]) -> float:
    """About the mean."""
    mean = sum(errors_ns) / len(errors_ns)
    return sqrt(sum((error - mean) ** 2 for error in errors_ns) / len(errors_ns))


@dataclass(frozen=True, slots=True)
class Disturbance:
    """What somebody does to the wall clock while it is recorded."""

    at_s: float
    set_ns: int = 0
    slew_ppm: int | None = None


AS_REQUIRED = (
    Disturbance(15.0037, set_ns=100 * DAY_NS),
    Disturbance(20.0, slew_ppm=500),
    Disturbance(27.2501, slew_ppm=-500),
    Disturbance(34.1113, set_ns=-100 * DAY_NS),
    Disturbance(41.5, slew_ppm=0),
)
"""Set by 100 days both ways, slewed by 500 ppm both ways."""


_STEPPED = object()
"""The thread that takes the pairs has been woken because the clock was set."""


def solved_times(disturbances: Sequence[Disturbance], seconds: int, seed: int = 1) -> list[Stamp]:
    """The stamps of a camera's frames, recorded with a receiver while the wall clock is disturbed.

    The kernel stamps a frame's arrival with CLOCK_REALTIME, the program sees it up to 5 ms later. Clock
    pairs are taken twice a second and up to 1 ms after the clock was set, as by the recorder.
    """
    clock = SimulatedClock()
    start_ns = clock.now_ns
    timebase = Timebase(TimebaseSection().believing_every_date, clock)
    camera = CameraClock(CameraClockSettings(transfer_ns=1_000_000))
    random, waking = Random(seed), Random(seed)
    events: list[tuple[int, int, object]] = []
    for frame in SimulatedCamera().frames(seconds * 50, start_ns + SECOND_NS, seed):
        events.append((frame.arrival_ns, 0, frame))
    events += [(start_ns + half * SECOND_NS // 2, 1, None) for half in range(1, 2 * seconds)]
    events += [(start_ns + round(d.at_s * 1e9), 2, d) for d in disturbances]
    for d in disturbances:
        if d.set_ns:
            events.append((start_ns + round(d.at_s * 1e9) + waking.randint(20_000, 1_000_000), 4, _STEPPED))
    for second in range(1, seconds):
        raw_ns = start_ns + second * SECOND_NS + random.randint(0, 50_000_000)
        events.append(
            (raw_ns, 3, Fix(Stamp(raw_ns, gps_ns=second * SECOND_NS, gps_raw_ns=raw_ns), True, "A"))
        )
    told: list[Stamp] = []
    kernel: list[tuple[int, SimulatedFrame, int]] = []
    queue = sorted(events, key=lambda event: (event[0], event[1]))
    while queue or kernel:
        if kernel and (not queue or kernel[0][0] <= queue[0][0]):
            seen_ns, frame, realtime_ns = kernel.pop(0)
            _until(clock, seen_ns)
            stamp = Stamp(raw_ns=clock.raw_ns(), device_ns=frame.ticks_ns, realtime_ns=realtime_ns)
            stamp = timebase.refine(stamp, after_ns=told[-1].raw_ns if told else None)
            assert stamp.raw_ns is not None
            exposure = camera.observe(frame.id, frame.ticks_ns, stamp.raw_ns, frame.exposure_ns)
            stamp = replace(stamp, exposure_raw_ns=exposure.raw_ns, exposure_sigma_ns=exposure.sigma_ns)
            told.append(timebase.complete(stamp, frame=True))
            continue
        at_ns, _, event = queue.pop(0)
        _until(clock, at_ns)
        if isinstance(event, SimulatedFrame):
            seen_ns = max(at_ns + random.randint(50_000, 5_000_000), kernel[-1][0] if kernel else 0)
            kernel.append((seen_ns, event, clock.wall_at_now_ns()))
        elif isinstance(event, Disturbance):
            clock.set_wall(event.set_ns)
            if event.slew_ppm is not None:
                clock.slew(event.slew_ppm)
        elif isinstance(event, Fix):
            timebase.observe(event)
        else:
            timebase.sample_pair(stepped=event is _STEPPED)
    return told


def clock_step_effect_us(
    disturbances: Sequence[Disturbance] = AS_REQUIRED, seconds: int = 50, seed: int = 1
) -> float:
    """The largest change of any solved time by what is done to the wall clock: of ``raw_ns``, of the
    middle of the exposure, of the combined time and of UTC."""
    quiet, disturbed = solved_times((), seconds, seed), solved_times(disturbances, seconds, seed)
    return max(changes_ns(quiet, disturbed).values()) / 1000


def changes_ns(quiet: Sequence[Stamp], disturbed: Sequence[Stamp]) -> dict[str, int]:
    """The largest change of each solved time."""
    changes = {}
    for name in ("raw_ns", "exposure_raw_ns", "combined_ns", "utc_ns"):
        pairs = [(getattr(a, name), getattr(b, name)) for a, b in zip(quiet, disturbed, strict=True)]
        assert all((a is None) == (b is None) for a, b in pairs), name
        changes[name] = max(abs(a - b) for a, b in pairs if a is not None)
    return changes


def _until(clock: SimulatedClock, raw_ns: int) -> None:
    clock.advance(max(0, raw_ns - clock.now_ns))
