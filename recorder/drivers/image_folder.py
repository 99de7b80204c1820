"""A folder of single images, in the order of the numbers in their names."""

import re
from collections.abc import Iterator, Mapping
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np

from recorder.drivers.image_source import DepthRule, Grey, MissingImages, SourceImage, to_grey
from recorder.errors import SourceError

SUFFIXES = (".png", ".tif", ".tiff", ".pgm", ".bmp", ".jpg", ".jpeg")


class ImageFolder:
    """The images of ``path``, or the one image that ``path`` is.

    Raises `SourceError` if there is none or the folder cannot be read.
    """

    rate: Fraction | None = None

    def __init__(self, path: Path) -> None:
        try:
            found = list(path.iterdir()) if path.is_dir() else [path]
        except PermissionError:
            raise SourceError("no permission to read it", where=str(path), todo="make it readable") from None
        files = [file for file in found if file.suffix.lower() in SUFFIXES and not file.name.startswith(".")]
        self._files = sorted(files, key=natural_key)
        if not self._files:
            raise SourceError(
                "no image in this folder", where=str(path), todo=f"it needs files {', '.join(SUFFIXES)}"
            )
        self.count: int | None = len(self._files)

    def images(self) -> Iterator[SourceImage | MissingImages]:
        rule = DepthRule()
        for index, file in enumerate(self._files):
            image = _read(file)
            if isinstance(image, str):
                yield MissingImages(index, index, f"{file.name}: {image}")
                continue
            yield SourceImage(index, image.astype(np.uint16), rule.depth(image))

    def describe(self) -> Mapping[str, str]:
        return {"kind": "image folder", "codec": self._files[0].suffix.lower().lstrip(".")}

    def close(self) -> None:
        """Nothing stays open between two images."""


def natural_key(path: Path) -> tuple[list[str | int], str]:
    """Sorts ``frame_9`` before ``frame_10``: runs of digits compare as numbers."""
    parts = re.split(r"([0-9]+)", path.name)
    return [int(part) if position % 2 else part for position, part in enumerate(parts)], path.name


def _read(file: Path) -> Grey | str:
    """The image in grey, or why there is none."""
    try:
        data = np.frombuffer(file.read_bytes(), np.uint8)
    except OSError as error:
        return f"cannot be read ({error.strerror})"
    if not data.size:
        return "an empty file"
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        image = cv2.imdecode(data, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
    except cv2.error:
        image = None
    finally:
        cv2.utils.logging.setLogLevel(level)
    if image is None:
        return "damaged or not an image"
    if image.dtype not in (np.uint8, np.uint16):
        return f"{image.dtype} pixels, only 8- and 16-bit integers can be recorded"
    return to_grey(image)
