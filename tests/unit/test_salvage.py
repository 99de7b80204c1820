"""Every intact image out of whatever is left, and every loss stated."""

import os
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from numpy.typing import NDArray

from recorder.codec import Gap, StreamFrame, decode, encode, salvage
from tests.unit.stream_pieces import FOREIGN, image, intact_in, streams


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "damaged"


def salvaged(path: Path, data: bytes) -> list[StreamFrame | Gap]:
    """The pieces; fails unless each byte of the file is in exactly one."""
    path.write_bytes(data)
    pieces = list(salvage(path))
    sizes = [len(piece.data) if isinstance(piece, StreamFrame) else piece.size for piece in pieces]
    assert [piece.offset for piece in pieces] == [sum(sizes[:number]) for number in range(len(sizes))]
    assert sum(sizes) == len(data)
    assert all(sizes)
    return pieces


def intact(pieces: list[StreamFrame | Gap]) -> list[tuple[int, bytes]]:
    return [(piece.offset, piece.data) for piece in pieces if isinstance(piece, StreamFrame)]


def gaps(pieces: list[StreamFrame | Gap]) -> list[Gap]:
    return [piece for piece in pieces if isinstance(piece, Gap)]


def picture(seed: int) -> NDArray[np.uint16]:
    return np.random.default_rng(seed).normal(500, 20, (96, 128)).astype(np.uint16)


@settings(max_examples=500)
@given(data=streams)
def test_exactly_the_intact_images_are_kept(data: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    pieces = salvaged(tmp_path_factory.getbasetemp() / "salvaged.felics", data)
    assert intact(pieces) == intact_in(data)
    for one, other in pairwise(gaps(pieces)):
        assert one.error or other.error or one.offset + one.size < other.offset


def test_a_byte_changed_anywhere_costs_one_image_and_is_stated(path: Path) -> None:
    before, hit, after = image(0), image(1), image(3)
    for at in range(len(hit)):
        changed = bytearray(hit)
        for change in (0x01, 0xFF ^ hit[at] or 0x80, 0xE8 ^ hit[at] or 0x40, 0xE9 ^ hit[at] or 0x20):
            changed[at] = hit[at] ^ change
            pieces = salvaged(path, before + changed + after)
            kept = [(0, before), (len(before) + len(hit), after)]
            assert intact(pieces) == kept, at
            lost = gaps(pieces)
            assert sum(gap.size for gap in lost) == len(hit)
            assert any(gap.error for gap in lost) or at < 5 or at >= len(hit) - 2, at


def test_a_file_cut_anywhere_keeps_what_is_whole(path: Path) -> None:
    data = image(0) + image(1) + image(2)
    ends = [len(image(0)), len(image(0) + image(1)), len(data)]
    for size in range(0, len(data), 3):
        pieces = salvaged(path, data[:size])
        assert len(intact(pieces)) == sum(end <= size for end in ends)
        rest = size - max((end for end in ends if end <= size), default=0)
        assert sum(gap.size for gap in gaps(pieces)) == rest
        if rest >= 5:
            assert "cut off" in str(gaps(pieces)[0].error) or "ends early" in str(gaps(pieces)[0].error)


@pytest.mark.parametrize("foreign", FOREIGN)
def test_foreign_bytes_between_swallow_no_image(path: Path, foreign: bytes) -> None:
    data = foreign + image(0) + foreign + image(1) + foreign + image(2) + foreign
    assert [kept for _, kept in intact(salvaged(path, data))] == [image(0), image(1), image(2)]


@pytest.mark.parametrize("foreign", FOREIGN)
@pytest.mark.parametrize("share", [0.05, 0.5, 0.99])
def test_fake_markers_inside_damage_swallow_no_image(path: Path, foreign: bytes, share: float) -> None:
    hit = encode(picture(1))
    at = int(share * len(hit))
    data = image(0) + hit[:at] + foreign + hit[at:] + image(1)
    pieces = salvaged(path, data)
    assert intact(pieces) == [(0, image(0)), (len(data) - len(image(1)), image(1))]
    assert any(gap.error for gap in gaps(pieces))


def test_an_image_inside_an_image_is_kept(path: Path) -> None:
    hit = encode(picture(1))
    pieces = salvaged(path, hit[:3000] + image(0) + hit[3000:])
    assert intact(pieces) == [(3000, image(0))]
    cut, rest = gaps(pieces)
    assert "cut off: no FF E9 at byte 3000" in str(cut.error)
    assert "without its beginning" in str(rest.error)


def test_an_image_whose_header_is_overwritten_is_stated(path: Path) -> None:
    hit = bytearray(encode(picture(1)))
    for start, size in ((2, 3), (2, 40), (0, 2), (0, 100)):
        overwritten = bytes(hit[:start]) + bytes(size) + bytes(hit[start + size :])
        pieces = salvaged(path, image(0) + overwritten + image(1))
        assert len(intact(pieces)) == 2
        assert [bool(gap.error) for gap in gaps(pieces)] == [True], (start, size)


def test_foreign_bytes_are_not_called_images(path: Path) -> None:
    rng = np.random.default_rng(1)
    noise = rng.bytes(4 << 20)
    assert noise.count(b"\xff\xe8") > 20
    texts = b"".join(
        b"\xff\xe9 head of a message, \x00\x01 size \xff\xe8 %d " % number for number in range(500)
    )
    for foreign in (noise, texts, bytes(100_000)):
        pieces = salvaged(path, image(0) + foreign + image(1))
        assert intact(pieces) == [(0, image(0)), (len(image(0)) + len(foreign), image(1))]
        assert [gap.error for gap in gaps(pieces)] == [None]


def test_a_header_that_promises_much_is_not_believed(path: Path) -> None:
    head = image(4)[:300]
    pieces = salvaged(path, head + bytes(5 << 20) + b"\xff\xe9" + image(0))
    assert len(intact(pieces)) == 1
    assert "longer than its header says" in str(gaps(pieces)[0].error)


def test_a_file_that_shrinks_is_a_stated_loss(path: Path) -> None:
    path.write_bytes(image(0) + image(1) + image(2))
    pieces = salvage(path)
    next(pieces)
    os.truncate(path, len(image(0)) + 3)
    lost = gaps(list(pieces))
    assert sum(gap.size for gap in lost) == len(image(1) + image(2))


def test_a_disk_of_lost_sectors_keeps_the_rest(path: Path) -> None:
    rng = np.random.default_rng(2)
    images = [encode(picture(seed)) for seed in range(12)]
    data = bytearray(b"".join(images))
    for sector in rng.choice(len(data) // 512, 4, replace=False):
        data[512 * sector : 512 * (sector + 1)] = bytes(512)
    pieces = salvaged(path, bytes(data))
    ends = np.cumsum([len(one) for one in images])
    whole = [
        number for number, end in enumerate(ends) if data[end - len(images[number]) : end] == images[number]
    ]
    assert 8 <= len(whole) < 12
    assert [kept for _, kept in intact(pieces)] == [images[number] for number in whole]
    assert all(
        np.array_equal(decode(kept), picture(n)) for n, (_, kept) in zip(whole, intact(pieces), strict=True)
    )


@pytest.mark.parametrize(
    "unit",
    [b"\xff\xe8", b"\xff\xe9", b"\xff\xe8\xff\xe9", b"\xff", image(0)[:270], image(0)[:270] + b"\xff\xe9"],
)
def test_time_grows_with_the_file_and_no_faster(path: Path, unit: bytes) -> None:
    def seconds(size: int) -> float:
        path.write_bytes((unit * (size // len(unit) + 1))[:size])
        start = time.process_time()
        for _ in salvage(path):
            pass
        return time.process_time() - start

    small = min(seconds(1 << 16) for _ in range(3))
    assert min(seconds(1 << 19) for _ in range(2)) < 4 * 8 * max(small, 0.002)
