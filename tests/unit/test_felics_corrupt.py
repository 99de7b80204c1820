"""Malformed images: each refused for its own reason, at a byte, and never anything worse."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from recorder import codec
from recorder.errors import CodecError
from tests.unit import felics_oracle as oracle


def picture(height: int = 40, width: int = 50, bits: int = 10) -> NDArray[np.uint16]:
    rng = np.random.default_rng(1)
    levels = np.cumsum(rng.integers(-9, 10, (height, width)), 1) + (1 << (bits - 1))
    return np.clip(levels, 0, (1 << bits) - 1).astype(np.uint16)


def refused(data: bytes) -> CodecError:
    with pytest.raises(CodecError) as caught:
        codec.decode(data)
    error = caught.value
    assert error.offset is not None
    assert 0 <= error.offset <= len(data)
    assert f"at byte {error.offset}" in str(error)
    return error


def parts(model: int = oracle.FELICS) -> oracle.Parts:
    return oracle.take_apart(picture(), 10, model=model)


def set_field(name: str, value: object) -> Callable[[oracle.Parts], None]:
    return lambda image: setattr(image, name, value)


def test_the_unharmed_parts_are_an_image() -> None:
    for model in (oracle.RAW, oracle.FELICS):
        assert np.array_equal(codec.decode(parts(model).join()), picture())


@pytest.mark.parametrize("data", [b"", b"\xff", b"\xff\xe9", b"\xe8\xff", b"nothing of the kind"])
def test_no_start_marker(data: bytes) -> None:
    assert "no FF E8" in str(refused(data))


def test_no_end_marker() -> None:
    data = parts().join()
    error = refused(data[:-2])
    assert "no FF E9" in str(error)
    assert error.offset == len(data) - 2
    assert "no FF E9" in str(refused(data + b"\x00"))


def test_every_truncation_is_refused() -> None:
    data = parts().join()
    for size in range(0, len(data) - 2, 7):
        refused(data[:size])
        refused(data[:size] + b"\xff\xe9")


def test_short_header() -> None:
    data = parts().join()
    for size in (2, 3, 20, 60, 150):
        assert "header ends early" in str(refused(data[:size]))


@pytest.mark.parametrize("inserted", [b"\xff\xe8", b"\xff\xe9", b"\xff\xff", b"\xff\x01"])
@pytest.mark.parametrize("where", [0.01, 0.5, 0.99])
def test_marker_inside(inserted: bytes, where: float) -> None:
    data = parts().join()
    at = int(len(data) * where)
    assert data[at - 1] != 0xFF
    error = refused(data[:at] + inserted + data[at:])
    assert "not followed by 00" in str(error)
    assert error.offset == at


HEADER_CASES: list[tuple[str, object, str]] = [
    ("version", 0, "unknown version at byte 2"),
    ("version", 2, "unknown version at byte 2"),
    ("model", 3, "unknown model at byte 3"),
    ("model", 255, "unknown model at byte 3"),
    ("bits", 0, "bit depth is not 1 to 16 at byte 4"),
    ("bits", 17, "bit depth is not 1 to 16 at byte 4"),
    ("width", 0, "width is not 1 to 65535 at byte 6"),
    ("width", 65536, "width is not 1 to 65535 at byte 6"),
    ("width", 2**32 - 1, "width is not 1 to 65535 at byte 6"),
    ("height", 0, "height is not 1 to 65535 at byte"),
    ("height", 65536, "height is not 1 to 65535 at byte"),
    ("table", bytes(16), "wrong table length"),
    ("table", bytes(18), "wrong table length"),
    ("table", b"", "wrong table length"),
    ("table", bytes([0] * 16 + [11]), "a k or m above 15 or the bit depth at byte 38"),
    ("table", bytes([255] + [0] * 16), "a k or m above 15 or the bit depth at byte 22"),
    ("header_checksum", 0, "header's checksum is wrong"),
    ("checksum", 1, "pixels' checksum is wrong"),
    ("model", 2, "wrong table length"),
    ("lengths", [1] * 257, "number of streams is not 1 to 256 at byte 14"),
    ("lengths", [2**32 - 1] * 32, "stream length that cannot hold its pixels at byte 39"),
    ("lengths", [0] * 32, "stream length that cannot hold its pixels at byte 39"),
]


@pytest.mark.parametrize(("name", "value", "reason"), HEADER_CASES)
def test_header_that_lies(name: str, value: object, reason: str) -> None:
    image = parts()
    set_field(name, value)(image)
    assert reason in str(refused(image.join()))


def test_no_streams() -> None:
    image = parts()
    image.streams = []
    assert "number of streams is not 1 to 256" in str(refused(image.join()))


def test_too_many_pixels_are_refused_before_memory_is_taken() -> None:
    image = parts()
    image.width, image.height = 65535, 65535
    assert "more than 2^28 pixels" in str(refused(image.join()))
    image.width, image.height = 16384, 16384
    assert "cannot hold its pixels" in str(refused(image.join()))


def test_lengths_longer_than_the_payload() -> None:
    image = parts()
    image.lengths = [len(stream) for stream in image.streams]
    image.lengths[31] += 1
    assert "longer than the image" in str(refused(image.join()))


def test_bytes_behind_the_last_stream() -> None:
    image = parts()
    image.lengths = [len(stream) for stream in image.streams]
    image.lengths[31] -= 1
    assert "left over behind the streams" in str(refused(image.join()))


def test_lengths_shifted_between_streams() -> None:
    image = parts()
    image.lengths = [len(stream) for stream in image.streams]
    image.lengths[3] += 1
    image.lengths[4] -= 1
    refused(image.join())


def test_stream_that_ends_early() -> None:
    image = parts()
    image.streams[5] = image.streams[5][:-2]
    assert "a stream ends early" in str(refused(image.join()))


def test_bytes_left_in_a_stream() -> None:
    image = parts()
    image.streams[5] += b"\x00"
    assert "left over in a stream" in str(refused(image.join()))


def test_stream_without_rows_is_empty() -> None:
    image = oracle.take_apart(picture(height=4), 10)
    image.streams[9] = b"\x00"
    assert "cannot hold its pixels" in str(refused(image.join()))


def test_padding_of_ones() -> None:
    image = oracle.take_apart(np.full((1, 1), 512, np.uint16), 10)
    assert image.streams[0] == b"\x80"
    image.streams[0] = b"\x81"
    assert "padded with ones" in str(refused(image.join()))


def test_ten_zeros_mean_no_pixel() -> None:
    image = parts()
    image.streams[7] = bytes(len(image.streams[7]))
    error = refused(image.join())
    assert "means no pixel" in str(error)
    before = len(oracle.stuff(image.header())) + sum(map(len, image.streams[:7]))
    assert error.offset is not None
    assert abs(error.offset - before - 2) <= before // 200 + 4


@pytest.mark.parametrize("word", ["001" + "1" * 9 + "1", "001" + "1" * 9 + "0"])
def test_value_out_of_range(word: str) -> None:
    image = oracle.take_apart(np.full((1, 1), 512, np.uint16), 10)
    image.table = bytes([9] * 17)
    image.streams[0] = oracle.pack(word)
    assert "means no pixel" in str(refused(image.join()))


def test_raw_length_must_be_exact() -> None:
    image = parts(oracle.RAW)
    image.streams[0] += b"\x00"
    assert "cannot hold its pixels" in str(refused(image.join()))


def decoded_or_none(data: bytes) -> NDArray[np.uint16] | None:
    try:
        return codec.decode(data)
    except CodecError:
        return None


def mutate(data: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(data)
    at = int(rng.integers(len(data)))
    match int(rng.integers(6)):
        case 0:
            changed[at] ^= 1 << int(rng.integers(8))
        case 1:
            changed[at] = int(rng.integers(256))
        case 2:
            del changed[at:]
        case 3:
            del changed[at : at + int(rng.integers(1, 9))]
        case 4:
            changed[at:at] = rng.bytes(int(rng.integers(1, 9)))
        case _:
            length = int(rng.integers(1, 40))
            changed[at : at + length] = rng.bytes(length)
    return bytes(changed)


@pytest.mark.parametrize("seed", range(4))
def test_mutations_give_an_error_or_the_same_picture(seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = picture(37, 1 + 24 * seed)
    data = codec.encode(image, model="raw" if seed == 3 else "felics")
    survived = [pixels for _ in range(2500) if (pixels := decoded_or_none(mutate(data, rng))) is not None]
    assert all(np.array_equal(pixels, image) for pixels in survived)
    assert len(survived) < 250


@pytest.mark.parametrize("model", ["felics", "felics-ls"])
def test_mutations_of_pictures_for_the_vector_kernels(model: codec.Model) -> None:
    rng = np.random.default_rng(7)
    image = picture(70, 136)
    data = codec.encode(image, model=model)
    survived = [pixels for _ in range(1500) if (pixels := decoded_or_none(mutate(data, rng))) is not None]
    assert all(np.array_equal(pixels, image) for pixels in survived)
    assert len(survived) < 150


@pytest.mark.parametrize("model", [oracle.FELICS, oracle.FELICS_LS])
@pytest.mark.parametrize("height", [2, 33, 70])
def test_random_payloads_for_the_vector_kernels(model: int, height: int) -> None:
    rng = np.random.default_rng(height)
    image = oracle.take_apart(picture(height, 96), 10, model=model, table=usual_table(model))
    for limit in (2, 16, 256) * 30:
        image.streams = [rng.integers(0, limit, len(s), np.uint8).tobytes() for s in image.streams]
        image.mask = 0
        refused(image.join())


def usual_table(model: int) -> bytes:
    return codec.train(picture(64, 64), model="felics" if model == oracle.FELICS else "felics-ls")


@pytest.mark.parametrize("stream", [0, 1, 5, 31])
@pytest.mark.parametrize("model", [oracle.FELICS, oracle.FELICS_LS])
def test_faults_of_one_stream_are_named_for_wide_pictures(model: int, stream: int) -> None:
    whole = oracle.take_apart(picture(70, 128), 10, model=model, table=usual_table(model))
    right = whole.streams[stream]
    for bytes_now, reason in (
        (right[:-2], "a stream ends early"),
        (right + b"\x00", "left over in a stream"),
        (bytes(len(right)), "means no pixel"),
    ):
        whole.streams[stream] = bytes_now
        assert reason in str(refused(whole.join()))


@pytest.mark.parametrize("model", [oracle.FELICS, oracle.FELICS_LS])
@pytest.mark.parametrize("word", ["0" * 10 + "1", "011" + "10"])
def test_one_code_that_means_no_pixel_is_refused_in_wide_pictures(model: int, word: str) -> None:
    """Ten zeros, or a two of one bit: all that follows can be read, and ends where it should."""
    table = bytes(17) if model == oracle.FELICS else bytes(64 + 160)
    image = oracle.take_apart(np.ones((34, 104), np.uint16), 1, model=model, table=table)
    assert (codec.decode(image.join()) == 1).all()
    image.streams[5] = oracle.pack(word + "1" * 103)
    assert "means no pixel" in str(refused(image.join()))


@pytest.mark.parametrize("seed", range(4))
def test_random_payloads_behind_a_sound_header(seed: int) -> None:
    rng = np.random.default_rng(seed)
    bits = (10, 16, 1, 12)[seed]
    image = oracle.take_apart(picture(37, 41, bits), bits, count=(32, 1, 2, 256)[seed])
    for _ in range(100):
        image.table = bytes(rng.integers(0, min(15, bits), 17, dtype=np.uint8, endpoint=True))
        image.streams = [rng.bytes(len(stream)) for stream in image.streams]
        refused(image.join())
