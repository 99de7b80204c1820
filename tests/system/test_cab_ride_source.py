"""The file camera on a real cab ride."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from recorder.config import CameraSection
from recorder.drivers.file_camera import FileCamera
from recorder.errors import DeviceLost
from recorder.samples import Frame, Loss, Sample


@pytest.fixture
def ride(shared_data: Path) -> Path:
    path = shared_data / "cab-ride" / "cab-ride.mp4"
    if not path.is_file():
        pytest.skip(f"the cab ride is not there: {path}")
    return path


def test_every_frame_is_opencvs_own(ride: Path) -> None:
    plain = cv2.VideoCapture(str(ride))
    driver = FileCamera("front", CameraSection(source=str(ride), realtime=False), origin_raw_ns=10**12)
    driver.open()
    count = 0
    before_ns = 10**12 - 1
    for sample in driver.samples():
        assert isinstance(sample, Frame)
        good, image = plain.read()
        assert good
        np.testing.assert_array_equal(sample.pixels, cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        assert (sample.id, sample.bit_depth) == (count, 8)
        assert sample.stamp.raw_ns is not None
        assert sample.stamp.raw_ns > before_ns
        before_ns = sample.stamp.raw_ns
        count += 1
    driver.close()
    plain.release()
    assert count == 480
    # 24 frames a second, but the last comes after four intervals: the times are the file's, not counted
    assert before_ns - 10**12 == 20_083_333_333


def test_a_cut_ride_is_told_apart(ride: Path, tmp_path: Path) -> None:
    """H.264 with bidirectional frames: a cut leaves holes before its end, numbered by their times."""
    data = ride.read_bytes()
    moov_at = data.rfind(b"moov") - 4
    moov = bytearray(data[moov_at:])
    _move_chunks(moov, len(moov))
    whole = data[:32] + bytes(moov) + data[32:moov_at]
    path = tmp_path / "cut.mp4"
    reference = cv2.VideoCapture(str(ride))
    expected = [cv2.cvtColor(reference.read()[1], cv2.COLOR_BGR2GRAY) for _ in range(480)]
    reference.release()
    for share in (0.461, 0.569, 0.9):
        path.write_bytes(whole[: int(len(whole) * share)])
        samples, error = _play(path)
        assert "file ends early" in error
        ids: list[int] = []
        for sample in samples:
            if isinstance(sample, Loss):
                ids.extend(range(sample.first_id, sample.last_id + 1))
            elif isinstance(sample, Frame):
                np.testing.assert_array_equal(sample.pixels, expected[sample.id])
                ids.append(sample.id)
        assert ids == list(range(480))


def _play(path: Path) -> tuple[list[Sample | None], str]:
    """All samples, and the error that ends them."""
    driver = FileCamera("front", CameraSection(source=str(path), realtime=False), origin_raw_ns=0)
    samples: list[Sample | None] = []
    driver.open()
    try:
        samples.extend(driver.samples())
    except DeviceLost as error:
        return samples, str(error)
    finally:
        driver.close()
    return samples, ""


def _move_chunks(moov: bytearray, by: int) -> None:
    """Add to the chunk offsets (ISO/IEC 14496-12, 8.7.5), as the index moves to the front."""
    at = -1
    while (at := moov.find(b"stco", at + 1)) >= 0:
        for entry in range(int.from_bytes(moov[at + 8 : at + 12], "big")):
            place = slice(at + 12 + 4 * entry, at + 16 + 4 * entry)
            moov[place] = (int.from_bytes(moov[place], "big") + by).to_bytes(4, "big")
