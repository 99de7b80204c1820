"""What users do wrong gets one line and the documented exit code, and loses nothing."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

import recorder as product
from tests.system.recorder_process import recorder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Twelve 10-bit images."""
    folder = tmp_path / "images"
    folder.mkdir()
    random = np.random.default_rng(1)
    for number in range(12):
        cv2.imwrite(str(folder / f"{number}.png"), random.integers(0, 1024, (48, 64)).astype(np.uint16))
    return folder


@pytest.fixture
def drive(folder: Path, tmp_path: Path) -> Path:
    ran = recorder("record", folder, "--out", tmp_path / "drives")
    assert ran.code == 0, ran.err
    return ran.drive


def test_help_names_every_command() -> None:
    ran = recorder("--help")
    assert ran.code == 0
    for command in ("demo", "run", "record", "inspect", "verify", "export", "status", "config", "felics"):
        assert command in ran.out


def test_an_unknown_option_is_usage() -> None:
    ran = recorder("inspect", "--bogus", "x")
    assert ran.code == 2
    assert "--bogus" in ran.problem


@pytest.mark.parametrize("source", ["/nowhere/ride.mp4", "/dev/ttyNOWHERE"])
def test_no_such_source(tmp_path: Path, source: str) -> None:
    ran = recorder("record", source, "--out", tmp_path / "drives")
    assert ran.code == 2
    assert source in ran.problem
    assert not list((tmp_path / "drives").glob("*"))


def test_an_empty_folder_an_empty_log_and_a_text_file(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty.log").write_text("")
    (tmp_path / "text.mp4").write_text("not a film")
    for arguments in (
        [tmp_path / "empty"],
        [tmp_path / "text.mp4"],
        [folder, "--nmea", tmp_path / "empty.log"],
        [folder, "--nmea", tmp_path / "text.mp4"],
    ):
        ran = recorder("record", *arguments, "--out", tmp_path / "drives")
        assert ran.code == 2, ran.err
        assert str(tmp_path) in ran.problem
    assert not list((tmp_path / "drives").glob("*"))


def test_a_file_cut_short_keeps_what_is_whole_and_says_so(folder: Path, tmp_path: Path) -> None:
    image = folder / "5.png"
    image.write_bytes(image.read_bytes()[:200])
    ran = recorder("record", folder, "--out", tmp_path / "drives")
    assert ran.code == 1
    assert "5.png" in ran.problem
    verified = recorder("verify", ran.drive, "--json")
    assert verified.code == 0, verified.out
    assert verified.json["frames"] == 11
    assert recorder("inspect", ran.drive, "--json").json["topics"]["/camera/front/image"]["gaps"] == 1


def test_a_target_that_is_a_file_or_read_only(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    ran = recorder("record", folder, "--out", tmp_path / "file")
    assert ran.code == 1
    assert str(tmp_path / "file") in ran.problem
    if os.geteuid() != 0:  # root may write anywhere
        (tmp_path / "locked").mkdir(mode=0o500)
        ran = recorder("record", folder, "--out", tmp_path / "locked")
        assert ran.code == 1
    ran = recorder("record", folder, "--out", "/proc/recorder")
    assert ran.code == 1
    assert "/proc" in ran.problem


def test_json_is_one_object_also_for_an_error(tmp_path: Path) -> None:
    ran = recorder("verify", tmp_path, "--json")
    assert ran.code == 2
    assert "error" in ran.json


def test_what_is_no_drive_is_refused(tmp_path: Path) -> None:
    (tmp_path / "some.mcap").write_bytes(b"nonsense")
    for path in (tmp_path / "none", tmp_path, tmp_path / "some.mcap"):
        for command in ("inspect", "verify"):
            ran = recorder(command, path)
            assert ran.code == 2, (path, ran.out)
            assert str(path) in ran.problem


def test_a_truncated_segment_is_damaged_but_read_as_far_as_it_goes(drive: Path) -> None:
    segment = drive / "0000.mcap"
    whole = segment.read_bytes()
    segment.write_bytes(whole[: len(whole) * 2 // 3])
    ran = recorder("verify", drive, "--json")
    assert ran.code == 1
    assert not ran.json["ok"]
    assert 0 < ran.json["frames"] < 12
    assert recorder("inspect", drive).code == 0
    with product.open_drive(drive) as opened:
        assert len(opened.frames("front")) == ran.json["frames"]


def test_a_flipped_byte_in_an_image_is_found(drive: Path) -> None:
    segment = drive / "0000.mcap"
    data = bytearray(segment.read_bytes())
    place = data.index(b"\xff\xe8") + 500
    data[place] ^= 0x10
    segment.write_bytes(data)
    ran = recorder("verify", drive, "--json")
    assert ran.code == 1
    assert ran.json["damaged"] >= 1


def test_a_missing_segment_is_found(folder: Path, tmp_path: Path) -> None:
    times = tmp_path / "times.csv"
    times.write_text("time_s\n" + "".join(f"{n * 10}\n" for n in range(12)))
    ran = recorder("record", folder, "--out", tmp_path / "drives", "--times", times)
    assert ran.code == 0, ran.err
    segments = sorted(ran.drive.glob("*.mcap"))
    assert len(segments) == 2
    shutil.move(segments[-1], tmp_path / "away.mcap")
    verified = recorder("verify", ran.drive, "--json")
    assert verified.code == 1
    assert "0001.mcap" in " ".join(verified.json["problems"])


def test_exports_that_cannot_be_done(drive: Path, tmp_path: Path) -> None:
    ran = recorder("export", drive, "--topic", "/nope", "--format", "csv", "--out", tmp_path / "x.csv")
    assert ran.code == 2
    assert "/camera/front/image" in ran.problem
    ran = recorder("export", drive, "--topic", "/clock/pairs", "--format", "png", "--out", tmp_path / "x")
    assert ran.code == 2
    ran = recorder("export", drive, "--topic", "/clock/pairs", "--format", "gif", "--out", tmp_path / "x")
    assert ran.code == 2


@pytest.mark.parametrize(("form", "target"), [("png", "x"), ("npy", "x"), ("csv", "x.csv"), ("mkv", "x.mkv")])
def test_every_export_is_made(drive: Path, tmp_path: Path, form: str, target: str) -> None:
    out = tmp_path / "exported" / target
    out.parent.mkdir()
    ran = recorder("export", drive, "--topic", "/camera/front/image", "--format", form, "--out", out)
    assert ran.code == 0, ran.err
    assert out.exists()


def test_config_check(tmp_path: Path) -> None:
    file = tmp_path / "recorder.toml"
    file.write_text('[drivers.camera.front]\nsource = "genicam://"\n')
    assert recorder("config", "check", file).code == 0
    file.write_text('[drivers.camera.front]\nsource = "genicam://"\nexposure = 3\n')
    ran = recorder("config", "check", file)
    assert ran.code == 2
    assert "drivers.camera.front.exposure" in ran.problem


def test_status_of_nothing_is_not_running(tmp_path: Path) -> None:
    ran = recorder("status", "--socket", tmp_path / "none.sock")
    assert ran.code == 3
    assert "recorder run" in ran.problem


def test_the_drives_name_counts_up(folder: Path, tmp_path: Path) -> None:
    names = [recorder("record", folder, "--out", tmp_path / "drives").drive.name for _ in range(2)]
    assert [re.match(r"(\d{4})(-\d{8}T\d{6}Z)?$", name)[1] for name in names] == ["0001", "0002"]  # type: ignore[index]


def test_one_bad_file_does_not_end_the_others(folder: Path, tmp_path: Path) -> None:
    bad = shutil.copytree(folder, tmp_path / "bad")
    (bad / "2.png").write_bytes((bad / "2.png").read_bytes()[:150])
    ran = recorder("record", bad, folder, "--out", tmp_path / "drives")
    assert ran.code == 1
    assert "2.png" in ran.err
    topics = recorder("inspect", ran.drive, "--json").json["topics"]
    assert topics["/camera/front/image"]["messages"] == 11
    assert topics["/camera/front/image"]["gaps"] == 1
    assert topics["/camera/tag/image"]["messages"] == 12


def test_a_video_of_odd_size_is_refused_not_cropped_and_no_neighbour_is_touched(tmp_path: Path) -> None:
    folder = tmp_path / "odd"
    folder.mkdir()
    for number in range(3):
        cv2.imwrite(str(folder / f"{number}.png"), np.full((37, 53), number, np.uint8))
    (tmp_path / "ride.mkv").write_text("mine")
    drive = recorder("record", folder, "--out", tmp_path / "drives").drive
    ran = recorder(
        "export", drive, "--topic", "/camera/front/image", "--format", "mkv", "--out", tmp_path / "ride"
    )
    assert ran.code == 2
    assert "53x37" in ran.problem
    assert (tmp_path / "ride.mkv").read_text() == "mine"
    assert not (tmp_path / "ride").exists()


def test_a_container_whose_end_cannot_be_told_is_refused(tmp_path: Path) -> None:
    (tmp_path / "ride.ts").write_bytes((b"\x47" + bytes(187)) * 500)
    ran = recorder("record", tmp_path / "ride.ts", "--out", tmp_path / "drives")
    assert ran.code == 2
    assert "ride.ts" in ran.problem


def test_a_path_that_is_not_utf8_is_refused(tmp_path: Path) -> None:
    command: list[str | bytes] = [
        sys.executable,
        "-m",
        "recorder",
        "record",
        b"b\xff.mp4",
        "--out",
        str(tmp_path),
    ]
    done = subprocess.run(command, capture_output=True, check=False)
    assert done.returncode == 2
    assert b"not UTF-8" in done.stderr


@pytest.mark.parametrize("output", ["/dev/full", None])
def test_output_that_cannot_be_written_is_one_line(drive: Path, output: str | None) -> None:
    shell = f"exec {sys.executable} -m recorder inspect {drive} >{output or '&-'}"
    done = subprocess.run(["sh", "-c", shell], capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr
    assert done.returncode == (1 if output else 0)
    assert len(done.stderr.strip().splitlines()) == (1 if output else 0)


def test_a_terminal_without_these_letters_gets_others(drive: Path) -> None:
    command = [sys.executable, "-m", "recorder", "inspect", str(drive)]
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("seconds", ["0", "-1", "nan", "inf", "1e300"])
def test_absurd_durations_are_refused(folder: Path, tmp_path: Path, seconds: str) -> None:
    ran = recorder("record", folder, "--out", tmp_path / "drives", "--seconds", seconds)
    assert ran.code == 2, ran.out
    assert not (tmp_path / "drives").exists()


def test_a_setting_that_a_file_cannot_have_is_refused(folder: Path, tmp_path: Path) -> None:
    ran = recorder("record", folder, "--out", tmp_path / "drives", "--exposure", "5")
    assert ran.code == 2
    assert "exposure_us" in ran.problem


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    ran = recorder("record", tmp_path / "pipe", "--out", tmp_path / "drives", timeout=20)
    assert ran.code == 2
    assert "neither a file nor a folder" in ran.problem
