"""FELICS images, lossless: Howard and Vitter 1993 in the bitstream of docs/felics.md."""

from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from recorder import kernels
from recorder.codec.stream import Buffer
from recorder.errors import CodecError

Model = Literal["raw", "felics"]
KChoice = int | Literal["context", "trained"]

_MODELS: Final[tuple[Model, ...]] = get_args(Model)
_CONTEXTS: Final = 17


@dataclass(frozen=True, slots=True)
class FelicsHeader:
    """What an image says of itself."""

    version: int
    model: Model
    bit_depth: int
    xor: int
    """What every byte of the payload was XORed with."""
    width: int
    height: int
    checksum: int
    """CRC-32C of the pixels as little-endian uint16 in row order."""
    k: tuple[int, ...]
    """The Golomb-Rice parameter of each context; empty for the model raw."""
    stream_lengths: tuple[int, ...]
    """Bytes, before stuffing."""


def encode(
    image: NDArray[Any], *, bit_depth: int = 10, model: Model = "felics", k: KChoice = "trained"
) -> bytes:
    """One complete image, ``FF E8 … FF E9``.

    Args:
        image: (H, W) pixels, uint8 or uint16, right-aligned.
        bit_depth: bits per pixel, 1 to 16.
        model: "felics", which falls back to "raw" by itself where that is smaller, or "raw".
        k: the Golomb-Rice parameter: an int for all contexts, "context" for a fixed one per context,
            "trained" for the best per context on every 32nd row of this image. The first two are faster.

    Raises:
        ValueError: another shape or type, a pixel above the bit depth, or an argument out of range.
    """
    return kernels.felics_encode(_checked(image), bit_depth, _model_id(model), _table(k, bit_depth))


def encode_into(
    image: NDArray[Any],
    out: NDArray[np.uint8],
    *,
    bit_depth: int = 10,
    model: Model = "felics",
    k: KChoice = "trained",
) -> int:
    """``encode`` into the caller's contiguous 1-D array of at least ``max_encoded_size`` bytes.

    Returns the bytes written. Raises what ``encode`` raises, and ValueError for an unfit ``out``.
    """
    if out.dtype != np.uint8 or out.ndim != 1 or not out.flags.c_contiguous or not out.flags.writeable:
        raise ValueError("the output must be a writable contiguous 1-D array of uint8")
    return kernels.felics_encode_into(_checked(image), out, bit_depth, _model_id(model), _table(k, bit_depth))


def max_encoded_size(width: int, height: int, bit_depth: int = 10) -> int:
    """The most bytes that any image of this shape takes: its packed size, 0.8 % and a header."""
    _check_depth(bit_depth)
    return kernels.felics_largest_encoding(width, height, bit_depth)


def decode(data: Buffer) -> NDArray[np.uint16]:
    """The (H, W) pixels of one complete image.

    Raises:
        CodecError: anything malformed, with the byte at which it was noticed; the pixels of an image
            that decodes are those that were encoded, up to a CRC-32C collision.
    """
    try:
        pixels = np.empty(kernels.felics_shape(data), np.uint16)
        kernels.felics_decode_into(data, pixels)
    except kernels.FormatError as fault:
        raise _codec_error(fault) from None
    return pixels


def read_header(data: Buffer) -> FelicsHeader:
    """The header of the image that begins at the start of ``data``; what stands behind it is not looked at.

    Raises:
        CodecError: no start marker, a header cut short, or one that is wrong by its own checksum or content.
    """
    try:
        version, model, depth, xor, width, height, checksum, table, lengths = kernels.felics_header(data)
    except kernels.FormatError as fault:
        raise _codec_error(fault) from None
    return FelicsHeader(version, _MODELS[model], depth, xor, width, height, checksum, tuple(table), lengths)


def _codec_error(fault: kernels.FormatError) -> CodecError:
    what, offset = fault.args
    return CodecError(what, offset=offset)


def _checked(image: NDArray[Any]) -> NDArray[Any]:
    if image.ndim != 2 or image.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"an image is 2-D, uint8 or uint16, not {image.ndim}-D {image.dtype}")
    return np.ascontiguousarray(image)


def _check_depth(bit_depth: int) -> None:
    if not 1 <= bit_depth <= 16:
        raise ValueError(f"a bit depth is 1 to 16, not {bit_depth}")


def _model_id(model: str) -> int:
    if model not in _MODELS:
        raise ValueError(f"unknown model {model!r}; known are {', '.join(_MODELS)}")
    return _MODELS.index(model)


def _table(k: KChoice, bit_depth: int) -> bytes:
    """The k of each context; empty where the kernel is to train it."""
    _check_depth(bit_depth)
    if k == "trained":
        return b""
    if k == "context":
        return kernels.felics_usual_table(bit_depth)
    if isinstance(k, str) or not 0 <= k <= min(15, bit_depth):
        raise ValueError(f"k is 'context', 'trained' or 0 to {min(15, bit_depth)}, not {k!r}")
    return bytes([k]) * _CONTEXTS
