"""The receiver's driver against the SiRF twin: rates, protocols, commands and every fault of the line."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import recorder
from recorder.clock import SYSTEM_CLOCK
from recorder.config import GnssSection
from recorder.drivers.gnss import GnssReceiver
from recorder.errors import DeviceAbsent, DeviceLost, DeviceUnsuitable
from recorder.samples import Fix, LogLine, NmeaSentence, Sample
from recorder.simulation.nmea_pty import NmeaPty
from recorder.simulation.sirf_receiver import COLD_BOOT_NS, Instant, SirfReceiver, cold_boot

SECOND_NS = 1_000_000_000
T0_NS = 1_790_000_000 * SECOND_NS
PLACE = (46.9533, 7.4826)
LONGEST_WAIT_S = 0.5
"""Contract: 0.2 s; the rest is for a machine that is busy with other tests."""


def instants() -> Iterator[Instant]:
    second = 0
    while True:
        yield Instant(T0_NS + second * SECOND_NS, *PLACE, 24.0, 135.0)
        second += 1


class Paced:
    """An instant every so often, and the raw time when each was handed over to be said."""

    def __init__(self, period_s: float = 0.25, told: Callable[[], Iterator[Instant]] = instants) -> None:
        self.raw_ns: dict[int, int] = {}
        self._period_s, self._told = period_s, told()

    def __iter__(self) -> Iterator[Instant | None]:
        due = time.monotonic()
        for instant in self._told:
            while time.monotonic() < due:
                yield None
            due = time.monotonic() + self._period_s
            self.raw_ns[instant.utc_ns] = SYSTEM_CLOCK.raw_ns()
            yield instant


def receiver(twin: NmeaPty, *, baud: int | str = "auto") -> GnssReceiver:
    driver = GnssReceiver(GnssSection.model_validate({"source": str(twin.path), "baud": baud}))
    driver.open()
    return driver


def listen(
    driver: GnssReceiver, seconds: float, until: Callable[[Sample], bool] = lambda _: False
) -> list[Sample]:
    """What it yields within some seconds, or until a certain sample; it never lets one wait."""
    end, last, told = time.monotonic() + seconds, time.monotonic(), list[Sample]()
    for sample in driver.samples():
        assert time.monotonic() - last < LONGEST_WAIT_S
        last = time.monotonic()
        if sample is not None:
            told.append(sample)
            if until(sample):
                break
        if last > end:
            break
    return told


def says(text: str) -> Callable[[Sample], bool]:
    return lambda sample: isinstance(sample, LogLine) and text in sample.message


def fixes(told: list[Sample]) -> list[Fix]:
    return [one for one in told if isinstance(one, Fix)]


def messages(told: list[Sample]) -> list[str]:
    return [one.message for one in told if isinstance(one, LogLine)]


@pytest.mark.parametrize("baud", [4800, 9600, 19200, 38400, 57600, 115200])
def test_a_receiver_at_any_rate_is_found_and_told_what_to_say(baud: int) -> None:
    with SirfReceiver(Paced(0.2 if baud > 4800 else 0.5), baud=baud) as twin:
        driver = receiver(twin)
        told = listen(driver, 40, says("obeys"))
        assert driver.describe()["baud"] == str(baud)
        assert driver.describe()["obeys"] == "yes"
        driver.close()
    assert messages(told)[-1] == "obeys: ZDA, GGA, GSA, RMC and nothing else"
    assert {kind: every for kind, every in twin.intervals.items() if every} == {
        "GGA": 1, "GSA": 1, "RMC": 1, "ZDA": 1,
    }  # fmt: skip
    assert fixes(told)[-1].valid


def test_the_rate_that_served_is_tried_first_when_it_is_plugged_in_again() -> None:
    with SirfReceiver(Paced(), baud=38400) as twin:
        driver = receiver(twin)
        listen(driver, 20, says("speaks NMEA"))
        driver.open()
        told = listen(driver, 2, says("speaks NMEA"))
        driver.close()
    assert messages(told) == ["speaks NMEA at 38400 baud"]


@pytest.mark.parametrize("baud", [4800, 38400, 115200])
def test_a_receiver_left_in_sirf_binary_is_switched_back(baud: int) -> None:
    with SirfReceiver(Paced(1.0 if baud == 4800 else 0.25), baud=baud, binary=True) as twin:
        driver = receiver(twin)
        told = listen(driver, 40, lambda sample: isinstance(sample, Fix) and sample.valid)
        driver.close()
    assert not twin.binary
    assert any(message.startswith("speaks SiRF binary") for message in messages(told))
    assert any(message.endswith("switched from SiRF binary") for message in messages(told))
    assert fixes(told)[-1].latitude_deg == pytest.approx(PLACE[0], abs=1e-6)


def test_a_receiver_in_sirf_binary_that_does_not_obey_is_refused_by_name() -> None:
    with SirfReceiver(Paced(), baud=38400, binary=True, obeys=False) as twin:
        driver = receiver(twin, baud=38400)
        with pytest.raises(DeviceUnsuitable, match=r"speaks SiRF binary, not NMEA"):
            listen(driver, 40)
        driver.close()


def test_a_receiver_that_does_not_obey_is_told_of_and_recorded_all_the_same() -> None:
    with SirfReceiver(Paced(0.1), baud=57600, obeys=False) as twin:
        driver = receiver(twin, baud=57600)
        told = listen(driver, 30, says("does not obey"))
        more = listen(driver, 1)
        driver.close()
    assert messages(told)[-1] == "does not obey $PSRF103: ZDA missing; GSV still said; recorded as it is"
    assert len(fixes(more)) > 3
    assert all(fix.valid for fix in fixes(more))


def test_a_receiver_that_loses_its_settings_is_found_and_told_again() -> None:
    with SirfReceiver(Paced(0.2), baud=38400) as twin:
        driver = receiver(twin)
        listen(driver, 20, says("obeys"))
        twin.reset(baud=9600)
        told = listen(driver, 40, says("obeys"))
        driver.close()
    assert any("no NMEA any more at 38400 baud" in message for message in messages(told))
    assert "speaks NMEA at 9600 baud" in messages(told)
    assert twin.intervals["GSV"] == 0


class _Tapped(SirfReceiver):
    """Keeps what it has put on the line."""

    def __init__(self, told: Paced, *, baud: int, binary: bool = False) -> None:
        super().__init__(told, baud=baud, binary=binary)
        self.tapped: list[bytes] = []

    def _put(self, data: bytes) -> None:
        super()._put(data)
        self.tapped.append(data)


def test_every_byte_is_handed_out_from_the_wrong_rate_and_garbage_to_the_unplugging() -> None:
    """The bytes on the line, as the pseudo-terminal carried them, are what comes out, joined."""
    with _Tapped(Paced(0.3), baud=19200) as twin:
        driver = receiver(twin)
        told: list[Sample] = []
        samples = driver.samples()

        def until(text: str) -> None:
            for sample in samples:
                if sample is not None:
                    told.append(sample)
                    if says(text)(sample):
                        return

        until("speaks NMEA")
        twin.inject(bytes(range(256)) * 3)
        until("obeys")
        twin.unplug()
        with pytest.raises(DeviceLost, match="went away"):
            until("for ever")
        driver.close()
    heard = b"".join(one.data for one in told if isinstance(one, NmeaSentence))
    said = b"".join(twin.tapped)
    # the twin's last bytes may have been said to the closed end, the first to the unopened one
    assert len(heard) > 5000
    assert heard in said
    assert len(said) - len(heard) < 200


def test_the_arrival_of_a_fix_is_that_of_the_first_byte_of_its_burst() -> None:
    paced = Paced(0.8)
    with SirfReceiver(paced, baud=4800) as twin:
        driver = receiver(twin)
        told = listen(driver, 6)
        driver.close()
    dated = [fix for fix in fixes(told) if fix.stamp.gps_raw_ns is not None]
    assert len(dated) >= 3
    for fix in dated:
        late_ns = (fix.stamp.gps_raw_ns or 0) - paced.raw_ns[fix.stamp.gps_ns or 0]
        assert 0 <= late_ns < 60_000_000  # a chunk of 16 bytes takes 33 ms at 4800 baud


def test_what_had_piled_up_before_it_was_listened_to_dates_no_fix() -> None:
    paced = Paced(0.3)
    with SirfReceiver(paced, baud=115200) as twin:
        driver = receiver(twin, baud=115200)
        time.sleep(1.5)  # five bursts wait in the kernel
        told = listen(driver, 2)
        driver.close()
    dated = [fix for fix in fixes(told) if fix.stamp.gps_raw_ns is not None]
    assert dated
    assert all(
        (fix.stamp.gps_raw_ns or 0) - paced.raw_ns[fix.stamp.gps_ns or 0] < 150_000_000 for fix in dated
    )
    waiting = [one for one in told if isinstance(one, NmeaSentence)]
    assert sum(one.data.startswith(b"$GPRMC") for one in waiting) > len(dated) + 3, "recorded all the same"


@pytest.mark.parametrize("fault", ["echo", "split writes", "partial lines", "garbage"])
def test_faults_of_the_line_cost_no_byte_and_no_sound_burst(fault: str) -> None:
    with SirfReceiver(Paced(0.25), baud=38400) as twin:
        driver = receiver(twin, baud=38400)
        listen(driver, 20, says("speaks NMEA"))
        if fault == "echo":
            twin.echo = True
        elif fault == "split writes":
            twin.chunk_bytes = 1
        elif fault == "partial lines":
            twin.cut_lines = True
        else:
            twin.inject(b"\xa0\xa2\x00$$$!\x10\x03\xb5b" * 20)
        told = listen(driver, 3)
        driver.close()
    sound = [fix for fix in fixes(told) if fix.valid]
    assert len({fix.stamp.gps_ns for fix in sound}) >= 5
    assert all(fix.latitude_deg == pytest.approx(PLACE[0], abs=1e-6) for fix in sound)
    if fault in ("partial lines", "garbage"):
        assert any(one.problem for one in told if isinstance(one, NmeaSentence))


def test_bad_checksums_are_recorded_and_tell_nothing() -> None:
    with SirfReceiver(Paced(0.2), baud=38400) as twin:
        driver = receiver(twin, baud=38400)
        listen(driver, 20, says("speaks NMEA"))
        twin.spoil_checksums = True
        time.sleep(0.3)
        listen(driver, 0.2)
        told = listen(driver, 1)
        driver.close()
    assert fixes(told) == []
    assert {one.problem for one in told if isinstance(one, NmeaSentence)} == {"checksum"}


def test_after_a_cold_boot_no_fix_is_valid_until_satellites_are_received() -> None:
    def booted() -> Iterator[Instant]:
        return cold_boot(instants(), 8)

    with SirfReceiver(Paced(0.25, booted), baud=38400) as twin:
        driver = receiver(twin, baud=38400)
        told = listen(driver, 20, lambda sample: isinstance(sample, Fix) and sample.valid)
        driver.close()
    *before, first = fixes(told)
    assert before
    for fix in before:
        assert (fix.valid, fix.problem, fix.latitude_deg) == (False, "status V", None)
        assert (fix.stamp.gps_ns or 0) < COLD_BOOT_NS + 10 * SECOND_NS
    assert (first.stamp.gps_ns or 0) > T0_NS


def test_an_unplugged_receiver_is_absent_until_it_is_there_again(tmp_path: Path) -> None:
    port = tmp_path / "ttyUSB0"
    driver = GnssReceiver(GnssSection(source=str(port)))
    for _ in range(2):
        with SirfReceiver(Paced()) as twin:
            port.symlink_to(twin.path)
            driver.open()
            listen(driver, 5, lambda sample: isinstance(sample, Fix))
            twin.unplug()
            with pytest.raises(DeviceLost):
                listen(driver, 2)
        port.unlink()
        with pytest.raises(DeviceAbsent):
            driver.open()


def test_a_recording_holds_every_byte_and_what_was_found_out(tmp_path: Path) -> None:
    with _Tapped(Paced(0.25), baud=9600, binary=True) as twin:
        command = ["record", str(twin.path), "--out", str(tmp_path), "--seconds", "9", "--json"]
        done = subprocess.run(
            [sys.executable, "-m", "recorder", *command], capture_output=True, text=True, check=False
        )
        said = b"".join(twin.tapped)
    assert done.returncode == 0, done.stderr
    with recorder.open_drive(json.loads(done.stdout)["drive"]) as drive:
        heard = b"".join(message.value.data for message in drive.messages("/gnss/raw"))
        log = [message.value.message for message in drive.messages("/log")]
        states = {
            pair.key: pair.value for message in drive.messages("/gnss/fix") for pair in message.value.metadata
        }
    assert heard in said
    assert len(heard) > 2000
    assert "speaks SiRF binary at 9600 baud, is told to speak NMEA" in log
    assert "speaks NMEA at 9600 baud, switched from SiRF binary" in log
    assert (states["valid"], states["mode"], states["dimensions"]) == ("true", "A/A/1", "3")


def test_a_recording_of_a_receiver_that_speaks_something_else_says_so_in_one_line(tmp_path: Path) -> None:
    with SirfReceiver(Paced(0.25), baud=4800, binary=True, obeys=False) as twin:
        command = ["record", str(twin.path), "--baud", "4800", "--out", str(tmp_path), "--seconds", "20"]
        done = subprocess.run(
            [sys.executable, "-m", "recorder", *command], capture_output=True, text=True, check=False
        )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    (line,) = [line for line in done.stderr.splitlines() if "SiRF binary" in line]
    assert "speaks SiRF binary, not NMEA; it does not obey" in line


@pytest.mark.parametrize("baud", ["4801", "fast", "-1"])
def test_a_rate_that_is_none_is_bad_input(tmp_path: Path, baud: str) -> None:
    command = ["record", "/dev/ttyUSB9", "--baud", baud, "--out", str(tmp_path)]
    done = subprocess.run(
        [sys.executable, "-m", "recorder", *command], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "drivers.gnss.baud" in done.stderr
    assert "Traceback" not in done.stderr
