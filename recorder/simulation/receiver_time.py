"""How a GNSS receiver's time reaches a machine: late, by more or less, against an oscillator that is off."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

TEMPERATURE_S = 1200
"""The oscillator's rate goes from one value to the next in so long."""


@dataclass(frozen=True, slots=True)
class ReceiverModel:
    """What is drawn for a drive; one fix a second."""

    seconds: int = 3600
    delay_ms: tuple[float, float] = (100.0, 1100.0)
    """From a second of UTC to the earliest arrival of its sentences; constant, drawn evenly."""
    wobble_ms: float = 170.0
    """Above that, two standard deviations."""
    correlation_s: tuple[float, float] = (60.0, 300.0)
    """Of the wobble; drawn evenly."""
    floor: str = "reflected"
    """What the wobble does at 0. "reflected": a random walk drawn back to the floor and thrown back there
    (the absolute value of an Ornstein-Uhlenbeck process); "walls": one between 0 and ``wobble_ms``;
    "none": a Gaussian one about the middle, with as much on either side."""
    jitter_ms: float = 4.0
    """Above that, evenly: the serial line's and USB's."""
    jumps_per_hour: float = 1.0
    jump_ms: float = 200.0
    """The delay jumps by so much, and back at the next jump."""
    oscillator_ppm: float = 50.0
    """Constant part, drawn evenly to either side."""
    temperature_ppm: float = 5.0
    """Change in ``TEMPERATURE_S``, drawn evenly to either side."""


@dataclass(frozen=True, slots=True)
class ReceiverDrive:
    """One drive, with truth: second k of UTC arrives at ``arrival_s[k]`` of raw time."""

    utc_minus_raw_s: Floats
    """(seconds + 1,) true difference at each second of UTC, 0 at first; straight between."""
    latency_s: Floats
    """(seconds + 1,) from a second of UTC to the first byte that tells it."""
    delay_s: float

    @property
    def seconds(self) -> int:
        return len(self.latency_s) - 1

    def pulse_raw_s(self) -> Floats:
        """Raw instants of the seconds of UTC."""
        return np.asarray(np.arange(self.seconds + 1) - self.utc_minus_raw_s)

    def arrival_raw_s(self) -> Floats:
        """Raw instants at which the fixes arrive. A second of latency is short for the oscillator."""
        return np.asarray(self.pulse_raw_s() + self.latency_s)

    def utc_s(self, raw_s: Floats) -> Floats:
        """True UTC at raw instants."""
        return np.asarray(raw_s + np.interp(raw_s, self.pulse_raw_s(), self.utc_minus_raw_s))


def receiver_drive(model: ReceiverModel, random: np.random.Generator) -> ReceiverDrive:
    """Draw a drive."""
    count = model.seconds + 1
    delay_ms = random.uniform(*model.delay_ms)
    latency_ms = delay_ms + _wobble_ms(model, count, random) + random.uniform(0, model.jitter_ms, count)
    level_ms = 0.0
    for at_s in np.sort(random.uniform(0, count, random.poisson(model.jumps_per_hour * count / 3600))):
        step_ms = -level_ms if level_ms else random.choice((-1.0, 1.0)) * model.jump_ms
        level_ms += step_ms
        latency_ms[int(at_s) :] += step_ms
    changes_ppm = random.uniform(-model.temperature_ppm, model.temperature_ppm, count // TEMPERATURE_S + 1)
    first_ppm = random.uniform(-model.oscillator_ppm, model.oscillator_ppm)
    knots_ppm = first_ppm + np.concatenate([[0.0], np.cumsum(changes_ppm)])
    ppm = np.interp(np.arange(count), TEMPERATURE_S * np.arange(len(knots_ppm)), knots_ppm)
    drift_s = np.concatenate([[0.0], np.cumsum((ppm[1:] + ppm[:-1]) / 2)]) * 1e-6
    return ReceiverDrive(drift_s, np.maximum(latency_ms, 1.0) / 1000, delay_ms / 1000)


def _wobble_ms(model: ReceiverModel, count: int, random: np.random.Generator) -> Floats:
    correlation_s = random.uniform(*model.correlation_s)
    if model.floor == "walls":
        # the slowest mode of a random walk between walls decays in width² / (π² D)
        step_ms = model.wobble_ms / np.pi * np.sqrt(2 / correlation_s)
        start_ms = random.uniform(0, model.wobble_ms)
        unfolded = np.mod(start_ms + np.cumsum(random.normal(0, step_ms, count)), 2 * model.wobble_ms)
        return np.asarray(np.minimum(unfolded, 2 * model.wobble_ms - unfolded))
    sigma_ms = model.wobble_ms / (2 if model.floor == "reflected" else 4)
    keeps = np.exp(-1 / correlation_s)
    pushes_ms = random.normal(0, sigma_ms * np.sqrt(1 - keeps**2), count).tolist()
    walk_ms = np.empty(count)
    now_ms = random.normal(0, sigma_ms)
    for index, push_ms in enumerate(pushes_ms):
        now_ms = keeps * now_ms + push_ms
        walk_ms[index] = now_ms
    return np.abs(walk_ms) if model.floor == "reflected" else np.asarray(walk_ms + model.wobble_ms / 2)
