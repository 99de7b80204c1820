"""From light to grey values: the image sensor of the scene."""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from recorder.samples import Pixels


@dataclass(frozen=True, slots=True)
class Sensor:
    """A linear sensor with photon and read noise (photon transfer, EMVA 1288)."""

    bit_depth: int = 10
    full_well_e: float = 7700.0
    """Electrons of a white pixel."""
    read_noise_e: float = 10.0
    black_level: float = 12.0
    """Grey value of darkness."""

    @property
    def electrons_per_value(self) -> float:
        return self.full_well_e / ((1 << self.bit_depth) - 1 - self.black_level)

    def variance(self, value: NDArray[np.float32]) -> NDArray[np.float32]:
        """Of the noise at a mean grey value, in grey values squared, rounding aside."""
        signal_e = np.maximum(value - np.float32(self.black_level), 0) * np.float32(self.electrons_per_value)
        noise_e2 = signal_e + np.float32(self.read_noise_e**2)
        return np.asarray(noise_e2 / np.float32(self.electrons_per_value**2), np.float32)

    def expose(self, value: NDArray[np.float32], rng: Generator) -> Pixels:
        """One exposure of an image of mean grey values, which it overwrites."""
        noise = rng.standard_normal(value.shape, dtype=np.float32)
        spread = self.variance(value)
        noise *= np.sqrt(spread, out=spread)
        value += noise
        value += np.float32(0.5)
        np.clip(value, 0, (1 << self.bit_depth) - 1, out=value)
        return value.astype(np.uint16)
