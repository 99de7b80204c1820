"""A video file, frame by frame, exactly as ``cv2.VideoCapture`` decodes it."""

import os
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from statistics import median_low
from typing import Any

import cv2
import numpy as np

from recorder.drivers.container_end import container_end
from recorder.drivers.image_source import MissingImages, SourceImage, readable, to_grey
from recorder.errors import SourceError

REORDER_FRAMES = 17
"""H.264 and H.265 decode at most 16 frames ahead of the one they show: no gap that a cut leaves
lies further from the end than that."""

_OPTIONS = "OPENCV_FFMPEG_CAPTURE_OPTIONS"
_LOG_LEVEL = "OPENCV_FFMPEG_LOGLEVEL"


class VideoFile:
    """Raises `SourceError` if the file cannot be opened as a video."""

    def __init__(self, path: Path) -> None:
        readable(path)
        if _is_text(path):
            # FFmpeg would show a text file as "ANSI art", 640x400, at 25 frames a second.
            raise SourceError("a text file, not a video", where=str(path), todo="give a video file")
        self._path = path
        with _quiet_ffmpeg():
            # An absolute path cannot be taken for a URL or a device.
            self._capture: Any = cv2.VideoCapture(str(path.absolute()), cv2.CAP_FFMPEG)
        if not self._capture.isOpened() or self._capture.get(cv2.CAP_PROP_FRAME_WIDTH) <= 0:
            self._capture.release()
            raise SourceError(
                _why_not(path), where=str(path), todo="fetch it again or convert it with ffmpeg"
            )
        end = container_end(path)
        if not end.known:
            self._capture.release()
            what = "a video in a container that does not say where it ends"
            raise SourceError(what, where=str(path), todo="put it into mp4, mov, mkv or avi with ffmpeg")
        self._cut = end.missing_bytes > 0
        # Without an index that counts, this is OpenCV's guess from duration and rate.
        announced = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        self.count: int | None = announced if end.counts_frames and announced > 0 else None
        self._guessed = max(0, announced)
        fps = float(self._capture.get(cv2.CAP_PROP_FPS))
        self.rate: Fraction | None = Fraction(fps).limit_denominator(1_000_000) if 0 < fps < 1e6 else None

    def images(self) -> Iterator[SourceImage | MissingImages]:
        """All frames that decode whole, then what is missing.

        A cut leaves frames out in decoding order, so the last few of a stream with bidirectional
        frames have gaps between them; these are numbered by their times.
        """
        held: deque[SourceImage] = deque()
        times: deque[int] = deque(maxlen=256)
        index = 0
        while True:
            good, picture = self._capture.read()
            if not good:
                break
            grey = to_grey(picture).astype(np.uint16)
            # OpenCV tells presentation time as a double of milliseconds; it is an integer again
            # here, exact to the nanosecond for any video under a hundred days.
            media_ns = round(self._capture.get(cv2.CAP_PROP_POS_MSEC) * 1_000_000)
            held.append(SourceImage(index, grey, 8, media_ns))
            times.append(media_ns)
            index += 1
            if len(held) > (REORDER_FRAMES if self._cut else 0):
                yield held.popleft()
        yield from self._tail(held, index, _period_ns(times))

    def _tail(
        self, held: deque[SourceImage], decoded: int, period_ns: int
    ) -> Iterator[SourceImage | MissingImages]:
        if self._cut and self.count is None:
            # of a cut file that tells no number, the gaps and one frame at least are missing; its
            # length, which OpenCV gives as frames at a rate that may be wrong, says how many
            least = decoded + 1 + sum(_gap(a, b, period_ns) for a, b in pairwise(held))
            length = self._guessed / self.rate if self.rate else Fraction(0)
            expected = max(least, round(length * 1_000_000_000 / period_ns) if period_ns else 0)
        else:
            expected = self.count or 0
        reason = "file ends early" if self._cut else "frames that the container announces do not decode"
        missing = max(0, expected - decoded)
        index = held[0].index if held else decoded
        before: SourceImage | None = None
        for image in held:
            gap = min(missing, _gap(before, image, period_ns)) if before else 0
            if gap > 0:
                yield MissingImages(index, index + gap - 1, reason)
                missing -= gap
                index += gap
            yield SourceImage(index, image.pixels, image.bit_depth, image.media_ns)
            before = image
            index += 1
        if missing:
            yield MissingImages(index, index + missing - 1, reason)

    def describe(self) -> Mapping[str, str]:
        code = int(self._capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
        letters = code.to_bytes(4, "little").decode("ascii", "replace").strip("\0 ")
        width, height = (
            int(self._capture.get(key)) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        )
        return {"kind": "video file", "codec": letters, "size": f"{width}x{height}"}

    def close(self) -> None:
        self._capture.release()


def _period_ns(times: Sequence[int]) -> int:
    """The usual time from one frame to the next, by the frames themselves: what OpenCV gives as the
    rate of a Matroska file can be twice that. 0 if it cannot be told."""
    steps = [after - before for before, after in pairwise(times) if after > before]
    return median_low(steps) if steps else 0


def _gap(before: SourceImage, after: SourceImage, period_ns: int) -> int:
    """Frames missing between two."""
    if not period_ns or before.media_ns is None or after.media_ns is None:
        return 0
    return max(0, (after.media_ns - before.media_ns + period_ns // 2) // period_ns - 1)


@contextmanager
def _quiet_ffmpeg() -> Iterator[None]:
    """OpenCV reads these when a capture opens (the log level once a process); nothing stays behind.

    ``discardcorrupt`` drops a packet that the end of the file cuts; a decoder would conceal the
    missing part and pass the frame as good. Frames of an intact file are the same with and without.
    """
    values = {_OPTIONS: "fflags;discardcorrupt", _LOG_LEVEL: "-8"}
    before = {key: os.environ.get(key) for key in values}
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    os.environ.update(values)
    try:
        yield
    finally:
        for key, value in before.items():
            if value is None:
                os.environ.pop(key, None)
            else:
                os.environ[key] = value
        cv2.utils.logging.setLogLevel(level)


def _is_text(path: Path) -> bool:
    with path.open("rb") as file:
        head = file.read(4096)
    return bool(head) and all(byte in b"\t\n\r\f\x1b" or 32 <= byte < 127 for byte in head)


def _why_not(path: Path) -> str:
    if path.stat().st_size == 0:
        return "an empty file, not a video"
    if container_end(path).missing_bytes:
        return "a video that ends before its index (cut off), cannot be opened"
    return "not a video that can be decoded"
