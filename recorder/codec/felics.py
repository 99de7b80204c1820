"""FELICS images, lossless: Howard and Vitter 1993 in the bitstream of docs/felics.md."""

from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from recorder import kernels
from recorder.codec.stream import Buffer
from recorder.errors import CodecError

Model = Literal["raw", "felics", "felics-ls"]
KChoice = int | Literal["context", "trained"]

_MODELS: Final[tuple[Model, ...]] = get_args(Model)
_CONTEXTS: Final = 17
_DEEPEST_LS: Final = 12
"""Bits that felics-ls can code."""


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
    tables: bytes
    """The model's whole table, as `encode` takes it."""
    stream_lengths: tuple[int, ...]
    """Bytes, before stuffing."""


def encode(
    image: NDArray[Any],
    *,
    bit_depth: int = 10,
    model: Model = "felics-ls",
    k: KChoice = "trained",
    tables: bytes | None = None,
    threads: int = 1,
) -> bytes:
    """One complete image, ``FF E8 … FF E9``.

    Args:
        image: (H, W) pixels, uint8 or uint16, right-aligned.
        bit_depth: bits per pixel, 1 to 16.
        model: "felics-ls" (the smallest), "felics" (the fastest), both of which fall back to "raw" by
            themselves where that is smaller, or "raw". Above 12 bits felics-ls does not exist: such an
            image gets felics (`model_at`).
        k: the Golomb-Rice parameter of the model felics: an int for all contexts, "context" for a fixed one
            per context, "trained" for the best per context on every 32nd row of this image. The other
            models do not look at it.
        tables: what ``train`` returned for this or a similar image and the same model and depth, instead of
            training. An image carries its tables, so each can be decoded alone.
        threads: so many share the rows, 1 to 32, where one image's delay matters more than the work that
            all take together. The bytes are the same.

    Raises:
        ValueError: another shape or type, a pixel above the bit depth, or an argument out of range.
    """
    model = model_at(bit_depth, model)
    table = _table(model, k, tables, bit_depth)
    return kernels.felics_encode(_checked(image), bit_depth, _MODELS.index(model), table, threads)


def encode_into(
    image: NDArray[Any],
    out: NDArray[np.uint8],
    *,
    bit_depth: int = 10,
    model: Model = "felics-ls",
    k: KChoice = "trained",
    tables: bytes | None = None,
    threads: int = 1,
) -> int:
    """``encode`` into the caller's contiguous 1-D array of at least ``max_encoded_size`` bytes.

    Returns the bytes written. Raises what ``encode`` raises, and ValueError for an unfit ``out``.
    """
    if out.dtype != np.uint8 or out.ndim != 1 or not out.flags.c_contiguous or not out.flags.writeable:
        raise ValueError("the output must be a writable contiguous 1-D array of uint8")
    model = model_at(bit_depth, model)
    table = _table(model, k, tables, bit_depth)
    return kernels.felics_encode_into(_checked(image), out, bit_depth, _MODELS.index(model), table, threads)


def train(image: NDArray[Any], *, bit_depth: int = 10, model: Model = "felics-ls") -> bytes:
    """The tables that suit every 32nd row of this image, for ``encode``.

    About once a second is enough for a camera. Raises ValueError as ``encode`` does.
    """
    model = model_at(bit_depth, model)
    return kernels.felics_train(_checked(image), bit_depth, _MODELS.index(model))


def model_at(bit_depth: int, model: Model) -> Model:
    """The model that an image of this depth gets for ``model``: felics for felics-ls above 12 bits.

    Raises ValueError for an unknown model or a depth out of range.
    """
    _check_depth(bit_depth)
    if model not in _MODELS:
        raise ValueError(f"unknown model {model!r}; known are {', '.join(_MODELS)}")
    return "felics" if model == "felics-ls" and bit_depth > _DEEPEST_LS else model


def max_encoded_size(width: int, height: int, bit_depth: int = 10) -> int:
    """The most bytes that any image of this shape takes: its packed size, 0.8 % and a header.

    Raises ValueError where there is no such image.
    """
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
    name = _MODELS[model]
    ks = tuple(byte >> 4 for byte in table[:64]) if name == "felics-ls" else tuple(table)
    return FelicsHeader(version, name, depth, xor, width, height, checksum, ks, table, lengths)


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


def _table(model: Model, k: KChoice, tables: bytes | None, bit_depth: int) -> bytes:
    """The model's table; empty where the kernel is to train it."""
    if tables is not None:
        return tables
    if k == "trained":
        return b""
    if k != "context" and (isinstance(k, str) or not 0 <= k <= min(15, bit_depth)):
        raise ValueError(f"k is 'context', 'trained' or 0 to {min(15, bit_depth)}, not {k!r}")
    if model != "felics":
        return b""
    return kernels.felics_usual_table(bit_depth) if k == "context" else bytes([k]) * _CONTEXTS
