"""The ground of the scene: sleepers in ballast, a cable duct, grass; on a plane below the rail tops."""

import numpy as np
from numpy.random import Generator

from recorder.simulation.scene_camera import Floats, SceneCamera
from recorder.simulation.textures import RipMap, View, octave, stones

PLANE_M = -0.18
"""Of sleeper tops and ballast, against the rail tops."""
SLEEPER_M = 0.60
TRACKS_M = (0.0, 4.5)
"""Centres of the own track and of the one to its left."""
SIDES_M = (13.5, -10.5)
"""Where the ground ends, to the left and to the right: woods stand there."""
HAZE = 560.0
"""Grey value of the air at the horizon."""
HAZE_M = 420.0
"""After which distance 1/e of a colour is left."""

_TEXEL_M = 0.008
_BED_M = (7.7, -4.8)
"""Where there may be ballast; grass beyond."""
_SHIFTS = (0, 0, 0, 0, 1, 1, 2, 2, 3, 3)
"""Seen from 2.8 m, a footprint 2^n long is 2^(n/2) wide: half as many halvings across."""


class Ground:
    """What the camera sees of the plane, at any place along the track."""

    def __init__(self, camera: SceneCamera, period_m: float, rng: Generator) -> None:
        texture = RipMap(_texture(period_m, rng), _SHIFTS)
        self._texel_m = period_m / texture.rows
        self.first_row = int(np.floor(camera.horizon_row)) + 2
        depth = (camera.height_m - PLANE_M) / camera.down[self.first_row :]
        x_m = (depth * camera.forward[self.first_row :])[:, None]
        y_m = depth[:, None] * camera.left[None, :]
        column = (SIDES_M[0] - y_m) / _TEXEL_M - 0.5
        footprint = np.abs(np.gradient(x_m[:, 0]))[:, None] / self._texel_m
        self._view = View(texture, x_m / self._texel_m - 0.5, column, footprint)
        self._clear = np.exp(-x_m / HAZE_M).astype(np.float32)

    def render(self, position_m: float) -> Floats:
        """Grey values of the rows from ``first_row`` down, noise-free and without black level."""
        image = self._view.render(position_m / self._texel_m)
        image *= self._clear
        image += HAZE * (1 - self._clear)
        return image


class _Plot:
    """A strip of the ground, from ``left_m`` to ``right_m``, with the noise that shapes it."""

    def __init__(self, period_m: float, left_m: float, right_m: float, rng: Generator) -> None:
        self.period_m = period_m
        rows, columns = round(period_m / _TEXEL_M), round((left_m - right_m) / _TEXEL_M)
        self.shape = rows, columns
        self.x_m = ((np.arange(rows, dtype=np.float32) + 0.5) * (period_m / rows))[:, None]
        self.y_m = (left_m - (np.arange(columns, dtype=np.float32) + 0.5) * _TEXEL_M)[None, :]
        self.large, self.middle, self.small = (self.lumps(rng, size, size) for size in (1.3, 0.25, 0.07))
        self.rough = rng.standard_normal(self.shape, dtype=np.float32)

    def lumps(self, rng: Generator, along_m: float, across_m: float) -> Floats:
        return octave(rng, self.shape, (along_m / _TEXEL_M, across_m / _TEXEL_M))


def _texture(period_m: float, rng: Generator) -> Floats:
    """(rows along the track, columns from left to right)."""
    left = _grass(_Plot(period_m, SIDES_M[0], _BED_M[0], rng), rng)
    right = _grass(_Plot(period_m, _BED_M[1], SIDES_M[1], rng), rng)
    return np.hstack([left, _bed(_Plot(period_m, *_BED_M, rng), rng), right])


def _grass(plot: _Plot, rng: Generator) -> Floats:
    """Bright in the near infrared."""
    blades = plot.lumps(rng, 0.04, 0.02)
    patches = plot.lumps(rng, 4.0, 1.5)
    return np.asarray(
        385 * np.exp(0.12 * blades + 0.11 * plot.small + 0.09 * plot.middle + 0.08 * (plot.large + patches)),
        np.float32,
    )


def _bed(plot: _Plot, rng: Generator) -> Floats:
    """Ballast and what lies in it, ragged grass along its edges."""
    number, shade = stones(rng, plot.shape, 0.045 / _TEXEL_M)
    bed = 238 * np.exp(0.20 * number + 0.42 * shade + 0.05 * plot.large + 0.05 * plot.rough)
    bed *= 1 - _stain(plot.y_m)
    for centre_m in TRACKS_M:
        near = np.flatnonzero(np.abs(plot.y_m[0] - centre_m) < 1.4)
        strip = slice(int(near[0]), int(near[-1]) + 1)
        bed[:, strip] = _with_sleepers(bed[:, strip], plot, strip, centre_m, number[:, strip], rng)
    bed = _with_duct(bed, plot)
    beyond_m = np.maximum(-4.35 - plot.y_m, plot.y_m - 7.2)
    beyond_m = beyond_m + 0.16 * plot.large + 0.07 * plot.middle + 0.04 * plot.small
    cover = np.clip(beyond_m / 0.08 + 0.5, 0, 1)
    # Weeds on the shoulder: the bed is not clean near its edge.
    rarity = 2.9 + 2.0 * np.clip(-beyond_m - 0.2, 0, 3)
    weeds = (plot.small + 0.8 * plot.middle + 0.6 * plot.large > rarity) & (beyond_m < 0)
    cover = np.where(weeds, np.float32(0.8), cover)
    return np.asarray(bed * (1 - cover) + _grass(plot, rng) * cover, np.float32)


def _stain(y_m: Floats) -> Floats:
    """Iron dust beside each rail, oil in the middle: the share of light that they take."""
    stain = np.zeros_like(y_m)
    for centre_m in TRACKS_M:
        for rail_m in (-0.75, 0.75):
            stain += 0.28 * np.exp(-(((y_m - centre_m - rail_m) / 0.28) ** 2))
        stain += 0.10 * np.exp(-(((y_m - centre_m) / 0.3) ** 2))
    return stain


def _with_sleepers(
    ground: Floats, plot: _Plot, strip: slice, centre_m: float, number: Floats, rng: Generator
) -> Floats:
    """Concrete sleepers, 2.6 m long, stones lying on their ends, with the rails' fastenings."""
    across_m = np.abs(plot.y_m[:, strip] - centre_m)
    lumps, rough = plot.middle[:, strip], plot.rough[:, strip]
    count = max(1, round(plot.period_m / SLEEPER_M))
    spacing_m = plot.period_m / count
    index = np.minimum((plot.x_m / spacing_m).astype(np.int64), count - 1)
    along_m = np.abs(plot.x_m - ((index + 0.5) * spacing_m).astype(np.float32))
    half_m = 0.115 + 0.02 * np.clip((across_m - 0.3) / 0.4, 0, 1)
    edge_m = np.minimum(half_m - along_m, 1.30 - across_m)
    cover = np.clip((edge_m + 0.006 * lumps) / 0.02 + 0.5, 0, 1)
    # Ballast creeps over the ends, and single stones lie anywhere.
    buried = number > 2.3 - 2.0 * np.clip((across_m - 1.0) / 0.3, 0, 1)
    cover = np.where(buried, 0.15 * cover, cover)
    own = rng.normal(1.0, 0.08, count).astype(np.float32)[index]
    worn = 1 - 0.22 * np.exp(-(((across_m - 0.75) / 0.22) ** 2))
    concrete = 372 * own * worn * (1 + 0.06 * lumps + 0.035 * plot.small[:, strip] + 0.03 * rough)
    # Clamps on either side of the foot.
    clamp_m = np.minimum(0.038 - np.abs(np.abs(across_m - 0.753) - 0.125), 0.045 - along_m)
    concrete = concrete * (1 - 0.5 * np.clip(clamp_m / 0.012 + 0.5, 0, 1))
    # A sleeper stands a little out of the ballast and shades the stones beside it.
    shadow = 0.35 * np.exp(-(((along_m - half_m - 0.02) / 0.025) ** 2)) * (across_m < 1.3)
    return np.asarray(ground * (1 - shadow) * (1 - cover) + concrete * cover, np.float32)


def _with_duct(ground: Floats, plot: _Plot) -> Floats:
    """A cable duct to the right, with concrete lids of half a metre."""
    lids = max(1, round(plot.period_m / 0.5))
    along = np.mod(plot.x_m * (lids / plot.period_m), 1.0)
    joint_m = np.minimum(along, 1 - along) * (plot.period_m / lids)
    inside_m = 0.19 - np.abs(plot.y_m + 3.95)
    lid = 350 * (1 + 0.05 * plot.middle + 0.03 * plot.rough) * (1 - 0.55 * np.exp(-((joint_m / 0.014) ** 2)))
    cover = np.clip(inside_m / 0.02 + 0.5, 0, 1)
    edge = 1 - 0.5 * np.exp(-(((inside_m + 0.02) / 0.03) ** 2))
    return np.asarray(ground * edge * (1 - cover) + lid * cover, np.float32)
