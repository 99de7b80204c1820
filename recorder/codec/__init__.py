"""Lossless images and the stream they stand in; arrays and bytes only."""

from recorder.codec.felics import (
    FelicsHeader,
    KChoice,
    Model,
    decode,
    encode,
    encode_into,
    max_encoded_size,
    model_at,
    read_header,
    train,
)
from recorder.codec.stream import Buffer, walk

__all__ = [
    "Buffer",
    "FelicsHeader",
    "KChoice",
    "Model",
    "decode",
    "encode",
    "encode_into",
    "max_encoded_size",
    "model_at",
    "read_header",
    "train",
    "walk",
]
