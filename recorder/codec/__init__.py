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
from recorder.codec.frame_stream import FrameStream, StreamFrame
from recorder.codec.salvage import Gap, salvage
from recorder.codec.stream import Buffer, walk

__all__ = [
    "Buffer",
    "FelicsHeader",
    "FrameStream",
    "Gap",
    "KChoice",
    "Model",
    "StreamFrame",
    "decode",
    "encode",
    "encode_into",
    "max_encoded_size",
    "model_at",
    "read_header",
    "salvage",
    "train",
    "walk",
]
