"""What codecs are measured on: camera frames, contents made to hurt, medical and depth images."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from figures import ROOT
from numpy.typing import NDArray

from recorder.samples import Pixels
from recorder.simulation.scene import Scene
from recorder.simulation.sensor import Sensor

DATA = ROOT.parent / "shared" / "data"
WIDTH, HEIGHT, BITS = 1280, 1024, 10
TOP = (1 << BITS) - 1

STILLS = ("egopath.jpg", "zanderzt_385.jpg", "raildb_example_4k.jpg")
KITTI_STEP, VIDEO_STEP = 10, 60
"""Frames from one picture to the next: neighbours would say the same twice."""
DISPLAY_GAMMA = 2.2
DARK = np.float32(0.25)
"""Two stops less light."""


@dataclass(frozen=True, slots=True)
class Picture:
    """Pixels under a name of their own."""

    name: str
    pixels: Pixels
    bit_depth: int = BITS

    @property
    def packed_bytes(self) -> float:
        return self.pixels.size * self.bit_depth / 8


def rendered(count: int) -> list[Picture]:
    """Frames of the simulated line, one half of them by day and one in the dark."""
    scene = Scene(WIDTH, HEIGHT)
    black = np.float32(scene.sensor.black_level)
    pictures = []
    for number in range(count // 2):
        light = scene.mean(4.1 * number)
        for name, shade in (("day", np.float32(1)), ("dark", DARK)):
            noise = np.random.default_rng(number)
            pixels = scene.sensor.expose((light - black) * shade + black, noise)
            pictures.append(Picture(f"{name} {number}", pixels))
    return pictures


def photographs() -> list[Picture]:
    """Real photographs and video as the camera would have taken them; none without the shared data."""
    greys: dict[str, NDArray[Any] | None] = {name: _grey(DATA / "stills" / name) for name in STILLS}
    for path in sorted((DATA / "vo" / "kitti_seq1" / "image_l").glob("*.png"))[::KITTI_STEP]:
        greys[f"kitti {path.stem}"] = _grey(path)
    greys |= _video()
    found = {name: grey for name, grey in greys.items() if grey is not None}
    return [Picture(name, _exposed(grey, seed)) for seed, (name, grey) in enumerate(found.items())]


def _grey(path: Path) -> NDArray[Any] | None:
    return cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)


def _video() -> dict[str, NDArray[Any]]:
    video = cv2.VideoCapture(str(DATA / "cab-ride" / "cab-ride.mp4"))
    frames = {}
    number = 0
    while video.grab():
        if number % VIDEO_STEP == 0:
            frames[f"cab ride {number}"] = cv2.cvtColor(video.retrieve()[1], cv2.COLOR_BGR2GRAY)
        number += 1
    video.release()
    return frames


def _exposed(grey: NDArray[Any], seed: int) -> Pixels:
    """An 8-bit picture cut to the camera's shape, linear in light again, with the sensor's noise."""
    height, width = grey.shape
    rows, columns = min(height, width * HEIGHT // WIDTH), min(width, height * WIDTH // HEIGHT)
    y, x = (height - rows) // 2, (width - columns) // 2
    method = cv2.INTER_AREA if rows > HEIGHT else cv2.INTER_CUBIC
    linear = (grey[y : y + rows, x : x + columns] / np.float32(255)) ** np.float32(DISPLAY_GAMMA)
    sized = np.clip(cv2.resize(linear, (WIDTH, HEIGHT), interpolation=method), 0, 1)
    sensor = Sensor(BITS)
    light = np.float32(sensor.black_level) + sized * np.float32(TOP - sensor.black_level)
    return sensor.expose(light, np.random.default_rng(seed))


CONTENTS = (
    "noise",
    "checkerboard",
    "salt",
    "stripes",
    "rows",
    "zeros",
    "saturated",
    "ramps",
    "outside",
    "untrained",
)


def content(kind: str, count: int, height: int = HEIGHT, width: int = WIDTH) -> list[Picture]:
    """Different pictures of one of ``CONTENTS``; all their memory is real, zeros too."""
    y, x = np.mgrid[:height, :width].astype(np.int32)
    return [Picture(f"{kind} {seed}", _content(kind, seed, y, x)) for seed in range(count)]


def _content(kind: str, seed: int, y: NDArray[np.int32], x: NDArray[np.int32]) -> Pixels:
    rng = np.random.default_rng(seed)
    noise = rng.integers(0, TOP, y.shape, np.int32, endpoint=True)
    levels: NDArray[Any]
    match kind:
        case "noise":
            levels = noise
        case "checkerboard":
            levels = (x + y + seed) % 2 * TOP
        case "salt":
            levels = np.where(rng.random(y.shape) < 0.05, noise % 2 * TOP, TOP // 2)
        case "stripes":
            levels = (x + seed) % 2 * TOP
        case "rows":
            levels = (y + seed) % 2 * TOP
        case "zeros":
            levels = np.full(y.shape, 0)
        case "saturated":
            levels = np.full(y.shape, TOP)
        case "ramps":
            levels = (3 * x + 5 * y + seed) % (TOP + 1)
        case "outside":
            # every pixel beyond both its neighbours, by little or by much, so that no k suits
            steps = rng.choice([1, 120], y.shape[0] + y.shape[1])
            levels = np.cumsum(steps)[x + y] % (TOP + 1)
        case "untrained":
            # the rows that tables are trained on are flat, and all others noise: the worst tables there are
            levels = np.where(y % 32 == 16, TOP // 2, noise)
        case _:
            raise AssertionError(kind)
    return levels.astype(np.uint16)


def imaging() -> Iterator[Picture]:
    """Medical and depth images of more than 8 bits, in their own shapes and depths."""
    import pydicom  # noqa: PLC0415

    folder = DATA / "imaging"
    for path in sorted([*folder.rglob("*.pgm"), *folder.rglob("*.tif")]):
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if image is not None and image.dtype == np.uint16 and image.ndim == 2:
            yield _of_own_depth(path.name, image)
    for path in sorted((folder / "pydicom").glob("*.dcm")):
        scan = pydicom.dcmread(path)
        if scan.BitsAllocated == 16 and not scan.file_meta.TransferSyntaxUID.is_compressed:
            yield _of_own_depth(path.name, scan.pixel_array)


def _of_own_depth(name: str, pixels: NDArray[Any]) -> Picture:
    return Picture(name, pixels.astype(np.uint16), int(pixels.max()).bit_length())
