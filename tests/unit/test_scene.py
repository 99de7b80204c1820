"""The small scene: geometry by the pinhole model, noise by the photon transfer, a loop without a seam."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from recorder.simulation.scene import Scene
from recorder.simulation.scene_camera import SceneCamera
from recorder.simulation.sensor import Sensor
from recorder.simulation.textures import RipMap, View, octave, stones

LOOP_M = 24.0


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Full size, as the brightness and the rails are meant to be seen."""
    return Scene(period_m=LOOP_M)


@pytest.fixture(scope="module")
def mean(scene: Scene) -> NDArray[np.float32]:
    return scene.mean(3.0)


class TestCamera:
    def test_projection_agrees_with_the_rays(self) -> None:
        camera = SceneCamera(1280, 1024)
        for row, column in ((900, 200), (500, 1000)):
            depth = camera.height_m / camera.down[row]
            place = depth * camera.forward[row], depth * camera.left[column], 0.0
            assert camera.project(*map(float, place)) == pytest.approx((column, row), abs=1e-3)

    def test_pitch_is_that_of_the_vanishing_point(self) -> None:
        camera = SceneCamera(1280, 1024)
        _, vanishing = camera.project(1e9, 0, 0)
        assert vanishing == pytest.approx(camera.horizon_row, abs=1e-3)
        pitch = math.atan((camera.centre_px[1] - camera.horizon_row) / camera.focal_px)
        assert pitch == pytest.approx(camera.pitch_rad)

    def test_focal_length(self) -> None:
        assert SceneCamera(1280, 1024).focal_px == pytest.approx(1509.43, abs=0.01)


class TestRails:
    @pytest.mark.parametrize("row", [480, 600, 750, 900, 1000])
    @pytest.mark.parametrize("side", [1, -1])
    def test_running_band_lies_where_the_pinhole_model_says(
        self, scene: Scene, mean: NDArray[np.float32], row: int, side: int
    ) -> None:
        camera = scene.camera
        # Where this row meets the rail tops, and there the band's edges, 12 and 46 mm from the inner face.
        x_m = camera.height_m * float(camera.forward[row]) / float(camera.down[row])
        inner, outer = (camera.project(x_m, side * (1.435 / 2 + d), 0.0)[0] for d in (0.012, 0.046))
        middle, width = (inner + outer) / 2, abs(outer - inner)
        reach = round(middle - 2 * width), round(middle + 2 * width) + 1
        # Bright pixels over the level halfway to the grey beside them: their centroid is the band's.
        line = mean[row, reach[0] : reach[1]] - scene.sensor.black_level
        bright = np.clip(line - 0.85 * line.max(), 0, None)
        found = float((bright * np.arange(*reach)).sum() / bright.sum())
        assert found == pytest.approx(middle, abs=0.4)

    def test_gauge_is_between_the_inner_faces(self, scene: Scene, mean: NDArray[np.float32]) -> None:
        camera, row = scene.camera, 1000
        x_m = camera.height_m * float(camera.forward[row]) / float(camera.down[row])
        gauge_px = camera.project(x_m, -1.435 / 2, 0)[0] - camera.project(x_m, 1.435 / 2, 0)[0]
        bands = np.flatnonzero(mean[row] > 550)
        left, right = bands[bands < 640], bands[bands > 640]
        # From band to band inside there are 12 mm more on either side.
        assert right.min() - left.max() == pytest.approx(gauge_px * (1 + 0.024 / 1.435), abs=2.0)


class TestLight:
    def test_grey_values_use_the_range(self, scene: Scene) -> None:
        frame = scene.render(3.0)
        assert frame.shape == (1024, 1280)
        assert frame.dtype == np.uint16
        assert frame.max() < 1024
        low, middle, high = np.percentile(frame, [1, 50, 99])
        assert 60 < low < 200
        assert 220 < middle < 450
        assert 600 < high < 1000

    def test_same_seed_same_frame(self) -> None:
        first, again, other = (Scene(320, 256, seed, period_m=6.0).render(1.5) for seed in (1, 1, 2))
        np.testing.assert_array_equal(first, again)
        assert (first != other).mean() > 0.8

    def test_any_place_may_be_asked_for(self) -> None:
        scene = Scene(320, 256, period_m=6.0)
        np.testing.assert_allclose(scene.mean(-1.5), scene.mean(4.5 + 6e6), atol=0.5)


class TestNoise:
    def test_noise_follows_the_photon_transfer_curve(self, scene: Scene, mean: NDArray[np.float32]) -> None:
        noise = scene.render(3.0).astype(np.float32) - mean
        for low in (100, 200, 300, 500, 650):
            part = (mean >= low) & (mean < low + 40)
            assert part.sum() > 5_000
            # Electrons over electrons a grey value, the read noise, and a twelfth for rounding.
            gain = 7700 / (1023 - 12)
            expected = ((mean[part].mean() - 12) * gain + 10**2) / gain**2 + 1 / 12
            assert noise[part].var() == pytest.approx(expected, rel=0.05)
            assert noise[part].mean() == pytest.approx(0, abs=0.5)

    def test_the_sensor_ends_at_white_and_black(self) -> None:
        values = np.array([[-500.0, 5000.0]], np.float32)
        assert Sensor().expose(values, np.random.default_rng(1)).tolist() == [[0, 1023]]


class TestLoop:
    def test_the_end_joins_the_beginning(self) -> None:
        frames = Scene(320, 256).loop(10, 6.0).astype(np.float32)
        assert frames.shape == (10, 256, 320)
        steps = [
            float(np.abs(a - b).mean()) for a, b in zip(frames, np.roll(frames, -1, axis=0), strict=True)
        ]
        # The last step, back to the first frame, is one like the others.
        assert 0.9 * min(steps[:-1]) < steps[-1] < 1.1 * max(steps[:-1])

    def test_one_period_further_is_the_same(self, scene: Scene, mean: NDArray[np.float32]) -> None:
        np.testing.assert_allclose(scene.mean(3.0 + LOOP_M), mean, atol=0.05)
        assert float(np.abs(scene.mean(3.3) - mean).mean()) > 10


class TestTextures:
    def test_noise_repeats_along_the_rows(self) -> None:
        noise = octave(np.random.default_rng(1), (240, 50), (12, 12))
        within = np.abs(np.diff(noise, axis=0)).max()
        assert np.abs(noise[0] - noise[-1]).max() <= within
        assert noise.std() == pytest.approx(1, abs=1e-3)

    def test_stones_repeat_along_the_rows(self) -> None:
        number, shade = stones(np.random.default_rng(1), (200, 100), 6)
        same = (number[1:] == number[:-1]).mean()
        assert (number[0] == number[-1]).mean() == pytest.approx(same, abs=0.1)
        assert shade.mean() == pytest.approx(0, abs=1e-3)

    def test_a_far_view_shows_the_mean_and_a_near_one_the_texels(self) -> None:
        texture = np.random.default_rng(1).random((64, 32)).astype(np.float32)
        rip = RipMap(texture, (0,) * 7)
        row, column = (axis.astype(np.float32) for axis in np.indices((64, 32)))
        near = View(rip, row, column, np.ones((64, 1), np.float32))
        np.testing.assert_allclose(near.render(0), texture, atol=1e-4)
        np.testing.assert_allclose(near.render(5), np.roll(texture, -5, axis=0), atol=1e-4)
        far = View(rip, row, column, np.full((64, 1), 64, np.float32)).render(7)
        np.testing.assert_allclose(far, np.broadcast_to(texture.mean(axis=0), (64, 32)), atol=1e-4)
