"""Exported frames are the recorded ones, value for value."""

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from recorder import codec
from recorder.errors import StorageError, UsageError
from recorder.samples import Fix, NmeaSentence, Record, Stamp
from recorder.storage import Drive, export, open_drive
from tests.unit.drive_maker import OFFSET_NS, frame, frames, make_drive, pixels, raw_ns

IMAGE = "/camera/front/image"


@pytest.fixture(params=[8, 10])
def drive(request: pytest.FixtureRequest, tmp_path: Path) -> Drive:
    depth: int = request.param
    gnss: list[Record] = [
        NmeaSentence(Stamp(raw_ns=raw_ns(1)), b"$GPRMC,1*00\r\n"),
        Fix(Stamp(raw_ns=raw_ns(1), gps_ns=5), True, "A/A/1", 7, 0.9, 50.5, 8.5),
    ]
    return open_drive(make_drive(tmp_path / "drives", [*frames(6, bit_depth=depth), *gnss]))


def _expected(drive: Drive) -> list[np.ndarray]:
    depth = drive.frames("front")[0].bit_depth
    return [pixels(number, bit_depth=depth) for number in range(6)]


def test_felics(drive: Drive, tmp_path: Path) -> None:
    out = tmp_path / "new" / "front.felics"
    assert export(drive, IMAGE, "felics", out) == 6
    data = out.read_bytes()
    found = [codec.decode(data[part]) for part in codec.walk(data)]
    assert all(np.array_equal(a, b) for a, b in zip(found, _expected(drive), strict=True))


def test_png(drive: Drive, tmp_path: Path) -> None:
    out = tmp_path / "png"
    assert export(drive, IMAGE, "png", out) == 6
    depth = drive.frames("front")[0].bit_depth
    for number, expected in enumerate(_expected(drive)):
        image = cv2.imread(str(out / f"{number:09d}.png"), cv2.IMREAD_UNCHANGED)
        assert image is not None
        assert image.dtype == (np.uint8 if depth == 8 else np.uint16)
        assert np.array_equal(image, expected)


def test_npy(drive: Drive, tmp_path: Path) -> None:
    out = tmp_path / "npy"
    assert export(drive, IMAGE, "npy", out) == 6
    for number, expected in enumerate(_expected(drive)):
        image = np.load(out / f"{number:09d}.npy")
        assert image.dtype == np.uint16
        assert np.array_equal(image, expected)


@pytest.mark.parametrize("name", ["video.mkv", "video"])
def test_mkv(drive: Drive, tmp_path: Path, name: str) -> None:
    av = pytest.importorskip("av")
    assert export(drive, IMAGE, "mkv", tmp_path / name) == 6
    depth = drive.frames("front")[0].bit_depth
    with av.open(str(tmp_path / name)) as video:
        assert video.streams.video[0].codec_context.name == "ffv1"
        found = list(video.decode(video=0))
    assert {one.format.name for one in found} == {"gray" if depth == 8 else "gray16le"}
    images = [one.to_ndarray() for one in found]
    assert all(np.array_equal(a, b) for a, b in zip(images, _expected(drive), strict=True))


def test_csv_of_frames(drive: Drive, tmp_path: Path) -> None:
    out = tmp_path / "frames.csv"
    seen: list[tuple[int, int]] = []
    assert export(drive, IMAGE, "csv", out, lambda done, total: seen.append((done, total))) == 6
    assert seen[-1] == (6, 6)
    with out.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["id"]) for row in rows] == list(range(6))
    assert [int(row["log_time_ns"]) for row in rows] == [raw_ns(n) + OFFSET_NS for n in range(6)]
    assert [int(row["raw_ns"]) for row in rows] == [raw_ns(n) for n in range(6)]
    assert {row["device_ns"] for row in rows} == {""}
    assert rows[0]["exposure_us"] == "1500.5"
    depth = drive.frames("front")[0].bit_depth
    assert int(rows[2]["bytes"]) == len(frame(2, bit_depth=depth).data)


def test_csv_of_gnss(drive: Drive, tmp_path: Path) -> None:
    export(drive, "/gnss/fix", "csv", tmp_path / "fix.csv")
    export(drive, "/gnss/raw", "csv", tmp_path / "raw.csv")
    with (tmp_path / "fix.csv").open(newline="") as file:
        (fix,) = csv.DictReader(file)
    assert (fix["latitude_deg"], fix["valid"], fix["satellites"], fix["gps_ns"]) == ("50.5", "true", "7", "5")
    with (tmp_path / "raw.csv").open(newline="") as file:
        (raw,) = csv.DictReader(file)
    assert raw["data"] == "$GPRMC,1*00"


def test_requests_that_cannot_be(drive: Drive, tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "a").touch()
    (tmp_path / "there").write_text("mine")
    for topic, format_, out, words in [
        ("/nothing", "csv", "x", "no topic '/nothing'; topics here: /camera/front/image"),
        (IMAGE, "gif", "x", "no format 'gif'; choose one of felics"),
        ("/gnss/fix", "png", "x", "holds no frames"),
        (IMAGE, "felics", "there", "exists already"),
        (IMAGE, "png", "there", "is not a folder"),
        (IMAGE, "png", "full", "exists already"),
        (IMAGE, "mkv", "full", "is a folder"),
    ]:
        with pytest.raises(UsageError, match=words):
            export(drive, topic, format_, tmp_path / out)
    assert (tmp_path / "there").read_text() == "mine"


@pytest.mark.parametrize("format_", ["felics", "png", "npy", "csv", "mkv"])
def test_a_target_that_cannot_be_written(drive: Drive, tmp_path: Path, format_: str) -> None:
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(StorageError, match="not a folder"):
        export(drive, IMAGE, format_, file / "below" / "x")


def test_a_video_of_two_sizes_is_refused(tmp_path: Path) -> None:
    mixed = [frame(0), frame(1, bit_depth=8)]
    with pytest.raises(UsageError, match="frame 1 has another size or depth"):
        export(open_drive(make_drive(tmp_path / "d", mixed)), IMAGE, "mkv", tmp_path / "v.mkv")
