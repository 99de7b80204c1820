"""The pinhole of the small scene: from pixels to rays, with pitch alone."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

FOCAL_M = 8e-3
PIXEL_M = 5.3e-6
"""Lens and pixel pitch of the report's front camera (UI-3240CP-NIR)."""


@dataclass(frozen=True)
class SceneCamera:
    """Axes as in the house: vehicle x forward, y left, z up from the rail tops; pitch + downwards."""

    width: int
    height: int
    height_m: float = 2.6
    """Above the rail tops, midway between the rails."""
    pitch_rad: float = math.radians(6.0)

    @property
    def focal_px(self) -> float:
        """Columns; a smaller image is the same view with larger pixels."""
        return FOCAL_M / PIXEL_M * self.width / 1280

    @property
    def centre_px(self) -> tuple[float, float]:
        """Column and row of the principal point; pixel centres are integers."""
        return (self.width - 1) / 2, (self.height - 1) / 2

    @property
    def horizon_row(self) -> float:
        return self.centre_px[1] - self.focal_px * math.tan(self.pitch_rad)

    @cached_property
    def left(self) -> Floats:
        """(W,) how far a ray of each column goes to the left, per unit of optical depth."""
        return ((self.centre_px[0] - np.arange(self.width)) / self.focal_px).astype(np.float32)

    @cached_property
    def forward(self) -> Floats:
        """(H,) how far a ray of each row goes forward, per unit of optical depth."""
        return (math.cos(self.pitch_rad) - self._rows * math.sin(self.pitch_rad)).astype(np.float32)

    @cached_property
    def down(self) -> Floats:
        """(H,) how far a ray of each row goes down, per unit of optical depth; negative in the sky."""
        return (math.sin(self.pitch_rad) + self._rows * math.cos(self.pitch_rad)).astype(np.float32)

    @property
    def _rows(self) -> NDArray[np.float64]:
        return np.asarray((np.arange(self.height) - self.centre_px[1]) / self.focal_px, np.float64)

    def project(self, x_m: float, y_m: float, z_m: float) -> tuple[float, float]:
        """Column and row of a point in front of the camera."""
        rise = z_m - self.height_m
        depth = x_m * math.cos(self.pitch_rad) - rise * math.sin(self.pitch_rad)
        below = -x_m * math.sin(self.pitch_rad) - rise * math.cos(self.pitch_rad)
        column, row = self.centre_px
        return column - self.focal_px * y_m / depth, row + self.focal_px * below / depth
