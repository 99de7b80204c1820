"""Textures that repeat along the track, and how they are sampled without aliasing.

A texture is (rows along the track, columns across it, channels) float32; row 0 follows the last one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

Floats = NDArray[np.float32]


def octave(rng: Generator, shape: tuple[int, int], cell: tuple[float, float]) -> Floats:
    """Smooth noise of unit variance whose lumps are about ``cell`` texels large; rows repeat."""
    rows, columns = shape
    coarse_rows, coarse_columns = (max(1, round(size / step)) for size, step in zip(shape, cell, strict=True))
    grid = rng.standard_normal((coarse_rows, coarse_columns + 4), dtype=np.float32)
    grid = np.take(grid, np.arange(-2, coarse_rows + 2), axis=0, mode="wrap")
    at_row = (np.arange(rows, dtype=np.float32) + 0.5) * coarse_rows / rows + 1.5
    at_column = (np.arange(columns, dtype=np.float32) + 0.5) * coarse_columns / columns + 1.5
    map_column, map_row = np.meshgrid(at_column, at_row)
    noise = np.asarray(cv2.remap(grid, map_column, map_row, cv2.INTER_CUBIC), np.float32)
    return noise / max(float(noise.std()), 1e-6)


def stones(rng: Generator, shape: tuple[int, int], across: float) -> tuple[Floats, Floats]:
    """A bed of broken stone: a random number (normal) for the stone under each texel, and its shade.

    Stones are the cells of random points (Worley 1996), ``across`` texels wide on average. The
    shade falls towards the gaps and on the side away from the light; mean about 0.
    """
    rows, columns = shape
    border = int(4 * across)
    count = int(rows * columns / across**2)
    seeds = np.full(shape, 255, np.uint8)
    seeds[rng.integers(0, rows, count), rng.integers(0, columns, count)] = 0
    padded = np.take(seeds, np.arange(-border, rows + border), axis=0, mode="wrap")
    distance, label = cv2.distanceTransformWithLabels(padded, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    # The same stone in the margin and at the far end must have the same number: hash its place.
    of_label = np.zeros(int(label.max()) + 1, np.float32)
    place_row, place_column = np.nonzero(padded == 0)
    numbers = rng.standard_normal(shape, dtype=np.float32)
    of_label[label[place_row, place_column]] = numbers[(place_row - border) % rows, place_column]
    inner = slice(border, border + rows)
    depth = np.asarray(distance, np.float32)
    slope = cv2.Sobel(cv2.GaussianBlur(depth, (0, 0), 1.0), cv2.CV_32F, 0, 1)
    shade = -((depth / across) ** 2) * 2.0 + 0.05 * slope
    return of_label[label][inner], np.asarray(shade[inner] - shade[inner].mean(), np.float32)


class RipMap:
    """A texture at growing footprints: level n averages 2^n rows and 2^shifts[n] columns.

    A mip-map with its own step for each direction: seen flatly, the footprint of a pixel is much
    longer along the track than across it.
    """

    def __init__(self, texture: Floats, shifts: Sequence[int]) -> None:
        self.rows, self.columns = texture.shape[:2]
        self.levels: list[Floats] = []
        for level, shift in enumerate(shifts):
            size = (max(1, self.columns >> shift), max(1, self.rows >> level))
            smaller = np.asarray(cv2.resize(texture, size, interpolation=cv2.INTER_AREA), np.float32)
            # One row more at either end, so that interpolation runs over the seam.
            self.levels.append(np.take(smaller, np.arange(-1, len(smaller) + 1), axis=0, mode="wrap"))


@dataclass(frozen=True, slots=True, eq=False)
class _Level:
    """The share of one level in a view."""

    part: tuple[slice, slice]
    texture: Floats
    scale: float
    """Its rows per row of level 0."""
    row: Floats
    column: Floats
    weight: Floats


class View:
    """A texture as a camera sees it that only moves along the track.

    Args:
        row, column: (H, W) or broadcast to it, which texel each pixel sees, at shift 0.
        footprint: (H, 1) or (1, W), how many texels long a pixel is.
    """

    def __init__(self, texture: RipMap, row: Floats, column: Floats, footprint: Floats) -> None:
        self._shape = np.broadcast_shapes(row.shape, column.shape)
        axis = int(footprint.shape[0] == 1)
        top = len(texture.levels) - 1
        level = np.clip(np.log2(np.maximum(footprint.ravel(), 1.0)), 0, top)
        self._rows = texture.rows
        self._levels: list[_Level] = []
        for number, pixels in enumerate(texture.levels):
            # Linear between two levels, so that no step shows where they meet.
            weight = np.maximum(1 - np.abs(level - number), 0).astype(np.float32)
            used = np.flatnonzero(weight)
            if not used.size:
                continue
            along = slice(int(used[0]), int(used[-1]) + 1)
            part = (slice(None), along) if axis else (along, slice(None))
            height, width = len(pixels) - 2, pixels.shape[1]
            scale = height / self._rows
            at_row = np.mod(row[part] + 0.5, self._rows) * scale
            at_column = (column[part] + 0.5) * (width / texture.columns) - 0.5
            shaped = weight[None, along] if axis else weight[along, None]
            self._levels.append(
                _Level(
                    part,
                    pixels,
                    scale,
                    at_row.astype(np.float32),
                    np.ascontiguousarray(at_column, np.float32),
                    np.ascontiguousarray(np.broadcast_to(shaped, at_column.shape)),
                )
            )

    def render(self, shift: float) -> Floats:
        """(H, W, channels if more than one), the texture moved ``shift`` rows towards the camera."""
        shift %= self._rows
        image: Floats | None = None
        for level in self._levels:
            row = level.row + np.float32(shift * level.scale)
            height = np.float32(len(level.texture) - 2)
            np.subtract(row, height, out=row, where=row >= height)
            row += np.float32(0.5)  # the row put before the first, less half a texel
            whole = np.ascontiguousarray(np.broadcast_to(row, level.column.shape))
            found = cv2.remap(
                level.texture, level.column, whole, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            weight = level.weight if found.ndim == 2 else cv2.merge([level.weight] * found.shape[2])
            if image is None:
                image = np.zeros((*self._shape, *found.shape[2:]), np.float32)
            image[level.part] += np.asarray(cv2.multiply(found, weight))
        assert image is not None, "every pixel has a level"
        return image
