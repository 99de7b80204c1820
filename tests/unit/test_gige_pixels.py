"""The camera twin's pixels: packed as GenICam says, and computable from their number."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from recorder.errors import SourceError
from recorder.simulation.gige_pixels import (
    BIT_DEPTHS,
    Pattern,
    Stack,
    pack,
    packed_bytes,
    pattern,
    pattern_number,
)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 8, 13])
def test_mono10p_is_one_run_of_bits_lowest_first(count: int) -> None:
    pixels = (np.arange(count, dtype=np.uint16) * 341 + 7) % 1024
    bits = sum(int(value) << 10 * index for index, value in enumerate(pixels))
    assert pack(pixels, "Mono10p").tobytes() == bits.to_bytes(-(-10 * count // 8), "little")


@pytest.mark.parametrize("name", BIT_DEPTHS)
@pytest.mark.parametrize("width", [16, 18, 5])
def test_pattern_source_fills_what_the_pattern_says(name: str, width: int) -> None:
    out = np.empty(packed_bytes(width * 6, name), np.uint8)
    for number in (0, 1, 5, 6, 300, 70000):
        Pattern().fill(out, number, name, width, 6)
        image = pattern(number, width, 6, BIT_DEPTHS[name])
        assert out.tobytes() == pack(image, name).tobytes()
        assert pattern_number(image) == number
        assert int(image.max()) < 1 << BIT_DEPTHS[name]


def test_stack_plays_in_a_loop_and_is_cropped(tmp_path: Path) -> None:
    frames = np.arange(3 * 4 * 8, dtype=np.uint16).reshape(3, 4, 8)
    np.save(tmp_path / "frames.npy", frames)
    stack = Stack(tmp_path / "frames.npy")
    assert (stack.width, stack.height, stack.bit_depth) == (8, 4, 7)
    for name in ("Mono16", "Mono10p", "Mono10p"):
        out = np.empty(packed_bytes(2 * 8, name), np.uint8)
        stack.fill(out, 4, name, 8, 2)
        assert out.tobytes() == pack(frames[1, :2], name).tobytes()


def test_stack_of_a_folder_is_in_the_order_of_names(tmp_path: Path) -> None:
    for number in (2, 0, 1):
        cv2.imwrite(str(tmp_path / f"{number:03}.png"), np.full((4, 8), 1000 + number, np.uint16))
    stack = Stack(tmp_path)
    assert [int(frame[0, 0]) for frame in stack.frames] == [1000, 1001, 1002]
    assert [name for name in BIT_DEPTHS if stack.fits(name)] == ["Mono10", "Mono10p", "Mono12", "Mono16"]


def test_what_is_no_stack_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "flat.npy", np.zeros((4, 8), np.uint16))
    (tmp_path / "empty").mkdir()
    for name in ("flat.npy", "empty", "absent.npy"):
        with pytest.raises(SourceError):
            Stack(tmp_path / name)
