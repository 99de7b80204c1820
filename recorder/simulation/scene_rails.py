"""The rails of the scene.

A straight rail is the same all along, so what a ray meets depends only on its direction in the
cross-section: t = left / down. The section is cast once over t, and a pixel is the mean over the
t that it spans, taken from a running sum: exact, and free of aliasing up to the horizon.
"""

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from recorder.simulation.scene_camera import Floats, SceneCamera
from recorder.simulation.scene_ground import HAZE, HAZE_M, TRACKS_M

GAUGE_M = 1.435
"""Between the inner faces of the heads."""
HEAD_M = 0.072
"""Width of the head of a 60E1 rail."""

_STEP = 1.0 / 20_000
"""Of t: 0.13 mm on the rail tops."""
_SPAN = 3.0

# The section of one rail as straight faces, from the inner face outwards, in metres from the
# inner face and the top: (y, z) to (y, z), grey value. Rust is bright in the near infrared, grime is not.
_FACES = (
    ((0.000, -0.014), (0.005, 0.000), 420.0),
    ((0.005, 0.000), (0.012, 0.000), 560.0),
    ((0.012, 0.000), (0.046, 0.000), 800.0),
    ((0.046, 0.000), (0.054, 0.000), 540.0),
    ((0.054, 0.000), (0.067, 0.000), 240.0),
    ((0.067, 0.000), (0.072, -0.014), 160.0),
    ((0.000, -0.014), (0.000, -0.042), 165.0),
    ((0.072, -0.014), (0.072, -0.042), 105.0),
    ((0.000, -0.042), (0.028, -0.051), 70.0),
    ((0.072, -0.042), (0.044, -0.051), 40.0),
    ((0.028, -0.051), (0.028, -0.140), 110.0),
    ((0.044, -0.051), (0.044, -0.140), 110.0),
    ((0.028, -0.140), (-0.039, -0.161), 205.0),
    ((0.044, -0.140), (0.111, -0.161), 205.0),
    ((-0.039, -0.161), (-0.039, -0.180), 90.0),
    ((0.111, -0.161), (0.111, -0.180), 90.0),
)


class Rails:
    """The rails of all tracks over the ground."""

    def __init__(self, camera: SceneCamera, first_row: int, period_m: float, rng: Generator) -> None:
        value, cover = _cast(camera.height_m)
        down = camera.down[first_row:].astype(np.float64)
        t = camera.left[None, :].astype(np.float64) / down[:, None]
        # Wider where a rail lies flat in the image, so that a pixel's height is averaged too.
        half = (0.5 / camera.focal_px / down)[:, None] * np.sqrt(1 + t**2)
        self.cover = _mean(cover, t, half).astype(np.float32)
        """(rows, W) share of each pixel that is rail."""
        self._value = _mean(value * cover, t, half).astype(np.float32)
        x_m = camera.height_m * camera.forward[first_row:] / camera.down[first_row:]
        self._x_m = x_m
        self._clear = np.exp(-x_m / HAZE_M).astype(np.float32)
        self._period_m = period_m
        # Slow changes of the polish along the rail, by a few smooth waves that fit the period.
        waves = np.arange(1, 9)
        self._waves = waves * (2 * np.pi / period_m)
        self._phases = rng.uniform(0, 2 * np.pi, len(waves))
        blur = np.abs(np.gradient(x_m))[:, None] * self._waves[None, :]
        self._amplitude = 0.02 * np.exp(-(blur**2) / 8)

    def over(self, ground: Floats, position_m: float) -> Floats:
        """The ground with the rails on it."""
        phase = (self._x_m[:, None] + position_m % self._period_m) * self._waves[None, :] + self._phases
        polish = 1 + (self._amplitude * np.sin(phase)).sum(axis=1)
        gain = (polish * self._clear).astype(np.float32)[:, None]
        haze = (HAZE * (1 - self._clear)).astype(np.float32)[:, None]
        return np.asarray(ground * (1 - self.cover) + self._value * gain + self.cover * haze, np.float32)


def _cast(height_m: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What the ray of each t meets first: grey value and 1, or 0 and 0 where it passes the rails."""
    t = np.arange(-_SPAN, _SPAN, _STEP)
    highest = np.full(t.shape, -np.inf)
    value = np.zeros(t.shape)
    for centre_m in TRACKS_M:
        for side in (1, -1):
            for (y0, z0), (y1, z1), grey in _FACES:
                start = centre_m + side * (GAUGE_M / 2 + y0)
                end = centre_m + side * (GAUGE_M / 2 + y1)
                t0, t1 = start / (height_m - z0), end / (height_m - z1)
                hit = (t >= min(t0, t1)) & (t <= max(t0, t1))
                if not hit.any():
                    continue
                # y = t (h - z) on the ray; y = start + m (z - z0) or z = z0 on the face.
                if z0 == z1:
                    z = np.full(hit.sum(), z0)
                else:
                    slope = (end - start) / (z1 - z0)
                    z = (t[hit] * height_m - start + slope * z0) / (slope + t[hit])
                place = np.flatnonzero(hit)
                nearer = z > highest[place]
                highest[place[nearer]] = z[nearer]
                value[place[nearer]] = grey
    return value, np.isfinite(highest).astype(np.float64)


def _mean(
    table: NDArray[np.float64], t: NDArray[np.float64], half: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The mean of a table over [t - half, t + half]."""
    edges = -_SPAN + (np.arange(len(table) + 1) - 0.5) * _STEP
    running = np.concatenate(([0.0], np.cumsum(table) * _STEP))
    upper, lower = (np.interp(t + sign * half, edges, running) for sign in (1, -1))
    return np.asarray((upper - lower) / (2 * half))
