"""GenICam Mono10p against a slow reading of its definition."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from recorder import kernels


def pack(pixels: Sequence[int]) -> bytes:
    """Ten bits a pixel, least significant bit first (GenICam PFNC 2.4, "p" formats)."""
    bits = sum(pixel << 10 * number for number, pixel in enumerate(pixels))
    return bits.to_bytes((10 * len(pixels) + 7) // 8, "little")


def unpack(data: bytes, count: int) -> list[int]:
    bits = int.from_bytes(data, "little")
    return [bits >> 10 * number & 1023 for number in range(count)]


@given(pixels=st.lists(st.integers(0, 1023), max_size=70))
def test_reads_what_was_packed(pixels: list[int]) -> None:
    out = np.full(len(pixels), 0xFFFF, np.uint16)
    kernels.unpack_mono10p(pack(pixels), out)
    assert out.tolist() == pixels


@given(data=st.binary(max_size=90))
def test_any_bytes_mean_what_the_definition_says(data: bytes) -> None:
    count = len(data) * 8 // 10
    exact = data[: (10 * count + 7) // 8]
    out = np.zeros(count, np.uint16)
    kernels.unpack_mono10p(exact, out)
    assert out.tolist() == unpack(exact, count)


def test_fills_an_image() -> None:
    image: NDArray[np.uint16] = np.random.default_rng(1).integers(0, 1024, (31, 33), dtype=np.uint16)
    out = np.empty_like(image)
    kernels.unpack_mono10p(pack(image.ravel().tolist()), out)
    assert np.array_equal(out, image)


@pytest.mark.parametrize("size", [0, 4, 6, 10])
def test_refuses_another_size(size: int) -> None:
    with pytest.raises(ValueError, match="ten bits"):
        kernels.unpack_mono10p(bytes(size), np.zeros(4, np.uint16))


def test_writes_nothing_beyond_the_pixels() -> None:
    for count in range(1, 12):
        guarded = np.full(count + 8, 0xA5A5, np.uint16)
        kernels.unpack_mono10p(bytes((10 * count + 7) // 8), guarded[:count])
        assert (guarded[count:] == 0xA5A5).all()
