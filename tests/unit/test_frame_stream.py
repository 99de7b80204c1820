"""Images in a file, each at hand by its number, whatever stands between them."""

import os
import pickle
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from numpy.typing import NDArray

from recorder.codec import FrameStream, encode, salvage
from recorder.codec.stream_file import StreamFile
from recorder.errors import CodecError, StorageError, UsageError
from tests.unit.stream_pieces import intact_in, streams


def noise(seed: int, height: int = 40, width: int = 50) -> NDArray[np.uint16]:
    return np.random.default_rng(seed).normal(500, 9, (height, width)).astype(np.uint16)


@pytest.fixture
def pictures() -> list[NDArray[np.uint16]]:
    return [noise(seed, 20 + 3 * seed, 31 + seed) for seed in range(7)]


@pytest.fixture
def stream(tmp_path: Path, pictures: list[NDArray[np.uint16]]) -> Path:
    path = tmp_path / "stream.felics"
    path.write_bytes(b"".join(encode(picture) for picture in pictures))
    return path


def test_frames_of_any_shape_come_in_order_and_by_number(
    stream: Path, pictures: list[NDArray[np.uint16]]
) -> None:
    with FrameStream(stream) as frames:
        assert len(frames) == len(pictures)
        for number, (frame, picture) in enumerate(zip(frames, pictures, strict=True)):
            assert np.array_equal(frame.pixels, picture)
            assert (frame.header.height, frame.header.width) == picture.shape
            again = frames[number]
            assert (again.offset, again.data, again.header) == (frame.offset, frame.data, frame.header)
            assert frames[number - len(pictures)].offset == frame.offset
        for index in (len(pictures), -len(pictures) - 1):
            with pytest.raises(IndexError):
                frames[index]
        assert frames.offsets == [frame.offset for frame in frames]
        assert frames.sizes == [len(frame.data) for frame in frames]
        assert sum(frames.sizes) == frames.size == stream.stat().st_size


def test_slices_are_views(stream: Path) -> None:
    with FrameStream(stream) as frames:
        offsets = frames.offsets
        for part in (slice(2, 5), slice(None, None, -1), slice(-3, None), slice(9, 12)):
            assert frames[part].offsets == offsets[part]
            assert [frame.offset for frame in frames[part]] == offsets[part]
        assert frames[1:][0].offset == frames[1].offset


def test_pickles_by_path_and_keeps_its_index(stream: Path) -> None:
    with FrameStream(stream) as frames:
        with stream.open("ab") as file:
            file.write(encode(noise(99)))
        with pickle.loads(pickle.dumps(frames)) as again, pickle.loads(pickle.dumps(frames[2:4])) as part:
            assert again.offsets == frames.offsets
            assert again[3].data == frames[3].data
            assert part.offsets == frames.offsets[2:4]
    with FrameStream(stream) as frames:
        assert len(frames) == 8


def test_a_closed_stream_reads_no_more_and_frames_stay(stream: Path) -> None:
    frames = FrameStream(stream)
    frame = frames[0]
    frames.close()
    frames.close()
    assert frame.pixels.shape == (20, 31)
    with pytest.raises(ValueError, match="closed"):
        frames[0]


def test_a_file_that_shrinks_is_an_error_and_no_signal(stream: Path) -> None:
    with FrameStream(stream) as frames:
        os.truncate(stream, frames.offsets[3] + 100)
        assert frames[2].pixels.shape == (26, 33)
        for number in (3, 4, -1):
            with pytest.raises(CodecError, match="cut off since it was opened"):
                frames[number]


def test_a_file_that_is_overwritten_is_noticed(stream: Path) -> None:
    with FrameStream(stream) as frames:
        with stream.open("r+b") as file:
            file.seek(frames.offsets[1] + 10)
            file.write(b"other")
        with pytest.raises(CodecError):
            frames[1]


def test_a_damaged_body_is_listed_and_raises_when_it_is_decoded(stream: Path) -> None:
    data = bytearray(stream.read_bytes())
    with FrameStream(stream) as frames:
        data[frames.offsets[4] - 300] ^= 0x10
    stream.write_bytes(data)
    with FrameStream(stream) as frames:
        assert len(frames) == 7
        with pytest.raises(CodecError):
            _ = frames[3].pixels
        assert frames[4].pixels.shape == (32, 35)


@pytest.mark.parametrize("content", [b"", b"\xff", b"\xff\xe8", b"\xff\xe9\xff\xe8", bytes(1000)])
def test_a_file_without_images_is_empty(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "none"
    path.write_bytes(content)
    with FrameStream(path) as frames:
        assert len(frames) == 0
        assert list(frames) == []


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "none", tmp_path / "pipe"):
        for opening in (FrameStream, lambda path: list(salvage(path))):
            with pytest.raises(UsageError, match=r"not a file|not there") as caught:
                opening(path)
            assert str(path) in str(caught.value)


def test_a_disk_that_fails_is_told_with_its_place(stream: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with FrameStream(stream) as frames:

        def fail(*_: object) -> bytes:
            raise OSError(5, "Input/output error")

        monkeypatch.setattr(os, "pread", fail)
        with pytest.raises(StorageError, match=f"byte {frames.offsets[2]} .*Input/output error"):
            frames[2]


@pytest.mark.parametrize("piece", [2, 3, 5, 64])
def test_markers_across_two_reads_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, piece: int
) -> None:
    data = b"\xff\xff\xe8.\xff\xe9\xff\xe8\xff\xe8" + 61 * b"." + b"\xff\xe9\xff"
    path = tmp_path / "stream"
    path.write_bytes(data)
    monkeypatch.setattr("recorder.codec.stream_file._PIECE", piece)
    file = StreamFile(path)
    found = [(marker.offset, marker.is_end) for marker in file.markers()]
    file.close()
    places = [at for at in range(len(data)) if data[at : at + 2] in (b"\xff\xe8", b"\xff\xe9")]
    assert found == [(at, data[at + 1] == 0xE9) for at in places]


@settings(max_examples=300)
@given(data=streams)
def test_every_whole_image_is_listed_and_no_other_decodes(
    data: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "listed.felics"
    path.write_bytes(data)
    intact = []
    with FrameStream(path) as frames:
        for frame in frames:
            assert data[frame.offset : frame.offset + len(frame.data)] == frame.data
            with suppress(CodecError):
                assert frame.pixels.size
                intact.append((frame.offset, frame.data))
    assert intact == intact_in(data)
