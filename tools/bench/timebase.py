"""How right UTC is, and how honest about it, on simulated drives whose truth is known.

Every simulated fix goes through the recorder's own `UtcEstimate` as it would while recording, and the
whole drive afterwards through `solve`. Truth is used for nothing but the errors.
"""

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from camera_time import clock_step_effect_us, frame_jitter_us
from figures import Figure, Measured, report
from numpy.typing import NDArray

from recorder.config import TimebaseSection
from recorder.samples import Fix, Stamp
from recorder.simulation.receiver_time import ReceiverModel, receiver_drive
from recorder.timebase import CombinedTime, UtcEstimate, solve

Floats = NDArray[np.float64]

EPOCH_NS = 1_790_000_000 * 10**9
RAW_NS = 5_000 * 10**9
"""Raw time at the first second of a drive."""
SETTINGS = TimebaseSection(gnss_delay_ms=600, gnss_delay_sigma_ms=300)
SETTLED_S = 1200
"""The hour that is judged for drift and hold-over begins here: before, the line rests on too few earliest
arrivals. Intervals are judged from the first one on."""
LONG_SETTLED_S = 1800
"""The same ten minutes later, for comparison."""
OUTAGE_S = 1200
PULSE_SETTLED_S = 120
DELAY_HALF_WIDTH_MS = 1.96 * SETTINGS.gnss_delay_sigma_ms
"""What the delay's uncertainty alone gives."""
INTERRUPT_US = (2.0, 5.0)
"""A pulse is stamped so much late: at least, and exponentially more on average; one in a hundred by up to
100 us more, when interrupts were off."""
DRIVES, QUICK_DRIVES = 400, 60
PEER_DRIVES, QUICK_PEER_DRIVES = 60, 20


MODEL = ReceiverModel(seconds=LONG_SETTLED_S + 3600)


@dataclass(frozen=True, slots=True)
class Trial:
    """One drive to simulate."""

    seed: int
    model: ReceiverModel = MODEL
    outage: bool = False
    pulses: bool = False


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of it; errors are solved minus true UTC. NaN where it does not apply."""

    covered: bool
    covered_afterwards: bool
    half_width_ms: float
    drift_ms_per_h: float
    drift_later_ms_per_h: float
    drift_afterwards_ms_per_h: float
    drift_combined_ms_per_h: float
    outage_ms: float
    outage_combined_ms: float
    outage_afterwards_ms: float
    pulse_us: float
    width_afterwards: float
    """Widest interval solved afterwards against that of the same instant while recording."""
    fix_us: float
    ask_us: float


def run(trial: Trial) -> Outcome:
    """Simulate a drive and measure it."""
    random = np.random.default_rng(trial.seed)
    drive = receiver_drive(trial.model, random)
    seconds = np.arange(drive.seconds + 1)
    heard = np.ones(len(seconds), bool)
    start = int(random.integers(SETTLED_S, drive.seconds - OUTAGE_S - 60))
    if trial.outage:
        heard[start : start + OUTAGE_S] = False
    fixes = [
        Fix(Stamp(raw_ns=raw_ns, gps_ns=EPOCH_NS + int(second) * 10**9, gps_raw_ns=raw_ns), True, "A/A/1")
        for second, raw_ns in zip(seconds[heard], _raw_ns(drive.arrival_raw_s()[heard]), strict=True)
    ]
    late_us = INTERRUPT_US[0] + random.exponential(INTERRUPT_US[1], len(seconds))
    late_us += np.where(random.random(len(seconds)) < 0.01, random.uniform(0, 100, len(seconds)), 0.0)
    pulses = _raw_ns((drive.pulse_raw_s() + late_us * 1e-6)[heard]) if trial.pulses else []
    asked_s = drive.pulse_raw_s()[3:] + 0.25
    asked = _raw_ns(asked_s)
    truth_ns = np.round(drive.utc_s(asked_s) * 1e9)
    estimate = UtcEstimate(SETTINGS)
    events: list[tuple[int, int, Fix | None]] = [(raw_ns, 2, None) for raw_ns in asked]
    events += [(fix.stamp.raw_ns or 0, 0, fix) for fix in fixes] + [(raw_ns, 1, None) for raw_ns in pulses]
    online, fix_s, ask_s = [], 0.0, 0.0
    for raw_ns, kind, fix in sorted(events, key=lambda event: event[:2]):
        begin_s = perf_counter()
        if fix is not None:
            estimate.observe(fix)
            fix_s += perf_counter() - begin_s
        elif kind == 1:
            estimate.observe_pulse(raw_ns)
        else:
            online.append(estimate.at(raw_ns))
            ask_s += perf_counter() - begin_s
    solved = solve(fixes, SETTINGS, pulses_raw_ns=pulses)
    assert solved is not None
    afterwards = [solved.at(raw_ns) for raw_ns in asked]
    known = np.array([one is not None for one in online])
    told = [one for one in online if one is not None]
    error_ns = np.full(len(asked), np.nan)
    error_ns[known] = np.array([one.utc_ns - EPOCH_NS for one in told]) - truth_ns[known]
    half_ns = np.array([one.half_width_ns for one in told], float)
    after_ns = np.array([one.utc_ns - EPOCH_NS for one in afterwards]) - truth_ns
    after_half_ns = np.array([one.half_width_ns for one in afterwards], float)
    combined = CombinedTime.at_first_frame(asked[0], 0, fixes[0])
    combined_ns = np.array([combined.at(raw_ns) - EPOCH_NS for raw_ns in asked]) - truth_ns

    def drift_ms_per_h(errors_ns: Floats, begin_s: int = SETTLED_S) -> float:
        if trial.outage:
            return np.nan
        begin = begin_s - 3  # the first three seconds are not asked
        return float((errors_ns[begin + 3600] - errors_ns[begin]) / 1e6)

    def outage_ms(errors_ns: Floats) -> float:
        before, after = start - 4, start + OUTAGE_S - 4
        return float((errors_ns[after] - errors_ns[before]) / 1e6) if trial.outage else np.nan

    by_pulse = np.array([one is not None and one.source == "pps" for one in online])
    by_pulse[: PULSE_SETTLED_S + np.argmax(by_pulse)] = False
    return Outcome(
        covered=bool(np.all(np.abs(error_ns[known]) <= half_ns)),
        covered_afterwards=bool(np.all(np.abs(after_ns) <= after_half_ns)),
        half_width_ms=float(np.median(half_ns) / 1e6),
        drift_ms_per_h=drift_ms_per_h(error_ns),
        drift_later_ms_per_h=drift_ms_per_h(error_ns, LONG_SETTLED_S),
        drift_afterwards_ms_per_h=drift_ms_per_h(after_ns),
        drift_combined_ms_per_h=drift_ms_per_h(combined_ns),
        outage_ms=outage_ms(error_ns),
        outage_combined_ms=outage_ms(combined_ns),
        outage_afterwards_ms=outage_ms(after_ns),
        pulse_us=float(np.percentile(np.abs(error_ns[by_pulse]), 95) / 1e3) if by_pulse.any() else np.nan,
        width_afterwards=float(np.max(after_half_ns[known] / half_ns)),
        fix_us=fix_s / len(fixes) * 1e6,
        ask_us=ask_s / len(asked) * 1e6,
    )


def _raw_ns(seconds: Floats) -> list[int]:
    return [RAW_NS + int(ns) for ns in np.round(seconds * 1e9)]


def _of_drives(values: Sequence[float], percent: float = 95) -> float:
    """That so many percent of the drives do not exceed, whatever the sign; where it applies."""
    known = np.abs(np.array(values))
    return float(np.percentile(known[~np.isnan(known)], percent))


def measure(quick: bool) -> Measured:
    """Simulated drives of an hour with truth: coverage, width, drift, hold-over, pulses, frames."""
    drives = QUICK_DRIVES if quick else DRIVES
    peers = QUICK_PEER_DRIVES if quick else PEER_DRIVES
    trials = [Trial(seed, outage=seed % 2 == 1) for seed in range(drives)]
    trials += [Trial(10_000 + seed, pulses=True, outage=seed % 2 == 1) for seed in range(peers)]
    for number, floor in enumerate(("walls", "none")):
        model = replace(MODEL, floor=floor)
        trials += [Trial(20_000 + 1000 * number + seed, model) for seed in range(peers)]
    with ProcessPoolExecutor(2) as pool:
        outcomes = list(pool.map(run, trials, chunksize=5))
    main, rest = outcomes[:drives], outcomes[drives:]
    with_pulses, walls, no_floor = (rest[index * peers :][:peers] for index in range(3))
    steady, holding = drives - drives // 2, drives // 2
    drift_ms_per_h = _of_drives([one.drift_ms_per_h for one in main])
    by_pulse = [one.pulse_us for one in with_pulses if not np.isnan(one.pulse_us)]
    figures = [
        Figure(
            "coverage_drives", float(np.mean([one.covered for one in main])), "", 0.95, "higher", drives,
            {
                "solved afterwards": float(np.mean([one.covered_afterwards for one in main])),
                "with pulses": float(np.mean([one.covered for one in with_pulses])),
            },
        ),
        Figure(
            "halfwidth_over_delay_uncertainty",
            float(np.median([one.half_width_ms for one in main])) / DELAY_HALF_WIDTH_MS,
            "", 1.5, "lower", drives,
            {"solved afterwards, against that, at worst": max(one.width_afterwards for one in main)},
        ),
        Figure(
            "drift_fix_ms_per_h", drift_ms_per_h, "ms/h", 10, "lower", steady,
            {
                "median": _of_drives([one.drift_ms_per_h for one in main], 50),
                "from minute 30": _of_drives([one.drift_later_ms_per_h for one in main]),
                "solved afterwards": _of_drives([one.drift_afterwards_ms_per_h for one in main]),
                "t_combi": _of_drives([one.drift_combined_ms_per_h for one in main]),
                "wobble between walls": _of_drives([one.drift_ms_per_h for one in walls]),
                "wobble without a floor": _of_drives([one.drift_ms_per_h for one in no_floor]),
            },
        ),
        Figure(
            "drift_outage_ms", _of_drives([one.outage_ms for one in main]), "ms", 20, "lower", holding,
            {
                "median": _of_drives([one.outage_ms for one in main], 50),
                "solved afterwards": _of_drives([one.outage_afterwards_ms for one in main]),
                "t_combi": _of_drives([one.outage_combined_ms for one in main]),
            },
        ),
        Figure(
            "pps_error_us", max(by_pulse), "us", 50, "lower", len(by_pulse),
            {"drives whose pulses were taken": len(by_pulse) / peers},
        ),
        Figure("frame_jitter_us", frame_jitter_us(), "us", 20, "lower", 1),
        Figure("clock_step_effect_us", clock_step_effect_us(), "us", 50, "lower", 1),
        Figure("fix_cost_us", float(np.median([one.fix_us for one in main])), "us", 50, "lower", drives),
        Figure("ask_cost_us", float(np.median([one.ask_us for one in main])), "us", 5, "lower", drives),
    ]  # fmt: skip
    return Measured(figures)


if __name__ == "__main__":
    report("timebase", measure)
