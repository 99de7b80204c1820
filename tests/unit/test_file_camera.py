"""The file camera: what it plays, when, and what it says of what it cannot play."""

import os
import struct
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from recorder.config import CameraSection
from recorder.drivers.file_camera import FileCamera
from recorder.errors import DeviceLost, SourceError
from recorder.samples import Frame, Loss, LossCause, Sample

FRAMES = 40


class FakeClock:
    """Time passes only while somebody sleeps."""

    def __init__(self, raw_ns: int = 1_000_000_000) -> None:
        self.now = raw_ns
        self.sleeps: list[float] = []

    def raw_ns(self) -> int:
        return self.now

    monotonic_ns = realtime_ns = boottime_ns = raw_ns

    def sleep(self, seconds: float) -> None:
        self.sleeps.append(seconds)
        self.now += round(seconds * 1e9)


def camera(source: Path, *, origin: int | None = 5_000, **settings: object) -> FileCamera:
    section = CameraSection.model_validate({"source": str(source), "realtime": False, **settings})
    return FileCamera("front", section, origin_raw_ns=origin)


def play(driver: FileCamera) -> tuple[list[Frame], list[Loss], str]:
    """All frames, all losses, and the error at the end."""
    samples: list[Sample | None] = []
    error = ""
    driver.open()
    try:
        samples.extend(driver.samples())
    except DeviceLost as lost:
        error = str(lost)
    except BaseException:
        driver.close()
        raise
    driver.close()
    return [s for s in samples if isinstance(s, Frame)], [s for s in samples if isinstance(s, Loss)], error


def picture(index: int) -> NDArray[np.uint8]:
    noise = np.random.default_rng(index).integers(0, 255, (96, 128, 3), dtype=np.uint8)
    image = cv2.GaussianBlur(noise, (0, 0), 2)
    cv2.putText(image, str(index), (10, 60), 0, 1, (255, 255, 255), 2)
    return np.asarray(image, np.uint8)


def write_video(path: Path, code: str, frames: int = FRAMES) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*code), 25, (128, 96))
    assert writer.isOpened(), "this OpenCV writes no such video"
    for index in range(frames):
        writer.write(picture(index))
    writer.release()
    return path


def plain_frames(path: Path) -> list[NDArray[np.uint16]]:
    """What a plain cv2.VideoCapture makes of it."""
    capture = cv2.VideoCapture(str(path))
    found: list[NDArray[np.uint16]] = []
    while True:
        good, image = capture.read()
        if not good:
            capture.release()
            return found
        found.append(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.uint16))


def index_first(data: bytes) -> bytes:
    """The same MP4 with its index in front, as files that are streamed have it."""
    boxes = []
    position = 0
    while position < len(data):
        (length,) = struct.unpack_from(">I", data, position)
        boxes.append(data[position : position + length])
        position += length
    moov = bytearray(next(box for box in boxes if box[4:8] == b"moov"))
    at = moov.find(b"stco") + 8
    for entry in range(struct.unpack_from(">I", moov, at)[0]):
        place = at + 4 + 4 * entry
        struct.pack_into(">I", moov, place, struct.unpack_from(">I", moov, place)[0] + len(moov))
    return boxes[0] + bytes(moov) + b"".join(box for box in boxes[1:] if box[4:8] != b"moov")


@pytest.fixture(
    scope="module", params=["mp4v.mp4", "mp4v.mov", "MJPG.avi", "XVID.avi", "MJPG.mkv", "FFV1.mkv"]
)
def video(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One intact video of each common container."""
    code, container = request.param.split(".")
    path = write_video(tmp_path_factory.mktemp("video") / f"whole.{container}", code)
    if container in ("mp4", "mov"):
        path.write_bytes(index_first(path.read_bytes()))
    return path


class TestWholeVideo:
    def test_frames_are_those_of_opencv(self, video: Path) -> None:
        frames, losses, error = play(camera(video))
        assert (losses, error) == ([], "")
        assert [frame.id for frame in frames] == list(range(FRAMES))
        for frame, expected in zip(frames, plain_frames(video), strict=True):
            assert frame.bit_depth == 8
            assert frame.pixels.dtype == np.uint16
            np.testing.assert_array_equal(frame.pixels, expected)

    def test_times_are_the_containers(self, video: Path) -> None:
        frames, _, _ = play(camera(video, origin=7_000))
        assert [frame.stamp.device_ns for frame in frames] == [40_000_000 * i for i in range(FRAMES)]
        assert [frame.stamp.raw_ns for frame in frames] == [7_000 + 40_000_000 * i for i in range(FRAMES)]
        assert {frame.stamp.realtime_ns for frame in frames} == {None}

    def test_it_can_be_played_again(self, video: Path) -> None:
        driver = camera(video)
        first, _, _ = play(driver)
        second, _, _ = play(driver)
        assert [a.pixels.tobytes() for a in first] == [b.pixels.tobytes() for b in second]

    def test_describe(self, video: Path) -> None:
        driver = camera(video)
        driver.open()
        told = driver.describe()
        driver.close()
        driver.close()
        assert told["kind"] == "video file"
        assert told["size"] == "128x96"


class TestCutVideo:
    def test_every_frame_is_whole_or_stated_lost(self, video: Path, tmp_path: Path) -> None:
        whole = plain_frames(video)
        data = video.read_bytes()
        path = tmp_path / video.name
        for share in (0.4, 0.55, 0.7, 0.8, 0.9):
            path.write_bytes(data[: int(len(data) * share)])
            frames, losses, error = play(camera(path))
            assert 0 < len(frames) < FRAMES
            for frame in frames:
                np.testing.assert_array_equal(frame.pixels, whole[frame.id])
            accounted = [frame.id for frame in frames]
            for loss in losses:
                assert (loss.stream, loss.cause) == ("/camera/front/image", LossCause.DEVICE)
                accounted.extend(range(loss.first_id, loss.last_id + 1))
            assert sorted(accounted) == list(range(FRAMES))
            assert "file ends early" in error
            assert str(path) in error

    def test_the_decoder_is_silent(self, video: Path, tmp_path: Path) -> None:
        # In a process of its own: OpenCV reads FFmpeg's log level once, at the first capture.
        path = tmp_path / video.name
        path.write_bytes(video.read_bytes()[:-8000])
        script = (
            "import sys; from recorder.config import CameraSection as S\n"
            "from recorder.drivers.file_camera import FileCamera\n"
            "camera = FileCamera('front', S(source=sys.argv[1], realtime=False)); camera.open()\n"
            "try: list(camera.samples())\n"
            "finally: camera.close()\n"
        )
        done = subprocess.run(
            [sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=False, timeout=60
        )
        assert "DeviceLost" in done.stderr
        assert "@ 0x" not in done.stderr
        assert "WARN" not in done.stderr

    def test_index_at_the_end_is_gone(self, tmp_path: Path) -> None:
        path = write_video(tmp_path / "a.mp4", "mp4v", 10)
        path.write_bytes(path.read_bytes()[:-600])
        with pytest.raises(SourceError, match="ends before its index"):
            camera(path).open()

    def test_environment_is_left_as_it_was(self, video: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("OPENCV_FFMPEG_CAPTURE_OPTIONS", "threads;1")
        before = dict(os.environ)
        play(camera(video))
        assert dict(os.environ) == before


class TestImages:
    def folder(self, path: Path, images: Mapping[str, NDArray[Any]]) -> Path:
        path.mkdir()
        for name, image in images.items():
            assert cv2.imwrite(str(path / name), image)
        return path

    def test_order_is_that_of_the_numbers(self, tmp_path: Path) -> None:
        images = {f"frame_{n}.png": np.full((4, 6), n, np.uint8) for n in (10, 9, 100, 1)}
        path = self.folder(tmp_path / "f", images)
        (path / "notes.txt").write_text("not an image")
        (path / ".hidden.png").write_bytes(b"")
        frames, losses, _ = play(camera(path))
        assert [int(frame.pixels[0, 0]) for frame in frames] == [1, 9, 10, 100]
        assert losses == []
        assert [frame.stamp.raw_ns for frame in frames] == [5_000 + 40_000_000 * n for n in range(4)]

    @pytest.mark.parametrize("suffix", ["png", "bmp", "pgm", "tif"])
    def test_eight_bits_stay_eight(self, tmp_path: Path, suffix: str) -> None:
        image = np.arange(24, dtype=np.uint8).reshape(4, 6)
        frames, _, _ = play(camera(self.folder(tmp_path / "f", {f"0.{suffix}": image})))
        assert frames[0].bit_depth == 8
        np.testing.assert_array_equal(frames[0].pixels, image)

    @pytest.mark.parametrize(
        ("largest", "depth"), [(3, 10), (1023, 10), (1024, 12), (16383, 14), (65535, 16)]
    )
    @pytest.mark.parametrize("suffix", ["png", "pgm", "tif"])
    def test_depth_holds_the_largest_value(
        self, tmp_path: Path, suffix: str, largest: int, depth: int
    ) -> None:
        image = np.full((4, 6), largest, np.uint16)
        frames, _, _ = play(camera(self.folder(tmp_path / "f", {f"0.{suffix}": image})))
        assert frames[0].bit_depth == depth
        np.testing.assert_array_equal(frames[0].pixels, image)

    def test_first_image_sets_the_depth_and_a_later_one_may_exceed_it(self, tmp_path: Path) -> None:
        values = {"0.png": 3000, "1.png": 500, "2.png": 9000, "3.png": 500}
        images = {name: np.full((4, 6), value, np.uint16) for name, value in values.items()}
        frames, _, _ = play(camera(self.folder(tmp_path / "f", images)))
        assert [frame.bit_depth for frame in frames] == [12, 12, 14, 12]

    def test_colour_becomes_grey(self, tmp_path: Path) -> None:
        image = picture(3)
        frames, _, _ = play(camera(self.folder(tmp_path / "f", {"0.png": image})))
        np.testing.assert_array_equal(frames[0].pixels, cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))

    def test_one_image_is_a_folder_of_one(self, tmp_path: Path) -> None:
        path = self.folder(tmp_path / "f", {"0.png": np.full((4, 6), 999, np.uint16)})
        frames, _, _ = play(camera(path / "0.png"))
        assert (len(frames), frames[0].bit_depth) == (1, 10)

    @pytest.mark.parametrize("suffix", ["png", "jpg", "bmp", "pgm", "tif"])
    def test_a_damaged_image_is_stated_and_the_rest_goes_on(self, tmp_path: Path, suffix: str) -> None:
        path = self.folder(tmp_path / "f", {f"{n}.{suffix}": picture(n)[:, :, 0] for n in range(5)})
        broken = path / f"2.{suffix}"
        broken.write_bytes(broken.read_bytes()[:-100])
        frames, losses, error = play(camera(path))
        assert [frame.id for frame in frames] == [0, 1, 3, 4]
        assert [(loss.first_id, loss.last_id, loss.cause) for loss in losses] == [(2, 2, LossCause.DEVICE)]
        assert broken.name in losses[0].detail
        assert "1 of 5 images" in error

    def test_unreadable_and_odd_images(self, tmp_path: Path) -> None:
        path = self.folder(tmp_path / "f", {"1.tif": np.zeros((4, 6), np.float32)})
        (path / "0.png").write_bytes(b"")
        frames, losses, error = play(camera(path))
        assert frames == []
        assert losses[0].detail == "0.png: an empty file"
        assert "float32" in losses[1].detail
        assert "2 of 2" in error


class TestStack:
    @pytest.mark.parametrize(
        ("dtype", "depth"), [(np.dtype(np.uint8), 8), (np.dtype("<u2"), 10), (np.dtype(">u2"), 10)]
    )
    def test_stack(self, tmp_path: Path, dtype: np.dtype[np.generic], depth: int) -> None:
        stack = np.arange(60).reshape(3, 4, 5).astype(dtype)
        np.save(tmp_path / "s.npy", stack)
        frames, losses, _ = play(camera(tmp_path / "s.npy", rate_hz=59.82))
        assert losses == []
        np.testing.assert_array_equal([frame.pixels for frame in frames], stack)
        assert {frame.bit_depth for frame in frames} == {depth}
        # index times 50/2991 s, in whole nanoseconds
        assert [frame.stamp.device_ns for frame in frames] == [0, 16_716_817, 33_433_634]

    def test_cut_stack(self, tmp_path: Path) -> None:
        path = tmp_path / "s.npy"
        np.save(path, np.ones((5, 4, 6), np.uint16))
        path.write_bytes(path.read_bytes()[:-60])
        frames, losses, error = play(camera(path))
        assert [frame.id for frame in frames] == [0, 1, 2]
        assert [(loss.first_id, loss.last_id) for loss in losses] == [(3, 4)]
        assert "file ends early: 2 of 5" in error

    @pytest.mark.parametrize(
        "array", [np.zeros((4, 5), np.uint8), np.zeros((2, 4, 5), np.float32), np.zeros((0, 4, 5), np.uint8)]
    )
    def test_not_a_stack(self, tmp_path: Path, array: NDArray[np.generic]) -> None:
        np.save(tmp_path / "s.npy", array)
        with pytest.raises(SourceError, match="uint8 or uint16"):
            camera(tmp_path / "s.npy").open()

    def test_not_numpy(self, tmp_path: Path) -> None:
        (tmp_path / "s.npy").write_bytes(b"hello")
        with pytest.raises(SourceError, match="not a NumPy file"):
            camera(tmp_path / "s.npy").open()


class TestTimes:
    @pytest.fixture
    def stack(self, tmp_path: Path) -> Path:
        np.save(tmp_path / "s.npy", np.zeros((3, 4, 5), np.uint8))
        return tmp_path / "s.npy"

    def played(self, stack: Path, text: str) -> list[int | None]:
        times = stack.with_name("times.csv")
        times.write_text(text)
        frames, _, _ = play(camera(stack, times=times))
        return [frame.stamp.device_ns for frame in frames]

    def test_nanoseconds(self, stack: Path) -> None:
        text = "time_ns\n1700000000123456789\n1700000000140000001\n1700000000160000003\n"
        assert self.played(stack, text) == [
            1700000000123456789,
            1700000000140000001,
            1700000000160000003,
        ]

    def test_decimal_seconds_keep_all_their_digits(self, stack: Path) -> None:
        text = "id, time_s\n0, 1700000000.123456789\n1, 1700000000.2\n2, 1700000001\n"
        assert self.played(stack, text) == [
            1700000000123456789,
            1700000000200000000,
            1700000001000000000,
        ]

    @pytest.mark.parametrize(
        ("text", "what"),
        [
            ("time_ns\n1\n2\n", "2 rows of times"),
            ("time_ns\n1\n2\n3\n4\n", "4 rows of times"),
            ("time_ns\n1\n3\n2\n", "not after"),
            ("time_ns\n1\n2.5\n3\n", "an integer"),
            ("time_s\n1\nnan\n3\n", "decimal"),
            ("time_s\n1\n\n3\n\n", "2 rows of times"),
            ("seconds\n1\n2\n3\n", "no column"),
            ("", "no column"),
        ],
    )
    def test_bad_times_are_one_line(self, stack: Path, text: str, what: str) -> None:
        with pytest.raises(SourceError, match=what) as error:
            self.played(stack, text)
        assert "\n" not in str(error.value)

    @pytest.mark.parametrize("rows", [FRAMES - 1, FRAMES + 1])
    def test_rows_are_counted_against_a_video(self, video: Path, tmp_path: Path, rows: int) -> None:
        times = tmp_path / "times.csv"
        times.write_text("time_ns\n" + "".join(f"{n}\n" for n in range(rows)))
        with pytest.raises(SourceError, match=f"{rows} rows of times"):
            play(camera(video, times=times))

    def test_losses_have_their_times(self, tmp_path: Path, stack: Path) -> None:
        stack.write_bytes(stack.read_bytes()[:-1])
        times = tmp_path / "times.csv"
        times.write_text("time_ns\n100\n200\n300\n")
        _, losses, _ = play(camera(stack, times=times, origin=1_000))
        assert (losses[0].first_raw_ns, losses[0].last_raw_ns) == (1_200, 1_200)


class TestPace:
    def test_realtime_follows_the_clock_and_lets_the_caller_look_up(self, tmp_path: Path) -> None:
        np.save(tmp_path / "s.npy", np.zeros((3, 4, 5), np.uint8))
        clock = FakeClock()
        settings = CameraSection(source=str(tmp_path / "s.npy"), rate_hz=2, realtime=True)
        driver = FileCamera("front", settings, clock=clock, sleep=clock.sleep)
        driver.open()
        arrivals = []
        nones = 0
        for sample in driver.samples():
            if sample is None:
                nones += 1
            else:
                assert isinstance(sample, Frame)
                assert sample.stamp.raw_ns == clock.now
                arrivals.append(clock.now - 1_000_000_000)
        driver.close()
        assert arrivals == [0, 500_000_000, 1_000_000_000]
        assert max(clock.sleeps) <= 0.2
        assert nones == 4


class TestCannotOpen:
    def refused(self, path: Path) -> str:
        with pytest.raises(SourceError) as error:
            camera(path).open()
        assert "\n" not in str(error.value)
        assert str(path) in str(error.value)
        return str(error.value)

    def test_nothing_there(self, tmp_path: Path) -> None:
        assert "no such file" in self.refused(tmp_path / "none.mp4")
        assert "no such file" in self.refused(tmp_path / "none.png")
        assert "no such file" in self.refused(tmp_path / "none.npy")

    def test_empty(self, tmp_path: Path) -> None:
        (tmp_path / "f").mkdir()
        (tmp_path / "e.mp4").touch()
        assert "no image" in self.refused(tmp_path / "f")
        assert "empty file" in self.refused(tmp_path / "e.mp4")

    @pytest.mark.parametrize("data", [b"$GPGGA,120000\r\n" * 300, bytes(range(256)) * 20])
    def test_not_a_video(self, tmp_path: Path, data: bytes) -> None:
        (tmp_path / "v.txt").write_bytes(data)
        assert "not a video" in self.refused(tmp_path / "v.txt")

    def test_no_permission(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        def denied(self: Path, *_: object, **__: object) -> Iterator[Path]:
            raise PermissionError(13, "Permission denied")

        (tmp_path / "v.mp4").write_bytes(b"x")
        (tmp_path / "f").mkdir()
        monkeypatch.setattr(Path, "open", denied)
        monkeypatch.setattr(Path, "iterdir", denied)
        assert "no permission" in self.refused(tmp_path / "v.mp4")
        assert "no permission" in self.refused(tmp_path / "f")
        monkeypatch.undo()
