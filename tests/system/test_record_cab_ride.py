"""Real input: a cab ride video and a receiver's log, recorded, read back, exported, walked."""

from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader

import recorder as product
from recorder.codec import decode
from tests.system.recorder_process import Ran, recorder

FRAMES = 480


@pytest.fixture(scope="module")
def video() -> Path:
    path = Path(__file__).resolve().parents[3] / "shared" / "data" / "cab-ride" / "cab-ride.mp4"
    if not path.is_file():
        pytest.skip(f"real data is not there: {path}")
    return path


@pytest.fixture(scope="module")
def ran(video: Path, tmp_path_factory: pytest.TempPathFactory) -> Ran:
    log = video.parents[1] / "nmea" / "sirfstarv-nmea.log"
    return recorder("record", video, "--nmea", log, "--out", tmp_path_factory.mktemp("drives"))


def truth(video: Path) -> list[np.ndarray]:
    capture = cv2.VideoCapture(str(video))
    frames = []
    while True:
        there, frame = capture.read()
        if not there:
            break
        frames.append(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY))
    capture.release()
    return frames


def test_it_is_recorded(ran: Ran) -> None:
    assert ran.code == 0, ran.err
    assert ran.drive.is_dir()
    assert ran.drive.is_absolute()


def test_every_frame_comes_back_bit_for_bit(ran: Ran, video: Path) -> None:
    with product.open_drive(ran.drive) as drive:
        frames = drive.frames("front")
        expected = truth(video)
        assert len(frames) == len(expected) == FRAMES
        for frame, pixels in zip(frames, expected, strict=True):
            assert frame.bit_depth == 8
            assert np.array_equal(frame.pixels, pixels)
        assert np.array_equal(frames[240].pixels, expected[240])


def test_stamps_follow_the_film_and_utc_follows_the_log(ran: Ran) -> None:
    with product.open_drive(ran.drive) as drive:
        stamps = [frame.stamp for frame in drive.frames("front")]
    raw = [stamp.raw_ns for stamp in stamps if stamp.raw_ns is not None]
    assert len(raw) == FRAMES
    assert all(later > earlier for earlier, later in pairwise(raw))
    assert 19.9e9 < raw[-1] - raw[0] < 20.3e9
    told = [stamp for stamp in stamps if stamp.utc_ns is not None]
    assert len(told) > FRAMES * 0.8
    assert all(stamp.utc_sigma_ns and stamp.gps_ns and stamp.gps_raw_ns for stamp in told)
    # the log was taken in the night to 2019-02-05, UTC
    day = np.datetime64(told[0].utc_ns, "ns").astype("datetime64[D]")
    assert str(day) == "2019-02-05"
    with product.open_drive(ran.drive) as drive:
        fix = next(iter(drive.messages("/gnss/fix"))).value
    assert abs(fix.timestamp.seconds - (told[0].utc_ns or 0) // 10**9) < 60
    elapsed = (told[-1].utc_ns or 0) - (told[0].utc_ns or 0)
    assert abs(elapsed - ((told[-1].raw_ns or 0) - (told[0].raw_ns or 0))) < 50_000_000


def test_verify_and_inspect_agree(ran: Ran) -> None:
    verified = recorder("verify", ran.drive, "--json")
    assert verified.code == 0, verified.out
    assert verified.json["ok"]
    assert (verified.json["frames"], verified.json["damaged"], verified.json["unaccounted"]) == (FRAMES, 0, 0)
    inspected = recorder("inspect", ran.drive, "--json")
    assert inspected.code == 0
    topics = inspected.json["topics"]
    assert topics["/camera/front/image"]["messages"] == FRAMES
    assert topics["/camera/front/image"]["gaps"] == 0
    assert topics["/gnss/raw"]["messages"] > 0
    assert topics["/gnss/fix"]["messages"] > 10


def test_the_reference_reader_reads_every_message(ran: Ran) -> None:
    counts: dict[str, int] = {}
    schemas: dict[str, str] = {}
    for segment in sorted(ran.drive.glob("*.mcap")):
        with segment.open("rb") as file:
            for schema, channel, _ in make_reader(file, validate_crcs=True).iter_messages():
                counts[channel.topic] = counts.get(channel.topic, 0) + 1
                schemas[channel.topic] = schema.name if schema else ""
    with product.open_drive(ran.drive) as drive:
        assert counts == {name: topic.messages for name, topic in drive.topics.items()}
    assert counts["/camera/front/image"] == FRAMES
    assert schemas["/camera/front/image"] == "recorder.FelicsFrame"
    assert schemas["/camera/front/preview"] == "foxglove.CompressedImage"
    assert schemas["/gnss/fix"] == "foxglove.LocationFix"


def test_the_exported_stream_is_walked_by_its_markers_alone(ran: Ran, video: Path, tmp_path: Path) -> None:
    stream = tmp_path / "ride.felics"
    exported = recorder(
        "export", ran.drive, "--topic", "/camera/front/image", "--format", "felics", "--out", stream
    )
    assert exported.code == 0, exported.err
    data = stream.read_bytes()
    images = []
    place = 0
    while (start := data.find(b"\xff\xe8", place)) >= 0:
        place = data.index(b"\xff\xe9", start) + 2
        images.append(data[start:place])
    assert place == len(data)
    assert len(images) == FRAMES
    for number, pixels in enumerate(truth(video)):
        if number % 60 == 0:
            assert np.array_equal(decode(images[number]), pixels)


def test_a_paced_recording_takes_as_long_as_the_film(video: Path, tmp_path: Path) -> None:
    ran = recorder("record", video, "--out", tmp_path, "--realtime", "--seconds", "3", "--json")
    assert ran.code == 0, ran.err
    frames = ran.json["topics"]["/camera/front/image"]["messages"]
    assert 60 <= frames <= 80
