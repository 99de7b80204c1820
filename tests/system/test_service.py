"""The service in the foreground: recording, answering, reconnecting, ending cleanly."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from recorder.simulation.gige_camera import GigeCameraProcess, aravis_problem
from recorder.simulation.nmea_pty import NmeaPty, moving_train
from tests.system.recorder_process import recorder


class Service:
    """``recorder run`` as a process."""

    def __init__(self, folder: Path, drivers: str) -> None:
        self.socket = folder / "status.sock"
        config = folder / "recorder.toml"
        config.write_text(f'{drivers}\n[storage]\nout = "{folder / "drives"}"\n')
        self.process = subprocess.Popen(
            [sys.executable, "-m", "recorder", "run", "--config", str(config)],
            env={**os.environ, "RECORDER_SOCKET": str(self.socket)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def status(self) -> tuple[int, dict[str, Any]]:
        ran = recorder("status", "--socket", self.socket, "--json")
        return ran.code, json.loads(ran.out)

    def until(self, condition: Callable[[int, dict[str, Any]], bool], seconds: float = 30) -> dict[str, Any]:
        end = time.monotonic() + seconds
        while True:
            code, told = self.status()
            if condition(code, told):
                return told
            assert time.monotonic() < end, told
            time.sleep(0.2)

    def end(self, number: int = signal.SIGTERM) -> tuple[int, str, str]:
        self.process.send_signal(number)
        out, err = self.process.communicate(timeout=30)
        return self.process.returncode, out, err


@pytest.fixture
def gnss() -> Iterator[NmeaPty]:
    bursts = moving_train(46.9533, 7.4826, speed_m_s=24.0, course_deg=135.0, clock_ns=time.time_ns)
    with NmeaPty(bursts) as pty:
        yield pty


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_it_records_answers_and_closes_cleanly(tmp_path: Path, gnss: NmeaPty, number: int) -> None:
    service = Service(tmp_path, f'[drivers.gnss]\nsource = "{gnss.path}"')
    told = service.until(lambda code, told: code == 0 and told["time"].get("utc_ns") is not None)
    assert told["recording"]
    assert set(told) >= {"recording", "drive", "durable_raw_ns", "devices", "time", "disk", "processes"}
    assert told["devices"]["gnss"]["state"] == "streaming"
    time.sleep(1.5)
    code, out, err = service.end(number)
    assert code == 0, err
    assert "Traceback" not in err
    drive = Path(out.strip().splitlines()[-1])
    assert str(drive) == told["drive"]
    assert not service.socket.exists()
    verified = recorder("verify", drive, "--json")
    assert verified.code == 0, verified.out


def test_a_device_that_is_not_there_is_degraded_and_recording_goes_on(tmp_path: Path, gnss: NmeaPty) -> None:
    drivers = f'[drivers.gnss]\nsource = "{gnss.path}"\n[drivers.camera.front]\nsource = "/nowhere.mp4"\n'
    service = Service(tmp_path, drivers)
    told = service.until(lambda code, told: code == 1 and told["devices"]["gnss"]["state"] == "streaming")
    assert told["recording"]
    assert told["devices"]["front"]["state"] == "absent"
    assert "/nowhere.mp4" in told["devices"]["front"]["reason"]
    code, out, _ = service.end()
    assert code == 0
    assert recorder("verify", out.strip().splitlines()[-1]).code == 0


@pytest.mark.skipif(aravis_problem() != "", reason=aravis_problem() or "Aravis is there")
def test_a_camera_that_dies_comes_back_and_its_loss_is_stated(tmp_path: Path) -> None:
    with GigeCameraProcess(pixel_format="Mono10", width=320, height=240) as camera:
        drivers = f'[drivers.camera.front]\nsource = "genicam://{camera.address}"\nrate_hz = 25\n'
        service = Service(tmp_path, drivers)
        service.until(lambda code, told: code == 0 and told["frames"].get("front", 0) > 25)
        camera.kill()
        service.until(lambda code, told: code == 1)
    with GigeCameraProcess(pixel_format="Mono10", width=320, height=240):
        before = service.status()[1]["frames"]["front"]
        service.until(lambda code, told: code == 0 and told["frames"]["front"] > before + 25)
        code, out, err = service.end()
    assert code == 0, err
    drive = out.strip().splitlines()[-1]
    verified = recorder("verify", drive, "--json")
    assert verified.code == 0, verified.out
    image = recorder("inspect", drive, "--json").json["topics"]["/camera/front/image"]
    assert image["lost"] > 0
    assert image["gaps"] == image["lost"]


def test_a_bad_configuration_is_bad_input(tmp_path: Path) -> None:
    (tmp_path / "recorder.toml").write_text("[drivers]\n")
    ran = recorder("run", "--config", tmp_path / "recorder.toml")
    assert ran.code == 2
    assert "no device" in ran.problem


def test_the_unit_file_is_accepted_by_systemd(tmp_path: Path) -> None:
    unit = Path(__file__).resolve().parents[2] / "systemd" / "recorder.service"
    text = unit.read_text(encoding="utf-8").replace("/opt/recorder/bin/recorder", sys.executable)
    checked = tmp_path / "recorder.service"
    checked.write_text(text, encoding="utf-8")
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", "--recursive-errors=no", str(checked)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
