"""Masts beside the track with their arms, and the wires that they carry."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import cv2
import numpy as np

from recorder.simulation.scene_camera import Floats, SceneCamera
from recorder.simulation.scene_ground import HAZE, HAZE_M, PLANE_M, TRACKS_M

MAST_M = -3.1
"""Centre line of the masts, right of the own track."""
SPACING_M = 48.0
TOP_M = 7.8
WIRE_M = 5.5
MESSENGER_M = 6.9

_FARTHEST_M = 400.0
_DETAILED_M = 130.0
"""Up to there arms and messenger are drawn; beyond, the masts alone."""
_NEAREST_M = 3.0
_FINE = 4
"""Subpixels a pixel and direction."""

Point = tuple[float, float, float]
# Parts of one mast, painted in this order: a beam from point to point (x from the mast, y, z), its
# width in metres and its grey value.
_BEAMS: Sequence[tuple[Point, Point, float, float]] = (
    ((0, MAST_M, PLANE_M), (0, MAST_M, 0.25), 0.70, 300.0),
    ((0, MAST_M, 0.2), (0, MAST_M, TOP_M), 0.26, 170.0),
    ((0, MAST_M + 0.09, 0.2), (0, MAST_M + 0.09, TOP_M), 0.07, 265.0),
    ((0, MAST_M - 0.11, 0.2), (0, MAST_M - 0.11, TOP_M), 0.04, 225.0),
    ((0, MAST_M, 5.7), (0, 0.0, MESSENGER_M), 0.055, 180.0),
    ((0, MAST_M, 7.1), (0, 0.0, MESSENGER_M + 0.05), 0.045, 180.0),
    ((0, -1.9, 6.15), (0, 0.35, 5.75), 0.04, 190.0),
    ((0, 0.35, 5.75), (0, -0.2, WIRE_M), 0.03, 190.0),
    ((0, MAST_M + 0.02, 2.15), (0, MAST_M + 0.02, 2.55), 0.36, 640.0),
    ((0, MAST_M + 0.02, 2.30), (0, MAST_M + 0.02, 2.40), 0.20, 120.0),
)
_POLE = _BEAMS[1:2]
_WIRE_GREY = 200.0
_SAG = 1.1 / SPACING_M**2
"""Of the messenger, over the square of the span."""


class Masts:
    """Masts every ``spacing_m``, the first one at x = 0 of the line."""

    def __init__(self, camera: SceneCamera, spacing_m: float) -> None:
        self._camera = camera
        self._spacing_m = spacing_m
        self._wires = self._contact_wires()

    def over(self, image: Floats, position_m: float) -> None:
        """Draw wires and masts into an image, from the farthest to the nearest."""
        rows, columns, value, cover = self._wires
        seen = image[rows, columns]
        seen += value - cover * seen
        passed_m = position_m % self._spacing_m
        for place_m in np.arange(-passed_m, _FARTHEST_M, self._spacing_m)[::-1].tolist():
            if place_m < _DETAILED_M:
                self._messenger(image, place_m)
            if place_m > _NEAREST_M:
                for start, end, width_m, grey in _BEAMS if place_m < _DETAILED_M else _POLE:
                    self._beam(image, _ahead(start, place_m), _ahead(end, place_m), width_m, grey)

    def _contact_wires(self) -> tuple[slice, slice, Floats, Floats]:
        """They run level and straight, so they look the same from everywhere: drawn once."""
        rows = slice(0, max(1, math.ceil(self._camera.horizon_row)))
        layers = []
        for start in (0.0, 1.0):
            layer = np.full((rows.stop, self._camera.width), start, np.float32)
            cuts = np.geomspace(_NEAREST_M, _FARTHEST_M, 24)[::-1]
            for far_m, near_m in pairwise(cuts.tolist()):
                for wire_m in TRACKS_M:
                    ends = (near_m, wire_m, WIRE_M), (far_m, wire_m, WIRE_M)
                    self._beam(layer, *ends, 0.014, _WIRE_GREY)
            layers.append(layer)
        # Over black and over white: what a layer adds, and what it lets through.
        value, over_white = layers
        return rows, slice(None), value, 1 - (over_white - value)

    def _messenger(self, image: Floats, place_m: float) -> None:
        """The wire that carries the contact wire, sagging from one mast to the next."""
        pieces = 6 if place_m < 60 else 2
        sag_m = _SAG * self._spacing_m**2
        for wire_m in TRACKS_M:
            for piece in range(pieces):
                shares = piece / pieces, (piece + 1) / pieces
                near, far = (
                    (place_m + share * self._spacing_m, wire_m, MESSENGER_M - sag_m * 4 * share * (1 - share))
                    for share in shares
                )
                if near[0] > _NEAREST_M:
                    self._beam(image, near, far, 0.016, _WIRE_GREY)

    def _beam(self, image: Floats, start: Point, end: Point, width_m: float, grey: float) -> None:
        """A bar as wide as it looks at either end, its cover taken from a finer grid."""
        camera = self._camera
        tips = [camera.project(*point) for point in (start, end)]
        widths = [width_m * camera.focal_px / point[0] for point in (start, end)]
        along = math.hypot(tips[1][0] - tips[0][0], tips[1][1] - tips[0][1])
        if along < 1e-6:
            return
        across = (tips[0][1] - tips[1][1]) / along / 2, (tips[1][0] - tips[0][0]) / along / 2
        # A bar narrower than a subpixel is drawn one wide and as much fainter.
        drawn = [max(width, 1.0 / _FINE) for width in widths]
        strength = min(1.0, sum(widths) / sum(drawn))
        corners = np.array(
            [
                (tips[tip][0] + sign * across[0] * drawn[tip], tips[tip][1] + sign * across[1] * drawn[tip])
                for tip, sign in ((0, 1), (0, -1), (1, -1), (1, 1))
            ]
        )
        for rows, columns in _tiles(corners, image.shape[0], image.shape[1]):
            cover = _cover(corners, rows, columns) * strength
            clear = math.exp(-(start[0] + end[0]) / 2 / HAZE_M)
            seen = image[rows, columns]
            seen += cover * (grey * clear + HAZE * (1 - clear) - seen)


def _ahead(point: Point, x_m: float) -> Point:
    return point[0] + x_m, point[1], point[2]


def _tiles(corners: np.ndarray, height: int, width: int) -> Iterator[tuple[slice, slice]]:
    """The part of the image that a shape may touch, if any."""
    left, top = (int(value) for value in np.floor(corners.min(axis=0)))
    right, bottom = (int(value) + 2 for value in np.ceil(corners.max(axis=0)))
    rows = slice(max(top, 0), min(bottom, height))
    columns = slice(max(left, 0), min(right, width))
    if rows.start < rows.stop and columns.start < columns.stop:
        yield rows, columns


def _cover(corners: np.ndarray, rows: slice, columns: slice) -> Floats:
    """How much of each pixel of a tile a convex shape covers."""
    size = rows.stop - rows.start, columns.stop - columns.start
    fine = np.zeros((size[0] * _FINE, size[1] * _FINE), np.uint8)
    # The centre of pixel 0 lies in the middle of its subpixels; 4 bits below the point.
    places = (corners - (columns.start, rows.start) + 0.5) * _FINE - 0.5
    cv2.fillConvexPoly(fine, np.round(places * 16).astype(np.int32), 255, cv2.LINE_8, 4)
    mean = cv2.resize(fine, (size[1], size[0]), interpolation=cv2.INTER_AREA)
    return np.asarray(mean, np.float32) / np.float32(255)
