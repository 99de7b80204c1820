"""Small pictures for people: what the fitter's page and Foxglove show."""

import cv2
import numpy as np

from recorder.samples import Frame, Preview


def preview(frame: Frame, *, max_width: int, quality: int) -> Preview:
    """A JPEG of the frame's upper eight bits, at most ``max_width`` columns wide."""
    height, width = frame.pixels.shape
    scale = min(1.0, max_width / width)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    small = frame.pixels if scale == 1.0 else cv2.resize(frame.pixels, size, interpolation=cv2.INTER_AREA)
    shown = np.ldexp(small.astype(np.float32), 8 - frame.bit_depth).astype(np.uint8)
    _, jpeg = cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return Preview(camera=frame.camera, stamp=frame.stamp, jpeg=jpeg.tobytes())
