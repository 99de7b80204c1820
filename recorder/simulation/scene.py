"""A first small world: a straight line seen from the cab, as a near-infrared camera sees it."""

import numpy as np
from numpy.typing import NDArray

from recorder.samples import Pixels
from recorder.simulation.scene_backdrop import Wood, sky_and_hills
from recorder.simulation.scene_camera import Floats, SceneCamera
from recorder.simulation.scene_ground import SIDES_M, Ground
from recorder.simulation.scene_masts import SPACING_M, Masts
from recorder.simulation.scene_rails import Rails
from recorder.simulation.sensor import Sensor

EXPOSURE = 0.9
"""Grey values over those that the parts of the scene state."""
VIGNETTING = 0.16
"""Light that the corners lack."""


class Scene:
    """Renders what the front camera sees at a place along the line, 10 bits deep.

    The world repeats every ``period_m`` and is built when it is first looked at (about three
    seconds). The same seed and place give the same frame, noise included.
    """

    bit_depth = 10

    def __init__(
        self, width: int = 1280, height: int = 1024, seed: int = 1, *, period_m: float = SPACING_M
    ) -> None:
        self.camera = SceneCamera(width, height)
        self.sensor = Sensor(self.bit_depth)
        self._seed = seed
        self._period_m = period_m
        self._built: _World | None = None

    def mean(self, position_m: float) -> Floats:
        """(H, W) the expected grey values at a place, without noise."""
        if self._built is None:
            self._built = _World(self.camera, self._period_m, self._seed)
        return self._built.light(position_m) + np.float32(self.sensor.black_level)

    def render(self, position_m: float) -> Pixels:
        """(H, W) one exposure at a place."""
        place_um = round(position_m * 1e6) % (1 << 63)
        noise = np.random.Generator(np.random.SFC64([self._seed, place_um]))
        return self.sensor.expose(self.mean(position_m), noise)

    def loop(self, frames: int, metres: float) -> NDArray[np.uint16]:
        """(frames, H, W) a ride over ``metres`` at constant speed whose end joins its beginning.

        The world of a loop repeats every ``metres``; sleepers and masts keep their spacing as
        nearly as that allows.
        """
        scene = self
        if metres != self._period_m:
            scene = Scene(self.camera.width, self.camera.height, self._seed, period_m=metres)
        stack = np.empty((frames, self.camera.height, self.camera.width), np.uint16)
        for index in range(frames):
            stack[index] = scene.render(index * metres / frames)
        return stack


class _World:
    """Everything that stands along one period of the line."""

    def __init__(self, camera: SceneCamera, period_m: float, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self._far = sky_and_hills(camera, rng)
        self._woods = [Wood(camera, side_m, period_m, rng) for side_m in SIDES_M]
        self._ground = Ground(camera, period_m, rng)
        self._rails = Rails(camera, self._ground.first_row, period_m, rng)
        self._masts = Masts(camera, period_m / max(1, round(period_m / SPACING_M)))
        self._lens = np.float32(EXPOSURE) * _lens(camera.width, camera.height)

    def light(self, position_m: float) -> Floats:
        """(H, W) grey values over darkness, painted from the far to the near."""
        image = self._far.copy()
        ground = self._ground.render(position_m)
        image[self._ground.first_row :] = self._rails.over(ground, position_m)
        for wood in self._woods:
            wood.over(image, position_m)
        self._masts.over(image, position_m)
        image *= self._lens
        return image


def _lens(width: int, height: int) -> Floats:
    """(H, W) relative illumination: falls with the square of the distance from the centre."""
    columns = (np.arange(width, dtype=np.float32) - (width - 1) / 2)[None, :]
    rows = (np.arange(height, dtype=np.float32) - (height - 1) / 2)[:, None]
    far = (width**2 + height**2) / 4
    return np.asarray(1 - VIGNETTING * (columns**2 + rows**2) / far, np.float32)
