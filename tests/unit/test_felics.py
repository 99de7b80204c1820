"""The codec against the oracle that was written from docs/felics.md, and on real pictures."""

import mmap
import os
import platform
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from recorder import codec, kernels
from tests.unit import felics_oracle as oracle

CAMERA = (1024, 1280)
IMAGING = Path(__file__).resolve().parents[3] / "shared" / "data" / "imaging"


def content(kind: str, height: int, width: int, bits: int, seed: int) -> NDArray[np.uint16]:
    rng = np.random.default_rng(seed)
    top = (1 << bits) - 1
    y, x = np.mgrid[:height, :width]
    levels: NDArray[Any]
    match kind:
        case "constant":
            levels = np.full((height, width), rng.integers(0, top, endpoint=True))
        case "random":
            levels = rng.integers(0, top, (height, width), endpoint=True)
        case "checkerboard":
            levels = (x + y) % 2 * top
        case "gradient":
            levels = (x * 3 + y * 5 + rng.integers(0, 4, (height, width))) % (top + 1)
        case "photograph":
            smooth = cv2.GaussianBlur(rng.random((height, width)), (0, 0), 6)
            spread = smooth - smooth.min()
            noise = rng.normal(0, 0.008, (height, width))
            levels = np.clip((spread / max(spread.max(), 1e-9) * 0.9 + noise) * top, 0, top)
        case _:
            raise AssertionError(kind)
    return levels.astype(np.uint16)


KINDS = ["constant", "random", "checkerboard", "gradient", "photograph"]
shapes = st.one_of(
    st.tuples(st.just(1), st.just(1)),
    st.tuples(st.just(1), st.integers(1, 70)),
    st.tuples(st.integers(1, 70), st.just(1)),
    st.tuples(st.integers(1, 36), st.integers(1, 37)),
)


def picture_of(kind: str, shape: tuple[int, int], bits: int, seed: int) -> tuple[NDArray[np.uint16], int]:
    return content(kind, shape[0], shape[1], bits, seed), bits


pictures = st.builds(
    picture_of,
    st.sampled_from(KINDS),
    shapes,
    st.integers(1, 16),
    st.integers(0, 2**32 - 1),
)


@settings(max_examples=400, deadline=None)
@given(picture=pictures)
def test_writes_the_oracles_bytes(picture: tuple[NDArray[np.uint16], int]) -> None:
    image, bits = picture
    data = codec.encode(image, bit_depth=bits, model="felics")
    assert data == oracle.encode(image, bits)
    assert np.array_equal(codec.decode(data), image)


@settings(max_examples=50, deadline=None)
@given(picture=pictures, fixed=st.integers(0, 15))
def test_writes_the_oracles_bytes_with_tables_given(
    picture: tuple[NDArray[np.uint16], int], fixed: int
) -> None:
    image, bits = picture
    k = min(fixed, bits)
    data = codec.encode(image, bit_depth=bits, model="felics", k=k)
    assert data == oracle.encode(image, bits, table=bytes([k] * 17))
    data = codec.encode(image, bit_depth=bits, model="felics", k="context")
    assert data == oracle.encode(image, bits, table=oracle.fixed_table(bits))


ls_pictures = st.builds(
    picture_of, st.sampled_from(KINDS), shapes, st.integers(1, 12), st.integers(0, 2**32 - 1)
)


@settings(max_examples=200, deadline=None)
@given(picture=ls_pictures)
def test_writes_the_oracles_least_squares_bytes(picture: tuple[NDArray[np.uint16], int]) -> None:
    image, bits = picture
    tables = codec.train(image, bit_depth=bits)
    data = codec.encode(image, bit_depth=bits, model="felics-ls")
    assert data == oracle.encode(image, bits, model=oracle.FELICS_LS, table=tables)
    assert data == codec.encode(image, bit_depth=bits, model="felics-ls", tables=tables)
    assert np.array_equal(codec.decode(data), image)


def wild_tables(seed: int, bits: int) -> bytes:
    rng = np.random.default_rng(seed)
    codes = rng.integers(0, bits, 64, endpoint=True) + 16 * rng.integers(0, bits, 64, endpoint=True)
    return codes.astype(np.uint8).tobytes() + rng.integers(-32768, 32768, 80).astype("<i2").tobytes()


@settings(max_examples=100, deadline=None)
@given(picture=ls_pictures, seed=st.integers(0, 1000), count=st.sampled_from([1, 5, 32, 256]))
def test_follows_the_oracle_with_any_tables(
    picture: tuple[NDArray[np.uint16], int], seed: int, count: int
) -> None:
    image, bits = picture
    tables = wild_tables(seed, bits)
    data = codec.encode(image, bit_depth=bits, model="felics-ls", tables=tables)
    assert data == oracle.encode(image, bits, model=oracle.FELICS_LS, table=tables)
    assert np.array_equal(codec.decode(data), image)
    other = oracle.take_apart(image, bits, model=oracle.FELICS_LS, table=tables, count=count).join()
    assert np.array_equal(codec.decode(other), image)
    assert np.array_equal(oracle.decode(other), image)


@pytest.mark.parametrize("bits", [1, 8, 10, 12])
@pytest.mark.parametrize("model", ["felics", "felics-ls"])
@pytest.mark.parametrize("width", [63, 64, 72, 95, 128, 136, 200])
@pytest.mark.parametrize("height", [2, 31, 33, 34, 100])
def test_vector_kernels_follow_the_oracle(bits: int, model: codec.Model, width: int, height: int) -> None:
    for kind in ("photograph", "gradient", "checkerboard"):
        image = content(kind, height, width, bits, seed=width + height)
        if bits == 8 and kind != "checkerboard" and height in (2, 34):
            number = oracle.FELICS_LS if model == "felics-ls" else oracle.FELICS
            tables = codec.train(image, bit_depth=bits, model=model)
            data = oracle.encode(image, bits, model=number, table=tables)
            assert codec.encode(image, bit_depth=bits, model=model) == data
        assert np.array_equal(codec.decode(codec.encode(image, bit_depth=bits, model=model)), image)


@pytest.mark.parametrize("bits", [8, 12, 13, 16])
def test_least_squares_are_the_default_and_felics_above_twelve_bits(bits: int) -> None:
    image = content("photograph", 64, 64, bits, seed=1)
    fitting: codec.Model = "felics-ls" if bits <= 12 else "felics"
    assert codec.model_at(bits, "felics-ls") == fitting
    data = codec.encode(image, bit_depth=bits)
    assert codec.read_header(data).model == fitting
    assert data == codec.encode(image, bit_depth=bits, model="felics-ls")
    assert data == codec.encode(image, bit_depth=bits, model=fitting)
    assert data == codec.encode(image, bit_depth=bits, tables=codec.train(image, bit_depth=bits))
    out = np.zeros(codec.max_encoded_size(64, 64, bits), np.uint8)
    assert data == out[: codec.encode_into(image, out, bit_depth=bits)].tobytes()


@settings(max_examples=30, deadline=None)
@given(picture=pictures)
def test_writes_the_oracles_raw_bytes(picture: tuple[NDArray[np.uint16], int]) -> None:
    image, bits = picture
    assert codec.encode(image, bit_depth=bits, model="raw") == oracle.encode(image, bits, model=oracle.RAW)


@settings(max_examples=60, deadline=None)
@given(picture=pictures, count=st.integers(1, 256), mask=st.integers(0, 255), model=st.sampled_from([0, 1]))
def test_reads_what_another_encoder_may_write(
    picture: tuple[NDArray[np.uint16], int], count: int, mask: int, model: int
) -> None:
    image, bits = picture
    parts = oracle.take_apart(image, bits, model=model, count=count)
    parts.mask = mask
    data = parts.join()
    assert np.array_equal(oracle.decode(data), image)
    assert np.array_equal(codec.decode(data), image)


def test_codes_the_example_of_the_page() -> None:
    words = {101: "101", 104: "1110", 112: "001101", 99: "01000", 500: "0000000001" + "0111110100"}
    for x, word in words.items():
        assert oracle.code_word(x, 100, 105, oracle.FIXED_TABLE, 10) == word


def test_codes_the_least_squares_example_of_the_page() -> None:
    weights = [weight for weight in (8192, -4096, 2048, 0, 1024) for _ in range(16)]
    table = bytes([0x23] * 64) + np.array(weights, "<i2").tobytes()
    interval = oracle.ls_interval((100, 104, 98, 110, 97, 101), table, 10)
    assert interval == (100, 3, 2)
    words = {100: "1000", 107: "1111", 108: "01001", 91: "0001000", 500: "0000000001" + "0111110100"}
    for x, word in words.items():
        assert oracle.ls_code_word(x, *interval, 10) == word


def test_the_whole_image_of_the_page_is_one() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "felics.md").read_text(encoding="utf-8")
    image = bytes.fromhex(page.split("### A whole image")[1].split("```")[1])
    pixels = [[500, 501, 503, 1023], [498, 505, 500, 1022], [500, 502, 504, 0]]
    assert codec.decode(image).tolist() == pixels
    assert oracle.decode(image).tolist() == pixels
    assert codec.read_header(image).stream_lengths == (9, 4)
    assert image[2:-2].count(b"\xff\x00") == 2


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bits", [8, 10, 12, 16])
@pytest.mark.parametrize("model", ["felics", "felics-ls"])
def test_round_trips_the_cameras_shape(kind: str, bits: int, model: codec.Model) -> None:
    image = content(kind, *CAMERA, bits, seed=bits)
    data = codec.encode(image, bit_depth=bits, model=model)
    assert np.array_equal(codec.decode(data), image)
    packed = image.size * bits // 8
    assert len(data) <= packed * 1.01
    assert len(data) <= codec.max_encoded_size(CAMERA[1], CAMERA[0], bits)


@pytest.mark.parametrize("shape", [(33, 65535), (65535, 33), (1, 65535), (65535, 1)])
@pytest.mark.parametrize("model", ["felics", "felics-ls"])
def test_round_trips_the_longest_sides(shape: tuple[int, int], model: codec.Model) -> None:
    image = content("gradient", *shape, 10, seed=1)
    assert np.array_equal(codec.decode(codec.encode(image, model=model)), image)


def test_noise_falls_back_to_raw() -> None:
    data = codec.encode(content("random", 64, 64, 10, seed=1))
    assert codec.read_header(data).model == "raw"


def test_a_picture_full_of_the_masks_byte_gets_another_mask() -> None:
    image = np.full((256, 256), 0xFF ^ oracle.USUAL_MASK, np.uint8)
    data = codec.encode(image, bit_depth=8, model="raw")
    assert codec.read_header(data).xor != oracle.USUAL_MASK
    assert len(data) < image.size * 1.01
    assert np.array_equal(codec.decode(data), image)


def test_eight_bit_images_are_taken_as_they_are() -> None:
    image = content("photograph", 40, 50, 8, seed=3)
    data = codec.encode(image.astype(np.uint8), bit_depth=8)
    assert data == codec.encode(image, bit_depth=8)


def test_views_are_encoded_as_they_look() -> None:
    image = content("photograph", 40, 50, 10, seed=4)
    view = image[::2, ::-3]
    assert np.array_equal(codec.decode(codec.encode(view)), view)


@pytest.mark.parametrize("threads", [2, 3, 7, 32])
@pytest.mark.parametrize("model", ["raw", "felics", "felics-ls"])
@pytest.mark.parametrize("shape", [(1, 1), (5, 300), (31, 64), (33, 65), (64, 96), (97, 200), (200, 31)])
def test_an_image_coded_by_several_threads_is_the_same(
    threads: int, model: codec.Model, shape: tuple[int, int]
) -> None:
    image = content("photograph", *shape, 10, threads)
    alone = codec.encode(image, model=model)
    assert codec.encode(image, model=model, threads=threads) == alone
    out = np.empty(codec.max_encoded_size(shape[1], shape[0]), np.uint8)
    assert bytes(out[: codec.encode_into(image, out, model=model, threads=threads)]) == alone


@pytest.mark.parametrize("threads", [-1, 0, 33])
def test_refuses_a_number_of_threads_that_cannot_be(threads: int) -> None:
    with pytest.raises(ValueError, match="1 to 32 threads"):
        codec.encode(np.zeros((40, 50), np.uint16), threads=threads)


def test_a_value_above_the_depth_in_any_threads_rows_is_refused() -> None:
    for row in range(64):
        image = np.zeros((64, 70), np.uint16)
        image[row, 3] = 1024
        with pytest.raises(ValueError, match="above the bit depth"):
            codec.encode(image, threads=4)


def test_encode_into_writes_what_encode_returns() -> None:
    image = content("photograph", 40, 50, 10, seed=5)
    out = np.zeros(codec.max_encoded_size(50, 40, 10) + 8, np.uint8)
    size = codec.encode_into(image, out)
    assert out[:size].tobytes() == codec.encode(image)


def test_encode_into_stays_inside_the_largest_size() -> None:
    for kind in KINDS:
        for bits in (1, 7, 10, 16):
            image = content(kind, 33, 19, bits, seed=bits)
            guarded = np.full(codec.max_encoded_size(19, 33, bits) + 64, 0xA5, np.uint8)
            codec.encode_into(image, guarded[:-64], bit_depth=bits)
            assert (guarded[-64:] == 0xA5).all()


@pytest.mark.parametrize(
    ("image", "options"),
    [
        (np.zeros((4, 4), np.int16), {}),
        (np.zeros((4, 4), np.float32), {}),
        (np.zeros((4, 4, 3), np.uint8), {}),
        (np.zeros(4, np.uint8), {}),
        (np.zeros((0, 4), np.uint16), {}),
        (np.zeros((4, 0), np.uint16), {}),
        (np.zeros((1, 65536), np.uint16), {}),
        (np.zeros((4, 4), np.uint16), {"bit_depth": 0}),
        (np.zeros((4, 4), np.uint16), {"bit_depth": 17}),
        (np.zeros((4, 4), np.uint16), {"model": "jpeg"}),
        (np.zeros((4, 4), np.uint16), {"k": -1}),
        (np.zeros((4, 4), np.uint16), {"k": 16, "bit_depth": 16}),
        (np.zeros((4, 4), np.uint16), {"k": 9, "bit_depth": 8}),
        (np.zeros((4, 4), np.uint16), {"k": "best"}),
    ],
)
def test_refuses_what_is_no_image(image: NDArray[Any], options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"image|bit depth|model|k is"):
        codec.encode(image, **options)


@pytest.mark.parametrize("at", [(0, 0), (20, 30), (39, 49)])
@pytest.mark.parametrize("bits", [1, 7, 10, 15])
def test_refuses_a_value_above_the_depth(at: tuple[int, int], bits: int) -> None:
    image = np.zeros((40, 50), np.uint16)
    image[at] = 1 << bits
    with pytest.raises(ValueError, match="above the bit depth"):
        codec.encode(image, bit_depth=bits)


def test_refuses_an_unfit_output() -> None:
    image = np.zeros((4, 4), np.uint16)
    size = codec.max_encoded_size(4, 4)
    read_only = np.zeros(size, np.uint8)
    read_only.flags.writeable = False
    for out in (np.zeros(size - 1, np.uint8), np.zeros(2 * size, np.uint8)[::2], read_only):
        with pytest.raises(ValueError, match="output"):
            codec.encode_into(image, out)


def test_the_header_says_what_was_encoded() -> None:
    image = content("photograph", 40, 50, 12, seed=6)
    header = codec.read_header(codec.encode(image, bit_depth=12, model="felics", k=5))
    assert (header.version, header.model, header.bit_depth) == (1, "felics", 12)
    assert (header.width, header.height) == (50, 40)
    assert header.k == (5,) * 17
    assert len(header.stream_lengths) == 32
    assert header.checksum == oracle.pixel_checksum(image)


def test_no_marker_stands_inside() -> None:
    for kind in KINDS:
        data = codec.encode(content(kind, 200, 300, 10, seed=7))
        body = data[2:-2]
        assert body.count(b"\xff") == body.count(b"\xff\x00")


def test_any_buffer_is_read(tmp_path: Path) -> None:
    image = content("photograph", 40, 50, 10, seed=8)
    data = codec.encode(image)
    path = tmp_path / "image"
    path.write_bytes(data)
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
        for buffer in (data, bytearray(data), memoryview(data), mapped, np.frombuffer(data, np.uint8)):
            assert np.array_equal(codec.decode(buffer), image)
            assert codec.read_header(buffer).width == 50
            assert list(codec.walk(buffer)) == [slice(0, len(data))]


def test_walk_finds_every_image_between_other_bytes() -> None:
    images = [codec.encode(content(kind, 60, 50, 10, seed=9)) for kind in KINDS]
    stream = bytearray(b"\xff\xe9 lone end, \xff\xe8 start of nothing ")
    expected = []
    for number, image in enumerate(images):
        expected.append(slice(len(stream), len(stream) + len(image)))
        stream += image + (b"\xff" if number % 2 else images[0][: len(images[0]) // 2])
    found = list(codec.walk(stream))
    assert found == expected
    assert [bytes(stream[where]) for where in found] == images


def test_walk_refuses_nothing_and_the_header_tells() -> None:
    assert list(codec.walk(b"")) == []
    assert list(codec.walk(b"\xff")) == []
    assert list(codec.walk(b"\xff\xff\xe8\xff\xff\xe9")) == [slice(1, 6)]


@settings(max_examples=300)
@given(
    data=st.lists(st.sampled_from([b"\xff", b"\xe8", b"\xe9", b"\x00", bytes(31), bytes(97)]), max_size=40),
    start=st.integers(0, 500),
)
def test_markers_are_found_wherever_they_stand(data: list[bytes], start: int) -> None:
    joined = b"".join(data)
    places = [joined.find(marker, start) for marker in (b"\xff\xe8", b"\xff\xe9")]
    assert kernels.find_marker(joined, start) == min((at for at in places if at >= 0), default=len(joined))


def golden_picture() -> NDArray[np.uint16]:
    y, x = np.mgrid[:70, :136]
    levels: NDArray[Any] = (x * x // 7 + y * 11 + (x * 2654435761 + y * 40503) % 31) % 1024
    return levels.astype(np.uint16)


@pytest.mark.parametrize(
    ("model", "tables", "size", "checksum"),
    [
        ("raw", b"", 12100, 0x463336BE),
        ("felics", bytes([2, 2, 2, 2, 3, 4, 4, 4, 4, 5, 6, 7, 8, 9, 10, 10, 10]), 8959, 0x7F860F1B),
        ("felics-ls", bytes([0x33] * 64 + [0, 32] * 16 + [0, 0] * 64), 8864, 0xE2E24FD1),
    ],
)
def test_the_format_stays_as_it_is(model: codec.Model, tables: bytes, size: int, checksum: int) -> None:
    data = codec.encode(golden_picture(), model=model, tables=tables)
    assert (len(data), oracle.crc32c(data)) == (size, checksum)
    assert np.array_equal(codec.decode(data), golden_picture())
    assert codec.read_header(data).tables == tables


def test_threads_do_not_disturb_each_other() -> None:
    images = [content("photograph", 300, 400, 10, seed=seed) for seed in range(4)]
    expected = [codec.encode(image) for image in images]
    wrong: list[int] = []

    def work(number: int) -> None:
        for _ in range(10):
            data = codec.encode(images[number])
            if data != expected[number] or not np.array_equal(codec.decode(data), images[number]):
                wrong.append(number)

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_every_processor_writes_the_same_bytes() -> None:
    script = (
        "import sys, numpy as np; from recorder import codec, kernels\n"
        "rng = np.random.default_rng(1)\n"
        "for bits in (1, 8, 10, 16):\n"
        "    image = np.cumsum(rng.integers(-9, 10, (67, 536)), 1).astype(np.uint16) & ((1 << bits) - 1)\n"
        "    for model in ('felics', 'felics-ls')[: 1 + (bits < 13)]:\n"
        "        data = codec.encode(image, bit_depth=bits, model=model)\n"
        "        assert np.array_equal(codec.decode(data), image)\n"
        "        print(kernels.crc32c(data), len(data))\n"
        "print(kernels.instruction_set(), file=sys.stderr)\n"
    )
    best, scalar = (run_with_kernels(name, script) for name in (None, "scalar"))
    assert best.returncode == scalar.returncode == 0, best.stderr + scalar.stderr
    assert scalar.stderr == "scalar\n"
    assert best.stdout
    assert best.stdout == scalar.stdout


def run_with_kernels(name: str | None, script: str) -> subprocess.CompletedProcess[str]:
    """Python with RECORDER_KERNELS set to ``name``, or unset."""
    environment = {key: value for key, value in os.environ.items() if key != "RECORDER_KERNELS"}
    if name is not None:
        environment["RECORDER_KERNELS"] = name
    return subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=False
    )


@pytest.mark.skipif(
    platform.machine() != "x86_64" or shutil.which("g++") is None or not Path("/usr/include/simde").is_dir(),
    reason="needs g++ and libsimde-dev on x86-64",
)
def test_every_instruction_set_writes_and_reads_the_same() -> None:
    script = Path(__file__).parents[2] / "tools" / "emulate_avx512.sh"
    done = subprocess.run([script, "1000"], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "1000 pictures, nothing found\n"


def test_kernels_that_nobody_knows_are_refused_at_import() -> None:
    refused = run_with_kernels("mmx", "import recorder.kernels")
    assert refused.returncode == 1
    assert refused.stderr.splitlines()[-1].startswith("ImportError: RECORDER_KERNELS is scalar")


@given(data=st.binary(max_size=200))
def test_checksums_agree_with_the_oracle(data: bytes) -> None:
    assert kernels.crc32c(data) == kernels.crc32c_portable(data) == oracle.crc32c(data)


@pytest.mark.parametrize("size", [0, 4095, 4096, 4097, 100_003, 2_621_440])
def test_checksums_of_long_buffers_agree(size: int) -> None:
    data = np.random.default_rng(size).integers(0, 256, size, dtype=np.uint8)
    assert kernels.crc32c(data) == kernels.crc32c_portable(data)


def test_checksum_of_the_standard() -> None:
    assert kernels.crc32c(b"123456789") == 0xE3069283


@pytest.mark.skipif(not IMAGING.is_dir(), reason=f"no pictures at {IMAGING}")
def test_real_pictures_round_trip() -> None:
    greys = 0
    for path in sorted(IMAGING.rglob("*")):
        if path.suffix.lower() not in {".pgm", ".ppm", ".png", ".tif", ".tiff"}:
            continue
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if image is None or image.dtype not in (np.uint8, np.uint16):
            continue
        grey = image if image.ndim == 2 else image[:, :, 1]
        depth = max(1, int(grey.max()).bit_length())
        for bits in {depth, 8 * grey.dtype.itemsize}:
            assert np.array_equal(codec.decode(codec.encode(grey, bit_depth=bits)), grey), path
        greys += 1
    assert greys >= 5
