"""Grey images in PNG, TIFF, PGM and NPY files, value for value."""

import re
import struct
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from tokenize import TokenError
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from recorder.drivers.image_source import Grey, readable
from recorder.errors import StorageError, UsageError

SUFFIXES = {".png": "png", ".tif": "tiff", ".tiff": "tiff", ".pgm": "pgm", ".npy": "npy"}
"""Of the formats."""

_PGM = re.compile(rb"P([25])" + 3 * rb"(?:\s|#[^\n]*\n)+?([0-9]{1,9})" + rb"\s")
_TYPES = "8 or 16 bits without sign are needed"
_GREY = "convert it to grey (convert IN -colorspace Gray OUT.png), or encode each channel alone"


class Picture(NamedTuple):
    """One image of a file."""

    pixels: Grey
    """(H, W)."""
    maxval: int | None = None
    """The largest value that a PGM may have; other formats do not say."""


def read_pictures(path: Path, where: str) -> Iterator[Picture]:
    """The images of a file called ``where``: one, the pages of a TIFF, or those of an (N, H, W) array.

    Raises `UsageError` for anything but grey of 8 or 16 bits, and for what cannot be read whole.
    """
    try:
        yield from _pictures(path, where)
    except OSError as error:
        what = f"cannot be read ({error.strerror or error})"
        raise UsageError(what, where=where, todo="check the path") from error


def _pictures(path: Path, where: str) -> Iterator[Picture]:
    if path.exists() and not path.is_file():
        todo = "name its images, such as FOLDER/*.png" if path.is_dir() else "give a file, or - for a pipe"
        raise UsageError("not a file", where=where, todo=todo)
    readable(path)
    with path.open("rb") as file:
        start = file.read(8)
    if start.startswith(b"\x93NUMPY"):
        yield from (Picture(pixels) for pixels in _array(path, where))
    elif re.match(rb"P[25]\s", start):
        yield _pgm(path, where)
    elif re.match(rb"P[36]\s", start):
        raise UsageError("a colour image of 3 channels", where=where, todo=_GREY)
    elif start.startswith((b"\x89PNG", b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")):
        yield from (Picture(pixels) for pixels in _opencv(path, where))
    else:
        raise UsageError("not an image in PNG, TIFF, PGM or NPY", where=where, todo="convert it first")


def picture_bytes(pixels: NDArray[np.uint16], bit_depth: int, format: str) -> bytes:
    """A file of one image: 8 bits up to a depth of 8, else 16; a PGM's maxval is that of the depth."""
    image = pixels.astype(np.uint8) if bit_depth <= 8 else pixels
    if format == "pgm":
        height, width = image.shape
        head = f"P5\n{width} {height}\n{(1 << bit_depth) - 1}\n".encode()
        return head + image.astype(image.dtype.newbyteorder(">")).tobytes()
    done, data = cv2.imencode(f".{format}", image)
    if not done:
        raise StorageError(f"cannot be written as {format}", todo="choose another format")
    return data.tobytes()


def array_head(count: int, shape: tuple[int, ...], bit_depth: int) -> bytes:
    """What an .npy file of ``count`` images begins with: (H, W) for one, else (N, H, W).

    uint8 up to a depth of 8, else uint16.
    """
    head = BytesIO()
    whole = shape if count == 1 else (count, *shape)
    descr = "|u1" if bit_depth <= 8 else "<u2"
    np.lib.format.write_array_header_1_0(head, {"descr": descr, "fortran_order": False, "shape": whole})
    return head.getvalue()


def array_item(pixels: NDArray[np.uint16], bit_depth: int) -> bytes:
    """One image of an .npy file."""
    return pixels.astype("u1" if bit_depth <= 8 else "<u2").tobytes()


def _array(path: Path, where: str) -> Iterator[Grey]:
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, EOFError, SyntaxError, OverflowError, TypeError, TokenError) as error:
        raise UsageError(
            f"not a sound NPY file ({error})", where=where, todo="write it with numpy.save"
        ) from None
    shape = "x".join(map(str, array.shape))
    if array.dtype.kind != "u" or array.dtype.itemsize > 2:
        raise UsageError(f"an array of {array.dtype}", where=where, todo=_TYPES)
    if array.ndim not in (2, 3):
        raise UsageError(
            f"an array of shape {shape}", where=where, todo="(H, W) or a stack (N, H, W) is needed"
        )
    if not array.size:
        raise UsageError(f"an array of shape {shape}", where=where, todo="it holds no pixel")
    if array.ndim == 3 and array.shape[2] <= 4:
        raise UsageError(f"an array of shape {shape}, as colour has it", where=where, todo=_GREY)
    native = np.dtype(f"u{array.dtype.itemsize}")
    for image in array if array.ndim == 3 else [array]:
        yield np.ascontiguousarray(image, native)


def _pgm(path: Path, where: str) -> Picture:
    data = path.read_bytes()
    head = _PGM.match(data)
    if head is None:
        raise UsageError("not a sound PGM file", where=where, todo="write it again")
    width, height, maxval = (int(number) for number in head.groups()[1:])
    if not 1 <= maxval <= 65535:
        raise UsageError(f"a PGM of maxval {maxval}", where=where, todo="1 to 65535 is needed")
    count = width * height
    if not count:
        raise UsageError(f"a PGM of {width} x {height}", where=where, todo="it holds no pixel")
    if head[1] == b"5":
        stored = np.dtype(np.uint8) if maxval < 256 else np.dtype(">u2")
        values: NDArray[Any] = np.frombuffer(
            data[head.end() : head.end() + count * stored.itemsize], np.uint8
        )
        values = values[: values.size // stored.itemsize * stored.itemsize].view(stored)
        rest = data[head.end() + count * stored.itemsize :].split()
    else:
        numbers = data[head.end() :].split()
        numbers, rest = numbers[:count], numbers[count:]
        values = np.array([_value(number) for number in numbers], np.int64)
    if values.size < count or values.max() > maxval:
        what = (
            "a PGM that ends early" if values.size < count else f"a PGM with values above its maxval {maxval}"
        )
        raise UsageError(what, where=where, todo="fetch or write it again")
    if rest:
        raise UsageError("a PGM with more behind its image", where=where, todo="give each image as a file")
    image: Grey = values.astype(np.uint8) if maxval < 256 else values.astype(np.uint16)
    return Picture(image.reshape(height, width), maxval)


def _value(number: bytes) -> int:
    """Of an ASCII PGM; what is no number, or a long one, is above every maxval."""
    return int(number) if number.isdigit() and len(number) < 10 else 65536


def _opencv(path: Path, where: str) -> Iterator[Grey]:
    data = path.read_bytes()
    depths = _stored_depths(data)
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    images: Sequence[NDArray[Any]] = ()
    try:
        _, images = cv2.imdecodemulti(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        pass  # then there are none
    finally:
        cv2.utils.logging.setLogLevel(level)
    if not images:
        raise UsageError("damaged, or of a kind that OpenCV cannot read", where=where, todo="write it again")
    if len(images) < len(depths):
        what = f"only {len(images)} of {len(depths)} pages can be read"
        raise UsageError(what, where=where, todo="fetch or write it again")
    if odd := {depth for depth in depths if depth not in (8, 16, 32, 64)}:  # OpenCV stretches their values
        raise UsageError(f"an image of {min(odd)} bits", where=where, todo=_TYPES)
    for image in images:
        if image.ndim != 2:
            raise UsageError(f"a colour image of {image.shape[2]} channels", where=where, todo=_GREY)
        if image.dtype not in (np.uint8, np.uint16):
            raise UsageError(f"an image of {image.dtype}", where=where, todo=_TYPES)
        yield image


def _stored_depths(data: bytes) -> list[int]:
    """Bits of a sample in each page of the file, of which OpenCV does not tell; 8 where a page does not."""
    if data.startswith(b"\x89PNG"):
        return list(data[24:25])  # of the IHDR
    order, big = "<" if data.startswith(b"II") else ">", 43 in data[2:4]
    word, count, entry = (order + code for code in (("Q", "Q", "HHQ") if big else ("L", "H", "HHL")))
    entry_size = struct.calcsize(entry) + struct.calcsize(word)
    depths: dict[int, int] = {}
    try:
        (page,) = struct.unpack_from(word, data, 8 if big else 4)
        while page and page not in depths:
            depths[page] = 8
            (entries,) = struct.unpack_from(count, data, page)
            first = page + struct.calcsize(count)
            last = first + entries * entry_size
            for place in range(first, last, entry_size):
                if struct.unpack_from(entry, data, place) == (258, 3, 1):  # BitsPerSample, one short
                    (depths[page],) = struct.unpack_from(order + "H", data, place + struct.calcsize(entry))
            (page,) = struct.unpack_from(word, data, last)
    except (struct.error, OverflowError):
        pass  # the file ends here
    return list(depths.values())
