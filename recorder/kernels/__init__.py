"""The compiled kernels: image codec, checksum, pixel formats. They work without the interpreter lock."""

from recorder.kernels._kernels import (
    FormatError,
    crc32c,
    crc32c_portable,
    felics_decode_into,
    felics_encode,
    felics_encode_into,
    felics_header,
    felics_largest_encoding,
    felics_shape,
    felics_train,
    felics_usual_table,
    find_marker,
    instruction_set,
    unpack_mono10p,
)

__all__ = [
    "FormatError",
    "crc32c",
    "crc32c_portable",
    "felics_decode_into",
    "felics_encode",
    "felics_encode_into",
    "felics_header",
    "felics_largest_encoding",
    "felics_shape",
    "felics_train",
    "felics_usual_table",
    "find_marker",
    "instruction_set",
    "unpack_mono10p",
]
