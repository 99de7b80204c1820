"""What stands behind a file camera: something that hands out images in order, and says which it cannot.

``VideoFile``, ``ImageFolder`` and ``ImageStack`` are the three kinds.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from recorder.errors import SourceError
from recorder.samples import Pixels

Grey = NDArray[np.uint8] | NDArray[np.uint16]
"""H x W, as deep as the file has it."""

DEEP = (10, 12, 14, 16)
"""Bit depths that a 16-bit image may be said to have: those that cameras have."""


@dataclass(frozen=True, slots=True, eq=False)
class SourceImage:
    """One image as the file holds it."""

    index: int
    pixels: Pixels
    bit_depth: int
    media_ns: int | None = None
    """When it is shown according to the file, from the file's start; None if the file does not say."""


@dataclass(frozen=True, slots=True)
class MissingImages:
    """Images that the file should hold and that cannot be read."""

    first: int
    last: int
    """Both inclusive."""
    reason: str


class ImageSource(Protocol):
    """An open file, folder or stack of images."""

    count: int | None
    """How many images it holds according to itself; None if it does not say for certain."""
    rate: Fraction | None
    """Images a second according to itself."""

    def images(self) -> Iterator[SourceImage | MissingImages]:
        """Each index once, in order."""

    def describe(self) -> Mapping[str, str]:
        """Kind, size, codec and the like."""

    def close(self) -> None:
        """Let go of the file; safe twice."""


def to_grey(image: Any) -> Grey:
    """One channel: grey stays as it is, colour (in OpenCV's order) becomes COLOR_BGR2GRAY."""
    grey: Grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return grey


class DepthRule:
    """Which bit depth an image has.

    Eight-bit images have 8. For 16-bit ones no file says how many bits the camera had: the first
    image sets the smallest of 10, 12, 14, 16 that holds its largest value, and the rest of the
    stream has the same; a later image that exceeds it gets the larger depth it needs, alone.
    """

    def __init__(self) -> None:
        self._stream: int | None = None

    def depth(self, image: Grey) -> int:
        if image.dtype == np.uint8:
            return 8
        needed = next(depth for depth in DEEP if int(image.max(initial=0)) < 1 << depth)
        self._stream = self._stream or needed
        return max(self._stream, needed)


def readable(path: Path) -> None:
    """Raise `SourceError` unless the file can be opened for reading."""
    try:
        with path.open("rb"):
            pass
    except FileNotFoundError:
        raise SourceError("no such file or folder", where=str(path), todo="check the path") from None
    except PermissionError:
        raise SourceError("no permission to read it", where=str(path), todo="make it readable") from None
    except OSError as error:
        raise SourceError(f"cannot be read ({error.strerror})", where=str(path)) from error
