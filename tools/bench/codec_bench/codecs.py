"""Our codec and its peers, all with one face: pixels in, bytes out, and back."""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from codec_bench.pictures import BITS, Picture

from recorder import codec
from recorder.codec import Buffer, Model
from recorder.samples import Pixels


@dataclass(frozen=True, slots=True)
class Codec:
    """Two calls, each in one thread. What they return may be overwritten by the next one."""

    name: str
    encode: Callable[[Picture], Buffer]
    decode: Callable[[bytes], Pixels]


def felics(model: Model, *, fresh: bool = False) -> Codec:
    """Ours. As in a recorder, tables are trained apart from encoding: when a picture is seen first.

    With ``fresh`` each image is trained for while it is encoded.
    """
    tables: dict[str, bytes] = {}
    out = np.empty(0, np.uint8)

    def encode(picture: Picture) -> Buffer:
        nonlocal out
        pixels, depth = picture.pixels, picture.bit_depth
        room = codec.max_encoded_size(pixels.shape[1], pixels.shape[0], depth)
        if out.size < room:
            out = np.empty(room, np.uint8)
        if not fresh and picture.name not in tables:
            tables[picture.name] = codec.train(pixels, bit_depth=depth, model=model)
        size = codec.encode_into(pixels, out, bit_depth=depth, model=model, tables=tables.get(picture.name))
        return out[:size]

    return Codec(f"{model} trained each time" if fresh else model, encode, codec.decode)


def memcpy(height: int, width: int) -> Codec:
    """What every machine can do: two bytes a pixel, copied."""
    out = np.empty((height, width), np.uint16)

    def copy(pixels: Pixels) -> Pixels:
        np.copyto(out, pixels)
        return out

    return Codec(
        "memcpy",
        lambda picture: copy(picture.pixels),
        lambda data: copy(np.frombuffer(data, np.uint16).reshape(height, width)),
    )


JPEG_LS, JXL_E1 = "JPEG-LS", "JPEG XL e1"
"""Those that goals are about."""


def peers(height: int, width: int) -> list[Codec]:
    """The field, for 10-bit pictures of this shape; they come with ``make bench``."""
    import imagecodecs as ic  # noqa: PLC0415

    pixels = np.empty((height, width), np.uint16)
    size = pixels.nbytes

    def jpeg_xl(effort: int) -> Codec:
        return Codec(
            f"JPEG XL e{effort}",
            lambda p: ic.jpegxl_encode(
                p.pixels, effort=effort, lossless=True, bitspersample=BITS, numthreads=1
            ),
            lambda data: ic.jpegxl_decode(data, numthreads=1, out=pixels),
        )

    differences, shuffled = np.empty_like(pixels), np.empty_like(pixels)

    def shuffle(picture: Picture) -> bytes:
        ic.delta_encode(picture.pixels, out=differences)
        ic.bitshuffle_encode(differences, itemsize=2, out=shuffled)
        data: bytes = ic.zstd_encode(shuffled, level=1)
        return data

    def unshuffle(data: bytes) -> Pixels:
        planes = np.frombuffer(ic.zstd_decode(data, out=size), np.uint16).reshape(height, width)
        ic.bitshuffle_decode(planes, itemsize=2, out=differences)
        ic.delta_decode(differences, out=pixels)
        return pixels

    nearest = {"bitspersample": BITS, "flags": ic.AEC.FLAG.DATA_PREPROCESS, "blocksize": 32, "rsi": 128}
    return [
        jpeg_ls(),
        Codec(
            "JPEG-LS as 16 bit",
            lambda p: ic.jpegls_encode(p.pixels),
            lambda data: ic.jpegls_decode(data, out=pixels),
        ),
        jpeg_xl(1),
        jpeg_xl(3),
        Codec(
            "HTJ2K",
            lambda p: ic.htj2k_encode(p.pixels, reversible=True),
            lambda data: ic.htj2k_decode(data, out=pixels),
        ),
        Codec(
            "CCSDS-121",
            lambda p: ic.aec_encode(p.pixels, **nearest),
            lambda data: ic.aec_decode(data, out=pixels, **nearest),
        ),
        ffv1(height, width),
        Codec("delta + bitshuffle + zstd 1", shuffle, unshuffle),
        Codec("LERC", lambda p: ic.lerc_encode(p.pixels, level=0), ic.lerc_decode),
        Codec(
            "10 bits packed",
            lambda p: ic.packints_encode(p.pixels, BITS),
            lambda data: ic.packints_decode(data, np.uint16, BITS).reshape(height, width),
        ),
    ]


def jpeg_ls() -> Codec:
    """CharLS told the true depth, which makes it smaller than as 16 bits; pictures of any shape and depth."""
    import jpeg_ls as charls  # noqa: PLC0415

    def encode(picture: Picture) -> bytearray:
        (rows, columns), source = picture.pixels.shape, picture.pixels.tobytes()
        data: bytearray = charls.encode_buffer(
            source, rows=rows, columns=columns, samples_per_pixel=1, bits_stored=picture.bit_depth
        )
        return data

    def decode(data: bytes) -> Pixels:
        pixels, told = charls.decode_pixel_data(data)
        return np.frombuffer(pixels, np.uint16).reshape(told["height"], told["width"])

    return Codec(JPEG_LS, encode, decode)


def ffv1(height: int, width: int) -> Codec:
    """FFV1 version 3 as every archive writes it: key frames only, 4 slices, range coder."""
    import av  # noqa: PLC0415

    writer: Any = av.CodecContext.create("ffv1", "w")
    writer.width, writer.height, writer.pix_fmt = width, height, "gray10le"
    writer.time_base = Fraction(1, 60)
    writer.thread_count = 1
    writer.options = {"level": "3", "slices": "4", "context": "0", "g": "1", "coder": "1"}
    writer.open()
    reader: Any = av.CodecContext.create("ffv1", "r")
    reader.width, reader.height, reader.extradata = width, height, writer.extradata
    reader.thread_count = 1
    return Codec(
        "FFV1",
        lambda p: bytes(writer.encode(av.VideoFrame.from_ndarray(p.pixels, format="gray10le"))[0]),
        lambda data: reader.decode(av.Packet(data))[0].to_ndarray(),
    )
