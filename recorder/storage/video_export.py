"""Frames as an FFV1 video: lossless, and read by every common player."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from recorder.errors import StorageError, UsageError
from recorder.storage.frames import Frames

DEFAULT_RATE_HZ = 25.0
"""For a single frame, which has no rate."""


def write_mkv(frames: Frames, out: Path, report: Callable[[int, int], None]) -> int:
    """Gray of 8 bits up to a depth of 8, else 16 bits with the values as they are.

    The video has one constant rate, the mean of the recording; the exact times are in the csv.
    Raises `UsageError` if the frames are not all of one size and depth, `StorageError` if the
    video cannot be written.
    """
    import cv2  # noqa: PLC0415 - only an export needs it

    first = frames[0]
    deep = first.bit_depth > 8
    rate_hz = _rate_hz(frames)
    parameters = [cv2.VIDEOWRITER_PROP_IS_COLOR, 0]
    if deep:
        parameters += [cv2.VIDEOWRITER_PROP_DEPTH, cv2.CV_16U]
    fourcc = cv2.VideoWriter.fourcc(*"FFV1")
    size = (first.width, first.height)
    if first.width % 2 or first.height % 2:  # OpenCV would crop the last row and column
        what = f"frames of {first.width}x{first.height} do not fit a video, whose sides are even"
        raise UsageError(what, where=str(out), todo="export as png or npy")
    target = out.with_name(f".{out.name}.{os.getpid()}.mkv")
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        video = cv2.VideoWriter(str(target), cv2.CAP_FFMPEG, fourcc, rate_hz, size, parameters)
        _write(video, frames, size, deep, out, report)
        _check_count(target, len(frames))
        target.replace(out)
    finally:
        cv2.utils.logging.setLogLevel(level)
        target.unlink(missing_ok=True)
    return len(frames)


def _write(
    video: Any,
    frames: Frames,
    size: tuple[int, int],
    deep: bool,
    out: Path,
    report: Callable[[int, int], None],
) -> None:
    try:
        if not video.isOpened():
            todo = "check that its folder exists and can be written, or export as png"
            raise StorageError("cannot be opened as an FFV1 video", where=str(out), todo=todo)
        for done, frame in enumerate(frames, 1):
            if (frame.width, frame.height, frame.bit_depth > 8) != (*size, deep):
                what = f"frame {frame.id} has another size or depth than the first"
                raise UsageError(what, where=str(out), todo="a video has one: export as png")
            pixels = frame.pixels
            video.write(pixels if deep else pixels.astype(np.uint8))
            report(done, len(frames))
    finally:
        video.release()


def _rate_hz(frames: Frames) -> float:
    span_ns = frames[-1].log_time_ns - frames[0].log_time_ns
    return (len(frames) - 1) * 1e9 / span_ns if span_ns > 0 else DEFAULT_RATE_HZ


def _check_count(video: Path, expected: int) -> None:
    """OpenCV does not say when a disk is full: count what can be read back."""
    import cv2  # noqa: PLC0415

    reader = cv2.VideoCapture(str(video), cv2.CAP_FFMPEG)
    try:
        count = 0
        while reader.grab():
            count += 1
    finally:
        reader.release()
    if count != expected:
        what = f"only {count} of {expected} frames are in the video"
        raise StorageError(what, where=str(video), todo="check the free space of the disk")
