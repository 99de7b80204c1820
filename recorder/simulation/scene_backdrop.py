"""What is far away or beside the line: sky, hills, and a wood on either side."""

import math

import numpy as np
from numpy.random import Generator

from recorder.simulation.scene_camera import Floats, SceneCamera
from recorder.simulation.scene_ground import HAZE, HAZE_M, PLANE_M
from recorder.simulation.textures import RipMap, View, octave

_TEXEL_M = 0.025
_TOP_M = 11.0
_SHIFTS = (0, 0, 0, 1, 1, 2, 2, 3, 3, 4)


def sky_and_hills(camera: SceneCamera, rng: Generator) -> Floats:
    """(H, W) grey values of an overcast sky above two ranges of hills; haze below the horizon."""
    shape = camera.height, camera.width
    scale = camera.width / 1280
    above = (camera.horizon_row - np.arange(camera.height, dtype=np.float32))[:, None] / scale
    clouds = sum(
        share * octave(rng, shape, (size * scale * 0.45, size * scale))
        for size, share in ((420, 24.0), (170, 13.0), (70, 6.0), (28, 2.5))
    )
    fade = np.clip(above / 200, 0.15, 1)
    image = 655 + 0.30 * np.clip(above, 0, 400) + clouds * fade
    columns = np.arange(camera.width, dtype=np.float32)[None, :] / scale
    for base, height, grey, grain in ((26.0, 20.0, 0.62, 3.0), (9.0, 8.0, 0.45, 9.0)):
        phases = rng.uniform(0, 2 * math.pi, 6)
        ridge = base + height * sum(
            np.sin(columns * (n + 1) * 0.0031 + phase) / (n + 1) ** 0.8 for n, phase in enumerate(phases)
        )
        wood = octave(rng, shape, (3 * scale, 5 * scale))
        ridge = np.maximum(ridge, 3.0) + wood[0][None, :] * 1.3
        cover = np.clip(ridge - above + 0.5, 0, 1)
        hill = HAZE * (0.55 + 0.7 * (1 - grey) * 0.6) + grain * wood
        image = image * (1 - cover) + hill * cover
    return np.asarray(np.where(above < 0, HAZE, image), np.float32)


class Wood:
    """Bushes and trees as a wall along the line, ``side_m`` to the left (negative: right)."""

    def __init__(self, camera: SceneCamera, side_m: float, period_m: float, rng: Generator) -> None:
        rows = round(period_m / _TEXEL_M)
        texture = RipMap(_foliage(rows, round(_TOP_M / _TEXEL_M), rng), _SHIFTS)
        self._texel_m = period_m / rows
        column = camera.centre_px[0]
        nearest_m = abs(side_m) * camera.focal_px / column
        last = min(camera.height, math.ceil(camera.project(nearest_m, side_m, PLANE_M)[1]) + 8)
        inner = 2  # columns next to the vanishing point, where the wall is all haze
        ahead = (
            slice(0, int(column) - inner) if side_m > 0 else slice(math.ceil(column) + inner, camera.width)
        )
        self._part = (slice(0, last), ahead)
        depth = (side_m / camera.left[ahead])[None, :]
        x_m = depth * camera.forward[:last, None]
        z_m = camera.height_m - depth * camera.down[:last, None]
        footprint = np.abs(np.gradient(x_m[last // 2]))[None, :] / self._texel_m
        self._view = View(texture, x_m / self._texel_m - 0.5, (_TOP_M - z_m) / _TEXEL_M - 0.5, footprint)
        self._clear = np.exp(-x_m / HAZE_M).astype(np.float32)
        self._haze = HAZE * (1 - self._clear)
        # Where the wall meets the ground, to a fraction of a pixel.
        self._stands = np.clip((z_m - PLANE_M) * camera.focal_px / depth + 0.5, 0, 1).astype(np.float32)

    def over(self, image: Floats, position_m: float) -> None:
        """Draw it into an image."""
        layer = self._view.render(position_m / self._texel_m)
        value = layer[..., 0] * self._stands
        cover = layer[..., 1] * self._stands
        seen = image[self._part]
        seen += value * self._clear + cover * (self._haze - seen)


def _foliage(rows: int, columns: int, rng: Generator) -> Floats:
    """(rows along the line, columns from the top down, value times cover and cover)."""
    height_m = _TOP_M - (np.arange(columns, dtype=np.float32)[None, :] + 0.5) * _TEXEL_M

    def lumps(along_m: float, high_m: float) -> Floats:
        return octave(rng, (rows, columns), (along_m / _TEXEL_M, high_m / _TEXEL_M))

    def waves(along_m: float) -> Floats:
        return octave(rng, (rows, 1), (along_m / _TEXEL_M, 1))

    # Longer than high, for they are seen from their narrow end.
    boughs, twigs, leaves = lumps(2.2, 0.9), lumps(0.7, 0.3), lumps(0.22, 0.10)
    top_m = np.maximum(5.4 + 0.7 * waves(7.0) + 0.4 * waves(2.5) + 0.2 * waves(1.0), 3.9)
    inside_m = top_m - height_m + 0.30 * boughs + 0.15 * twigs + 0.06 * leaves
    cover = np.clip(inside_m / 0.20 + 0.5, 0, 1)
    depth = np.clip(inside_m / 3.5, 0, 1)
    light = np.exp(0.17 * boughs + 0.17 * twigs + 0.12 * leaves - 0.50 * depth)
    under = 1 - 0.35 * np.exp(-((height_m / 0.6) ** 2))
    return np.stack([420 * light * under * cover, cover], axis=-1).astype(np.float32)
