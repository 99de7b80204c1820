"""``recorder felics`` as a user runs it: exact there and back, and one line for what cannot be."""

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from recorder.codec import FelicsHeader, FrameStream, encode, walk
from tests.system.recorder_process import recorder

SUFFIXES = ("png", "tiff", "pgm", "npy")


def picture(bits: int, seed: int = 1, height: int = 48, width: int = 70) -> NDArray[Any]:
    rng = np.random.default_rng(seed)
    top = (1 << bits) - 1
    levels = np.clip(rng.normal(top / 2, top / 50 + 1, (height, width)), 0, top)
    levels[0, 0] = top
    return levels.astype(np.uint8 if bits <= 8 else np.uint16)


def write(path: Path, image: NDArray[Any], maxval: int | None = None) -> Path:
    """An image file by other means than the product's."""
    if path.suffix == ".npy":
        np.save(path, image)
    elif path.suffix == ".pgm":
        head = f"P5 {image.shape[1]} {image.shape[0]} {maxval}\n"
        path.write_bytes(head.encode() + image.astype(image.dtype.newbyteorder(">")).tobytes())
    else:
        assert cv2.imwrite(str(path), image)
    return path


def read(path: Path) -> NDArray[Any]:
    image: Any = np.load(path) if path.suffix == ".npy" else cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return np.asarray(image)


def headers(stream: Path) -> list[FelicsHeader]:
    with FrameStream(stream) as frames:
        return [frame.header for frame in frames]


@pytest.fixture
def stream(tmp_path: Path) -> Path:
    """Four 10-bit images."""
    path = tmp_path / "four.felics"
    path.write_bytes(b"".join(encode(picture(10, seed)) for seed in range(4)))
    return path


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(("bits", "stated"), [(8, 8), (10, 10), (11, 12), (16, 16)])
def test_an_image_comes_back_as_it_was(tmp_path: Path, suffix: str, bits: int, stated: int) -> None:
    maxval = (1 << bits) - 1
    source = write(tmp_path / f"in.{suffix}", picture(bits), maxval)
    stream, back = tmp_path / "one.felics", tmp_path / f"back.{suffix}"
    ran = recorder("felics", "encode", source, "-o", stream, "--json")
    assert ran.code == 0, ran.err
    assert (ran.json["images"], ran.json["bytes"]) == (1, stream.stat().st_size)
    assert [header.bit_depth for header in headers(stream)] == [bits if suffix == "pgm" else stated]
    assert recorder("felics", "decode", stream, "-o", back).code == 0
    assert read(back).dtype == picture(bits).dtype
    assert np.array_equal(read(back), picture(bits))
    if suffix == "pgm":
        assert back.read_bytes().split(b"\n")[:3] == [b"P5", b"70 48", str(maxval).encode()]


@pytest.mark.parametrize("bits", [1, 4, 9, 13])
def test_the_maxval_of_a_pgm_is_its_depth(tmp_path: Path, bits: int) -> None:
    source = write(tmp_path / "in.pgm", picture(bits), (1 << bits) - 1)
    plain = tmp_path / "plain.pgm"
    numbers = " ".join(map(str, picture(bits).ravel()))
    plain.write_text(f"P2\n# by hand\n70 48\n# deep\n{(1 << bits) - 1}\n{numbers}\n")
    stream, back = tmp_path / "both.felics", tmp_path / "back"
    assert recorder("felics", "encode", source, plain, "-o", stream).code == 0
    assert [header.bit_depth for header in headers(stream)] == [bits, bits]
    assert recorder("felics", "decode", stream, "-o", back, "--format", "pgm").code == 0
    for path in back.iterdir():
        assert path.read_bytes().split(b"\n")[2] == str((1 << bits) - 1).encode()
        assert np.array_equal(read(path), picture(bits))


def test_a_stack_is_a_stream_and_comes_back_as_one(tmp_path: Path) -> None:
    stack = np.stack([picture(12, seed) for seed in range(5)])
    np.save(tmp_path / "stack.npy", stack)
    ran = recorder("felics", "encode", "stack.npy", "-o", "stack.felics", cwd=tmp_path)
    assert ran.code == 0, ran.err
    assert "5 images" in ran.out
    (tmp_path / "back").mkdir()
    assert recorder("felics", "decode", "stack.felics", "-o", "back/all.npy", cwd=tmp_path).code == 0
    back = np.load(tmp_path / "back" / "all.npy")
    assert back.dtype == stack.dtype
    assert np.array_equal(back, stack)


def test_several_files_are_one_stream_in_their_order(tmp_path: Path) -> None:
    files = [write(tmp_path / f"{n}.{s}", picture(8, n), 255) for n, s in enumerate(SUFFIXES)]
    pages = [picture(10, 20), picture(10, 21)]
    assert cv2.imwritemulti(str(tmp_path / "pages.tiff"), pages)
    ran = recorder(
        "felics", "encode", *reversed(files), tmp_path / "pages.tiff", "-o", tmp_path / "all.felics"
    )
    assert ran.code == 0, ran.err
    ran = recorder("felics", "decode", "all.felics", "--json", cwd=tmp_path)
    assert ran.code == 0, ran.err
    names = [Path(name) for name in ran.json["files"]]
    assert [name.name for name in names] == [f"{number:06d}.png" for number in range(6)]
    assert ran.json["out"] == str(tmp_path / "all")
    for name, expected in zip(names, [*map(read, reversed(files)), *pages], strict=True):
        assert read(name).dtype == expected.dtype
        assert np.array_equal(read(name), expected)


@pytest.mark.parametrize("model", ["felics-ls", "felics", "raw"])
def test_the_model_and_the_depth_can_be_chosen(tmp_path: Path, model: str) -> None:
    source = write(tmp_path / "in.png", picture(8))
    arguments = ("--model", model, "--bit-depth", "11", "-o", tmp_path / "one.felics")
    assert recorder("felics", "encode", source, *arguments).code == 0
    (header,) = headers(tmp_path / "one.felics")
    assert (header.model, header.bit_depth) == (model, 11)


def test_pipes(tmp_path: Path) -> None:
    command = f"{sys.executable} -m recorder felics"
    write(tmp_path / "in.png", picture(10))
    script = (
        f"{command} encode - -o - <in.png | {command} salvage - -o - | {command} decode - -o out.tiff &&"
        f" {command} encode in.png -o - | {command} info - --json"
    )
    ran = subprocess.run(script, shell=True, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert '"bit_depth": 10' in ran.stdout
    assert np.array_equal(read(tmp_path / "out.tiff"), picture(10))


def test_nothing_is_overwritten_unasked(tmp_path: Path, stream: Path) -> None:
    source = write(tmp_path / "in.png", picture(8))
    before = stream.read_bytes()
    (tmp_path / "folder").mkdir()
    kept = tmp_path / "folder" / "notes.txt"
    kept.write_text("mine")
    for arguments in (
        ("encode", source, "-o", stream),
        ("salvage", stream, "-o", stream),
        ("decode", stream, "-o", tmp_path / "folder"),
        ("decode", stream, "-o", source, "--format", "npy"),
        ("encode", source, "-o", tmp_path / "folder"),
    ):
        ran = recorder("felics", *arguments)
        assert ran.code == 2, arguments
        assert str(tmp_path) in ran.problem
    assert stream.read_bytes() == before
    assert recorder("felics", "decode", stream, "-o", tmp_path / "folder", "--force").code == 0
    assert kept.read_text() == "mine"
    assert len(list((tmp_path / "folder").iterdir())) == 5
    assert recorder("felics", "encode", source, "-o", stream, "--force").code == 0
    assert len(headers(stream)) == 1
    assert not list(tmp_path.rglob("*.part"))


def test_even_force_replaces_no_device() -> None:
    ran = recorder("felics", "salvage", __file__, "-o", "/dev/null", "--force")
    assert ran.code == 2
    assert "not a file" in ran.problem
    assert Path("/dev/null").is_char_device()


def npy_head(shape: str) -> bytes:
    head = f"{{'descr': '|u1', 'fortran_order': False, 'shape': {shape}}}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + bytes(99)


def png(bits: int) -> bytes:
    """Four pixels, 0 1 2 3."""
    chunks = (
        (b"IHDR", struct.pack(">IIBBBBB", 4, 1, bits, 0, 0, 0, 0)),
        (b"IDAT", zlib.compress(b"\0\x1b")),
        (b"IEND", b""),
    )
    parts = (
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in chunks
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def tiff(bits: int) -> bytes:
    """4 x 4 pixels, not compressed."""
    size = 2 * bits
    tags = {256: 4, 257: 4, 258: bits, 259: 1, 262: 1, 273: 8, 277: 1, 278: 4, 279: size}
    entries = b"".join(struct.pack("<HHIHH", tag, 3, 1, value, 0) for tag, value in tags.items())
    return (
        b"II*\0"
        + struct.pack("<I", 8 + size)
        + bytes(size)
        + struct.pack("<H", len(tags))
        + entries
        + bytes(4)
    )


BAD: dict[str, bytes] = {
    "empty.png": b"",
    "text.png": b"no picture",
    "cut.png": b"\x89PNG\r\n\x1a\n\0\0",
    "jpeg.jpg": b"\xff\xd8\xff\xe0",
    "colour.ppm": b"P6 1 1 255\nabc",
    "cut.pgm": b"P5 9 9 255\nabc",
    "above.pgm": b"P5 2 1 14\n\x0e\x0f",
    "odd.pgm": b"P5 2 1 1000\n\0\0\0\0",
    "none.pgm": b"P5 0 1 255\n",
    "zero.pgm": b"P5 1 1 0\n\0",
    "words.pgm": b"P2 2 1 255\n1 two",
    "digits.pgm": b"P5 " + 5000 * b"9" + b" 1 255\n",
    "wide.pgm": b"P5 999999999 0 255\n",
    "number.pgm": b"P2 2 1 255\n1 " + 5000 * b"9",
    "two.pgm": 2 * b"P5 2 1 255\n12",
    "two_ascii.pgm": b"P2 2 1 255\n1 2 3",
    "head.npy": b"\x93NUMPY\x01\x00",
    "broken.npy": b"\x93NUMPY\x01\x00\x08\x00{'a': (\n",
    "type.npy": npy_head("[(]"),
    "shape.npy": npy_head("(99999999999999999999999, 3)"),
    "true.npy": npy_head("(True, 3)"),
    "bits.png": png(bits=2),
    "bits.tiff": tiff(bits=12),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_grey_image_is_one_line_and_leaves_nothing(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(BAD[name])
    good = write(tmp_path / "good.npy", picture(8))
    ran = recorder("felics", "encode", good, tmp_path / name, "-o", tmp_path / "out.felics")
    assert ran.code == 2, ran.out
    assert name in ran.problem
    assert not list(tmp_path.glob("*out*"))


@pytest.mark.parametrize(
    "array",
    [
        np.zeros((4, 5, 3), np.uint8),
        np.zeros((4, 5), np.int16),
        np.zeros((4, 5), np.float32),
        np.zeros(4, np.uint8),
        np.zeros((0, 4, 5), np.uint8),
        np.array([{}]),
    ],
)
def test_an_array_that_is_no_stack_is_one_line(tmp_path: Path, array: NDArray[Any]) -> None:
    np.save(tmp_path / "in.npy", array, allow_pickle=True)
    ran = recorder("felics", "encode", tmp_path / "in.npy", "-o", tmp_path / "out.felics")
    assert ran.code == 2, ran.out
    assert "in.npy" in ran.problem


@pytest.mark.parametrize("left", [0.4, 0.7, 0.99])
def test_a_tiff_that_has_lost_pages_is_refused(tmp_path: Path, left: float) -> None:
    source = tmp_path / "pages.tiff"
    assert cv2.imwritemulti(str(source), [picture(10, seed) for seed in range(3)])
    assert recorder("felics", "encode", source, "-o", tmp_path / "whole.felics").code == 0
    assert len(headers(tmp_path / "whole.felics")) == 3
    data = source.read_bytes()
    source.write_bytes(data[: int(len(data) * left)])
    ran = recorder("felics", "encode", source, "-o", tmp_path / "out.felics")
    assert ran.code == 2, ran.out
    assert "pages.tiff" in ran.problem
    assert not (tmp_path / "out.felics").exists()


def test_an_input_that_cannot_be_looked_for_is_not_blamed_on_the_output(tmp_path: Path) -> None:
    ran = recorder("felics", "encode", 300 * "x", "-o", tmp_path / "out.felics")
    assert ran.code == 2
    assert ran.problem.startswith("recorder: xxx")


def test_a_closed_standard_input_is_one_line(tmp_path: Path) -> None:
    program = [sys.executable, "-m", "recorder"]
    for arguments in (["encode", "-", "-o", str(tmp_path / "out.felics")], ["info", "-"]):
        ran = subprocess.run(
            ["sh", "-c", 'exec "$@" <&-', "sh", *program, "felics", *arguments],
            capture_output=True,
            text=True,
            check=False,
        )
        assert ran.returncode == 2, ran.stderr
        assert ran.stderr.startswith("recorder: standard input: is closed")


def test_a_name_with_brackets_is_printed_as_it_is(tmp_path: Path, stream: Path) -> None:
    ran = recorder("felics", "info", stream.rename(tmp_path / "[red]a.felics"))
    assert ran.code == 0, ran.err
    assert "[red]a.felics" in ran.out


def test_a_dangling_link_is_not_replaced_unasked(tmp_path: Path, stream: Path) -> None:
    link = tmp_path / "link.felics"
    link.symlink_to(tmp_path / "elsewhere")
    assert recorder("felics", "salvage", stream, "-o", link).code == 2
    assert link.is_symlink()


def test_colour_is_refused_with_what_to_do(tmp_path: Path) -> None:
    colour = np.dstack([picture(8, seed) for seed in range(3)])
    for suffix in ("png", "tiff"):
        cv2.imwrite(str(tmp_path / f"colour.{suffix}"), colour)
        ran = recorder("felics", "encode", tmp_path / f"colour.{suffix}", "-o", tmp_path / "out.felics")
        assert ran.code == 2
        assert "colour" in ran.problem
        assert "convert" in ran.problem


def test_a_value_above_the_depth_is_told_with_the_depth_that_holds_it(tmp_path: Path) -> None:
    source = write(tmp_path / "in.png", picture(10))
    ran = recorder("felics", "encode", source, "--bit-depth", "8", "-o", tmp_path / "out.felics", "--json")
    assert ran.code == 2
    assert "--bit-depth 10" in ran.json["error"]


def test_wrong_usage_is_one_line(tmp_path: Path, stream: Path) -> None:
    for arguments, word in (
        (("decode", stream, "-o", tmp_path / "one.png"), "folder"),
        (("decode", stream, "-o", tmp_path / "one.png", "--format", "npy"), "--format"),
        (("decode", stream, "-o", "-"), "standard output"),
        (("encode", stream, "-o", tmp_path / "x.felics"), "not an image"),
        (("encode", tmp_path / "none.png", "-o", tmp_path / "x.felics"), "no such file"),
        (("encode", tmp_path, "-o", tmp_path / "x.felics"), "*.png"),
        (("encode", stream, "-o", "-", "--json"), "--json"),
        (("info", tmp_path / "none"), "not there"),
        (("info", __file__), "no FELICS image"),
        (("decode", __file__), "no FELICS image"),
        (("salvage", __file__), "no FELICS image"),
        (("salvage", tmp_path), "not a file"),
    ):
        ran = recorder("felics", *arguments)
        assert ran.code == 2, (arguments, ran.out)
        assert word in ran.problem


def test_images_of_several_shapes_are_no_array(tmp_path: Path) -> None:
    path = tmp_path / "mixed.felics"
    path.write_bytes(encode(picture(10)) + encode(picture(10, height=9)))
    ran = recorder("felics", "decode", path, "-o", tmp_path / "all.npy")
    assert ran.code == 2
    assert "several shapes" in ran.problem
    assert not (tmp_path / "all.npy").exists()
    assert recorder("felics", "decode", path, "-o", tmp_path / "all").code == 0
    assert len(list((tmp_path / "all").iterdir())) == 2


def test_info_is_a_table_of_what_is_there(stream: Path) -> None:
    ran = recorder("felics", "info", stream)
    assert ran.code == 0
    assert "4 images" in ran.out
    assert "70 x 48" in ran.out
    assert "felics" in ran.out


def test_a_damaged_stream_is_not_decoded_but_salvaged(tmp_path: Path, stream: Path) -> None:
    whole = stream.read_bytes()
    places = list(walk(whole))
    data = bytearray(whole)
    data[places[1].stop - 100] ^= 4
    stream.write_bytes(data[:-10])
    for out in ("folder", "all.npy"):
        ran = recorder("felics", "decode", stream, "-o", tmp_path / out)
        assert ran.code == 1
        assert "recorder felics salvage" in ran.problem
        assert not (tmp_path / out).exists()
    good = tmp_path / "good.felics"
    ran = recorder("felics", "salvage", stream, "-o", good)
    assert ran.code == 1
    assert "2 intact images" in ran.out
    assert "cut off" in ran.out
    assert "lost in 2 places" in ran.problem
    assert good.read_bytes() == whole[places[0]] + whole[places[2]]
    told = recorder("felics", "salvage", stream, "--json").json
    assert [loss["offset"] for loss in told["losses"]] == [places[1].start, places[3].start]
    assert told["lost"]
    again = recorder("felics", "salvage", good)
    assert (again.code, again.err) == (0, "")
    assert recorder("felics", "decode", good, "-o", tmp_path / "good.npy").code == 0
    assert np.load(tmp_path / "good.npy").shape == (2, 48, 70)


def test_bytes_of_no_image_are_lost_in_a_stream_and_other_records_in_a_segment(
    tmp_path: Path, stream: Path
) -> None:
    source = tmp_path / "in.npy"
    np.save(source, np.stack([picture(10, seed) for seed in range(4)]))
    ran = recorder("record", source, "--out", tmp_path / "drives", "--rate", "10")
    assert ran.code == 0, ran.err
    segment = ran.drive / "0000.mcap"
    told = recorder("felics", "salvage", segment, "-o", tmp_path / "out.felics", "--json")
    assert told.code == 0, told.out
    assert (told.json["images"], told.json["losses"]) == (4, [])
    assert told.json["other_bytes"] + told.json["bytes"] == segment.stat().st_size
    assert recorder("felics", "decode", segment, "-o", tmp_path / "back.npy").code == 0
    assert np.array_equal(np.load(tmp_path / "back.npy"), np.load(source))
    stream.write_bytes(stream.read_bytes() + b"something else")
    ran = recorder("felics", "salvage", stream)
    assert ran.code == 1
    assert "14 B lost in 1 place" in ran.problem
    assert recorder("felics", "decode", stream).code == 1


def test_a_target_that_cannot_be_written_is_one_line(tmp_path: Path, stream: Path) -> None:
    (tmp_path / "file").write_text("")
    for out in (tmp_path / "file" / "x.felics", Path("/proc/x.felics")):
        ran = recorder("felics", "salvage", stream, "-o", out)
        assert ran.code == 1
        assert str(out) in ran.problem
    if os.path.exists("/dev/full"):  # noqa: PTH110
        script = f"{sys.executable} -m recorder felics salvage {stream} -o - > /dev/full"
        ran_shell = subprocess.run(script, shell=True, capture_output=True, text=True, check=False)
        assert ran_shell.returncode == 1
        assert "No space left" in ran_shell.stderr
        assert "Traceback" not in ran_shell.stderr
