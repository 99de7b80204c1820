"""Real peers: a GigE Vision camera in its own process over loopback, a receiver on a pty at its own pace."""

import time
from pathlib import Path

import numpy as np
import pytest

import recorder as product
from recorder.simulation.gige_camera import GigeCameraProcess, aravis_problem
from recorder.simulation.nmea_pty import NmeaPty, moving_train
from recorder.simulation.scene import Scene
from tests.system.recorder_process import recorder

RATE_HZ = 59.82
SECONDS = 60.0

pytestmark = pytest.mark.skipif(aravis_problem() != "", reason=aravis_problem() or "Aravis is there")


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sixty rendered 10-bit frames, played in a loop by the camera."""
    path = tmp_path_factory.mktemp("loop") / "loop.npy"
    np.save(path, Scene().loop(60, 24.0))
    return path


@pytest.mark.parametrize("pixel_format", ["Mono10", "Mono10p"])
def test_a_minute_at_full_rate_loses_nothing_and_changes_nothing(
    loop: Path, tmp_path: Path, pixel_format: str
) -> None:
    bursts = moving_train(46.9533, 7.4826, speed_m_s=24.0, course_deg=135.0, clock_ns=time.time_ns)
    with NmeaPty(bursts) as gnss, GigeCameraProcess(frames=loop, pixel_format=pixel_format) as camera:
        ran = recorder(
            "record", f"genicam://{camera.address}", gnss.path, "--out", tmp_path, "--seconds", str(SECONDS),
            "--pixel-format", pixel_format, "--rate", str(RATE_HZ), "--json", timeout=SECONDS + 60,
        )  # fmt: skip
    assert ran.code == 0, ran.err
    topics = ran.json["topics"]
    image = topics["/camera/front/image"]
    assert image["gaps"] == 0
    assert image["lost"] == 0
    # on a busy machine the camera process leaves out instants without using an id: not ours
    assert image["messages"] > 0.85 * SECONDS * RATE_HZ
    assert topics["/gnss/fix"]["messages"] > SECONDS - 5
    verified = recorder("verify", ran.json["drive"], "--json")
    assert verified.code == 0, verified.out
    sent = np.load(loop, mmap_mode="r")
    with product.open_drive(Path(ran.json["drive"])) as drive:
        frames = drive.frames("front")
        assert [frame.id for frame in frames] == list(range(len(frames)))
        first = next(n for n in range(len(sent)) if np.array_equal(sent[n], frames[0].pixels))
        for number in range(0, len(frames), 97):
            assert np.array_equal(frames[number].pixels, sent[(first + number) % len(sent)]), number
        stamps = [frame.stamp for frame in frames]
    assert all(stamp.device_ns and stamp.realtime_ns and stamp.raw_ns for stamp in stamps)
    assert stamps[-1].utc_ns is not None
    assert abs(stamps[-1].utc_ns - (stamps[-1].realtime_ns or 0)) < 2_000_000_000
