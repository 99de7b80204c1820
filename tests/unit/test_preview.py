"""Previews: size, brightness, shape."""

import cv2
import numpy as np
import pytest

from recorder.realtime.preview import preview
from recorder.samples import Frame, Stamp


@pytest.mark.parametrize("bit_depth", [1, 8, 10, 12, 16])
def test_full_scale_is_white_and_zero_is_black(bit_depth: int) -> None:
    pixels = np.zeros((64, 128), np.uint16)
    pixels[:, 64:] = (1 << bit_depth) - 1
    made = preview(Frame("front", 0, Stamp(raw_ns=5), pixels, bit_depth), max_width=1000, quality=90)
    shown = cv2.imdecode(np.frombuffer(made.jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert shown is not None
    assert shown.shape == (64, 128)
    assert shown[32, 20] <= 4
    assert shown[32, 100] >= ((1 << min(bit_depth, 8)) - 1 << max(0, 8 - bit_depth)) - 8
    assert made.stamp.raw_ns == 5


def test_a_wide_frame_is_made_smaller() -> None:
    made = preview(
        Frame("front", 0, Stamp(), np.zeros((1024, 1280), np.uint16), 10), max_width=640, quality=80
    )
    shown = cv2.imdecode(np.frombuffer(made.jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert shown is not None
    assert shown.shape == (512, 640)
