"""Every real image at hand, there and back in every model; and a reader that shares no code with ours."""

import re
import struct
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import imagecodecs
import numpy as np
import pydicom
import pytest
from numpy.typing import NDArray
from pydicom.encaps import generate_frames

from recorder.codec import FrameStream, Model, decode, encode, model_at, read_header, salvage
from recorder.codec.salvage import Gap
from tests.system.recorder_process import recorder

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
FOLDERS = ("imaging", "stills", "vo", "apriltag", "calibration")
PICTURES = (".png", ".pgm", ".ppm", ".tif", ".jpg")
COMPONENTS_OF_SEVERAL_SIZES = ("t8sse0.jls", "t8sse3.jls")
"""JPEG-LS that CharLS refuses."""
CAB_RIDE_FRAMES = 480

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"real data is not there: {DATA}")


def files(folder: str) -> list[Path]:
    return sorted(path for path in (DATA / folder).rglob("*") if path.suffix in (*PICTURES, ".jls", ".dcm"))


def arrays(path: Path) -> list[NDArray[Any]]:
    """The file's images as a peer decodes them, colour and all."""
    if path.suffix == ".jls":
        return [imagecodecs.jpegls_decode(path.read_bytes())]
    if path.suffix == ".dcm":
        dataset = pydicom.dcmread(path)
        syntax = dataset.file_meta.TransferSyntaxUID.name
        if "JPEG" in syntax:
            peer = imagecodecs.jpeg2k_decode if "2000" in syntax else imagecodecs.jpegls_decode
            return [peer(frame) for frame in generate_frames(dataset.PixelData, number_of_frames=1)]
        return [dataset.pixel_array]
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None, path
    return [np.asarray(image)]


def planes(array: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Every channel of every image, wide values in halves, signed ones by their bits."""
    if array.dtype.itemsize == 4:
        array = array.view(np.uint16)
    array = array.view(np.dtype(f"u{array.dtype.itemsize}"))
    if array.ndim == 2:
        yield array
    elif array.shape[2] <= 4:
        yield from (array[:, :, channel] for channel in range(array.shape[2]))
    else:
        yield from array


def round_trips(plane: NDArray[Any]) -> int:
    """Encode and decode at the depth of the type and at that of the values, in every model there is."""
    count = 0
    for depth in {8 * plane.dtype.itemsize, max(1, int(plane.max()).bit_length())}:
        models: tuple[Model, ...] = ("raw", "felics", "felics-ls")
        for model in dict.fromkeys(model_at(depth, model) for model in models):
            data = encode(plane, bit_depth=depth, model=model)
            assert read_header(data).model in (model, "raw")
            assert np.array_equal(decode(data), plane), (model, depth)
            count += 1
    return count


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_image_round_trips_in_every_model(folder: str) -> None:
    found = [path for path in files(folder) if path.name not in COMPONENTS_OF_SEVERAL_SIZES]
    assert len(found) >= 3
    for path in found:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # what pydicom thinks of old headers
            images = arrays(path)
        assert images, path
        for array in images:
            assert sum(round_trips(plane) for plane in planes(array)) >= 2, path


def test_ours_and_the_peers_agree_on_the_same_picture() -> None:
    folder = DATA / "imaging" / "charls"
    for lossless, original in (
        ("tulips-gray-8bit-512-512-hp-encoder.jls", "tulips-gray-8bit-512-512.pgm"),
        ("conformance/t8nde0.jls", "conformance/test8bs2.pgm"),
    ):
        expected = imagecodecs.jpegls_decode((folder / lossless).read_bytes())
        (read,) = arrays(folder / original)
        assert np.array_equal(decode(encode(read, bit_depth=8)), expected)


@pytest.fixture(scope="module")
def cab_ride() -> list[NDArray[Any]]:
    path = DATA / "cab-ride" / "cab-ride.mp4"
    if not path.is_file():
        pytest.skip(f"real data is not there: {path}")
    capture = cv2.VideoCapture(str(path))
    frames = []
    while (taken := capture.read())[0]:
        frames.append(cv2.cvtColor(taken[1], cv2.COLOR_BGR2GRAY))
    capture.release()
    assert len(frames) == CAB_RIDE_FRAMES
    return frames


def test_every_frame_of_the_cab_ride_round_trips_in_every_model(cab_ride: list[NDArray[Any]]) -> None:
    for frame in cab_ride:
        for model in ("raw", "felics", "felics-ls"):
            assert np.array_equal(decode(encode(frame, bit_depth=8, model=model)), frame)


def scan(data: bytes) -> list[tuple[int, int, int, int, int]]:
    """Offset, size, width, height and bits of each image, by docs/felics.md and nothing of ours."""
    found = []
    for place in re.finditer(rb"\xff\xe8((?:[^\xff]++|\xff\x00)*+)\xff\xe9", data):
        body = place[1].replace(b"\xff\x00", b"\xff")
        if len(body) < 20:
            continue
        version, model, bits, _, width, height, streams, _, table = struct.unpack_from("<BBBBIIHIH", body)
        size = 20 + table + 4 * streams
        if version != 1 or model > 2 or len(body) < size + 4:
            continue
        crc = 0xFFFFFFFF
        for byte in body[:size]:
            crc ^= byte
            for _ in range(8):
                crc = crc >> 1 ^ (0x82F63B78 if crc & 1 else 0)
        lengths = struct.unpack_from(f"<{streams}I", body, 20 + table)
        if struct.unpack_from("<I", body, size)[0] == crc ^ 0xFFFFFFFF and size + 4 + sum(lengths) == len(
            body
        ):
            found.append((place.start(), place.end() - place.start(), width, height, bits))
    return found


def listed(path: Path) -> list[tuple[int, int, int, int, int]]:
    with FrameStream(path) as frames:
        heads = [(frame.offset, len(frame.data), frame.header) for frame in frames]
    return [(offset, size, head.width, head.height, head.bit_depth) for offset, size, head in heads]


def test_an_independent_scanner_walks_the_recorded_cab_ride(
    tmp_path: Path, cab_ride: list[NDArray[Any]]
) -> None:
    ran = recorder("record", DATA / "cab-ride" / "cab-ride.mp4", "--out", tmp_path)
    assert ran.code == 0, ran.err
    height, width = cab_ride[0].shape
    seen = 0
    for segment in sorted(ran.drive.glob("*.mcap")):
        found = scan(segment.read_bytes())
        assert found == listed(segment)
        assert {what[2:] for what in found} == {(width, height, 8)}
        with FrameStream(segment) as frames:
            for frame in frames[::40]:
                assert np.array_equal(frame.pixels, cab_ride[seen + frames.offsets.index(frame.offset)])
        assert not any(isinstance(piece, Gap) and piece.error for piece in salvage(segment))
        seen += len(found)
    assert seen == CAB_RIDE_FRAMES


def test_an_independent_scanner_walks_an_encoded_stream_also_when_it_is_damaged(
    tmp_path: Path, cab_ride: list[NDArray[Any]]
) -> None:
    images = [encode(frame, bit_depth=8) for frame in cab_ride[:40]]
    path = tmp_path / "ride.felics"
    data = bytearray(b"".join(images))
    path.write_bytes(data)
    assert scan(bytes(data)) == listed(path)
    assert len(listed(path)) == 40
    start = sum(map(len, images[:10]))
    data[start + 100] ^= 0x20  # a header
    data[start + len(images[10]) : start + len(images[10]) + 5000] = b""  # the beginning of another
    del data[-3:]  # the last end
    path.write_bytes(data)
    assert scan(bytes(data)) == listed(path)
    assert len(listed(path)) == 37
