"""A NumPy file that holds a stack of images: (N, H, W), uint8 or uint16."""

import math
from collections.abc import Iterator, Mapping
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.lib import format as npy

from recorder.drivers.image_source import DepthRule, Grey, MissingImages, SourceImage, readable
from recorder.errors import SourceError

SIDE_MAX = 65535
"""Rows and columns that an image may have."""


class ImageStack:
    """Read image by image, so that a stack may be larger than memory and may end early.

    Raises `SourceError` if the file is no such stack.
    """

    rate: Fraction | None = None

    def __init__(self, path: Path) -> None:
        readable(path)
        self._file = path.open("rb")
        try:
            readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
            shape, fortran, dtype = readers[npy.read_magic(self._file)](self._file)
        except Exception:  # NumPy's parser of headers raises what Python's own tokenizer does
            self._file.close()
            raise SourceError("not a NumPy file", where=str(path), todo="write it with numpy.save") from None
        sound = len(shape) == 3 and min(shape) > 0 and max(shape[1:]) <= SIDE_MAX and not fortran
        if not sound or dtype.kind != "u" or dtype.itemsize not in (1, 2):
            self._file.close()
            what = f"an array of {dtype} {shape}{' in Fortran order' if fortran else ''}"
            raise SourceError(
                what, where=str(path), todo="it needs uint8 or uint16 of shape (N, H, W), sides up to 65535"
            )
        self._dtype, self._shape = dtype, (shape[1], shape[2])
        self.count: int | None = shape[0]

    def images(self) -> Iterator[SourceImage | MissingImages]:
        rule = DepthRule()
        size = math.prod(self._shape) * self._dtype.itemsize
        for index in range(self.count or 0):
            data = self._file.read(size)
            if len(data) < size:
                yield MissingImages(index, (self.count or 0) - 1, "file ends early")
                return
            image = np.frombuffer(data, self._dtype).reshape(self._shape)
            native: Grey = image.astype(np.uint8) if self._dtype.itemsize == 1 else image.astype(np.uint16)
            yield SourceImage(index, native.astype(np.uint16), rule.depth(native))

    def describe(self) -> Mapping[str, str]:
        height, width = self._shape
        return {"kind": "image stack", "codec": str(self._dtype), "size": f"{width}x{height}"}

    def close(self) -> None:
        self._file.close()
