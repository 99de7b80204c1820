"""Streams put together from whole images, harmed ones and foreign bytes."""

import re
from functools import cache

import numpy as np
from hypothesis import strategies as st

from recorder.codec import Model, encode

IMAGES = 6
FOREIGN = (
    b"\xff",
    b"\x00",
    b"\xff\xe9",
    b"\xff\xe8",
    b"\xff\xe8\xff\xe8",
    b"\xff\xe8\xff\xe9",
    b"\xff\xe8\xff\xff\xe9",
    b"\xff\xe9\xff\xe9\xff\xe8",
    b"\xff\xe8 begins like nothing \xff\xe9",
    b"\xff\xe8" + 99 * b"\xff\xe9\xff\xe8",
    b"\x89MCAP0\r\n and other records \xff\x00\xff\xd8\xff\xe0 JFIF",
)


@cache
def image(number: int) -> bytes:
    """A small image, each of another size, model and depth."""
    rng = np.random.default_rng(number)
    models: list[tuple[int, Model]] = [(10, "felics-ls"), (8, "felics"), (16, "raw")]
    depth, model = models[number % 3]
    top = (1 << depth) - 1
    pixels = rng.normal(top / 2, 9 + number, (9 + 5 * number, 30 + number)).clip(0, top).astype(np.uint16)
    return encode(pixels, bit_depth=depth, model=model)


def intact_in(data: bytes) -> list[tuple[int, bytes]]:
    """The truth: every place where all bytes of an image stand."""
    return sorted(
        (place.start(), image(number))
        for number in range(IMAGES)
        for place in re.finditer(re.escape(image(number)), data)
    )


def _cut(number: int, share: float) -> bytes:
    return image(number)[: int(share * len(image(number)))]


def _tail(number: int, share: float) -> bytes:
    return image(number)[int(share * len(image(number))) :]


def _changed(number: int, share: float, change: int) -> bytes:
    data = bytearray(image(number))
    data[int(share * len(data))] ^= change
    return bytes(data)


def _inserted(number: int, share: float, foreign: bytes) -> bytes:
    return _cut(number, share) + foreign + _tail(number, share)


_numbers = st.integers(0, IMAGES - 1)
_shares = st.floats(0, 1, exclude_max=True)
_foreign = st.sampled_from(FOREIGN)
streams = st.lists(
    st.one_of(
        st.builds(image, _numbers),
        st.builds(image, _numbers),
        _foreign,
        st.binary(max_size=60),
        st.builds(_cut, _numbers, _shares),
        st.builds(_tail, _numbers, _shares),
        st.builds(_changed, _numbers, _shares, st.integers(1, 255)),
        st.builds(_inserted, _numbers, _shares, _foreign),
    ),
    max_size=8,
).map(b"".join)
