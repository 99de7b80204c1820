"""The gpsd client against the real gpsd, which reads the receiver's twin on a pseudo-terminal."""

import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorder.clock import SYSTEM_CLOCK
from recorder.config import GnssSection
from recorder.drivers.gpsd import GpsdClient, _Stream
from recorder.errors import DeviceAbsent, DeviceLost, DeviceUnsuitable
from recorder.samples import Fix, LogLine, NmeaSentence, Sample
from recorder.simulation.nmea_pty import sentence
from recorder.simulation.sirf_receiver import Instant, SirfReceiver

SECOND_NS = 1_000_000_000
PLACE = (46.9533, 7.4826)

needs_gpsd = pytest.mark.skipif(shutil.which("gpsd") is None, reason="gpsd is not installed")


class Told:
    """Every whole second of the wall clock, and when it was handed to the receiver to say."""

    def __init__(self) -> None:
        self.raw_ns: dict[int, int] = {}

    def __iter__(self) -> Iterator[Instant | None]:
        last_s = time.time_ns() // SECOND_NS
        while True:
            now_s = time.time_ns() // SECOND_NS
            if now_s == last_s:
                yield None
                continue
            last_s = now_s
            self.raw_ns[now_s * SECOND_NS] = SYSTEM_CLOCK.raw_ns()
            yield Instant(now_s * SECOND_NS, *PLACE, 24.0, 135.0)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def gpsd(*arguments: str | Path, baud: int = 9600) -> Iterator[tuple[str, "subprocess.Popen[bytes]"]]:
    port = free_port()
    command = ["gpsd", "-N", "-n", "-b", "-s", str(baud), "-S", str(port), *map(str, arguments)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        for _ in range(100):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.05)
        yield f"gpsd://127.0.0.1:{port}", process
    finally:
        process.terminate()
        process.wait(5)


def client(source: str) -> GpsdClient:
    driver = GpsdClient(GnssSection(source=source))
    driver.open()
    return driver


def listen(driver: GpsdClient, seconds: float) -> list[Sample]:
    end, last, told = time.monotonic() + seconds, time.monotonic(), list[Sample]()
    for sample in driver.samples():
        assert time.monotonic() - last < 0.5, "the caller did not get the word back"
        last = time.monotonic()
        if sample is not None:
            told.append(sample)
        if last > end:
            break
    return told


@needs_gpsd
def test_the_receivers_sentences_come_through_gpsd_with_the_arrival_of_their_first_byte() -> None:
    seconds = Told()
    with SirfReceiver(seconds, baud=9600) as twin, gpsd(twin.path) as (source, _):
        driver = client(source)
        told = listen(driver, 5.0)
        facts = driver.describe()
        driver.close()
    fixes = [one for one in told if isinstance(one, Fix) and one.stamp.gps_raw_ns is not None]
    assert len({fix.stamp.gps_ns for fix in fixes}) >= 3
    for fix in fixes:
        assert fix.valid
        assert fix.latitude_deg == pytest.approx(PLACE[0], abs=1e-6)
        assert fix.longitude_deg == pytest.approx(PLACE[1], abs=1e-6)
        said_ns = seconds.raw_ns[fix.stamp.gps_ns or 0]
        # a GGA takes 80 ms at 9600 baud: its end would be later
        assert -10_000_000 < (fix.stamp.gps_raw_ns or 0) - said_ns < 75_000_000
    sound = b"".join(one.data for one in told if isinstance(one, NmeaSentence) and not one.problem)
    assert sound.count(b"$GPRMC") >= 3
    assert facts["gpsd"]
    assert "NMEA0183" in facts["receiver"]


@needs_gpsd
def test_a_receiver_in_sirf_binary_is_read_by_gpsds_reports() -> None:
    """At once a test of the twin: gpsd decodes its binary messages."""
    with SirfReceiver(Told(), baud=9600, binary=True) as twin, gpsd(twin.path) as (source, _):
        driver = client(source)
        told = listen(driver, 4.0)
        assert "SiRF" in driver.describe()["receiver"]
        driver.close()
    fixes = [one for one in told if isinstance(one, Fix) and one.valid]
    assert len({fix.stamp.gps_ns for fix in fixes}) >= 2
    assert all(fix.latitude_deg == pytest.approx(PLACE[0], abs=1e-4) for fix in fixes)
    assert abs((fixes[-1].stamp.gps_ns or 0) - time.time_ns()) < 3 * SECOND_NS
    reports = [one for one in told if isinstance(one, NmeaSentence) and one.problem == "json"]
    assert any(b'"class":"TPV"' in one.data for one in reports), "reports are recorded, too"


@needs_gpsd
def test_gpsd_that_ends_is_lost_and_found_again() -> None:
    with SirfReceiver(Told(), baud=9600) as twin:
        with gpsd(twin.path) as (source, process):
            driver = client(source)
            samples = driver.samples()
            next(samples)
            process.terminate()
            with pytest.raises(DeviceLost, match=r"gpsd ended the connection|gpsd was lost"):
                for _ in samples:
                    pass
            with pytest.raises(DeviceAbsent, match="no gpsd answers"):
                driver.open()
        with gpsd(twin.path) as (source, _):
            driver = client(source)
            assert listen(driver, 1.0)
            driver.close()


@needs_gpsd
def test_gpsd_without_a_receiver_says_so(tmp_path: Path) -> None:
    with gpsd("-F", tmp_path / "control") as (source, _):
        driver = client(source)
        told = listen(driver, 0.5)
        driver.close()
    assert [one.message for one in told if isinstance(one, LogLine)] == ["gpsd has no receiver that speaks"]


@pytest.mark.parametrize("greeting", [b"SSH-2.0-OpenSSH_9.2\r\n", b'{"class":"TPV"}\n', b"x" * 100_000])
def test_what_is_no_gpsd_is_refused(greeting: bytes) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            connection, _ = server.accept()
            with connection:
                connection.sendall(greeting)
                time.sleep(0.5)

        thread = threading.Thread(target=answer)
        thread.start()
        driver = client(f"gpsd://127.0.0.1:{server.getsockname()[1]}")
        with pytest.raises(DeviceUnsuitable, match="it is no gpsd that answers there"):
            listen(driver, 2.0)
        driver.close()
        thread.join()


@given(st.lists(st.one_of(
    st.binary(max_size=60),
    st.sampled_from([
        b'{"class":"VERSION"}\n',
        b'{"class":"TPV","mode":3,"time":"2024-02-05T12:00:00.000Z","lat":1,"lon":2}\n',
        b'{"class":"TPV","mode":"x","time":5}\n', b'{"class":"PPS","clock_sec":1,"clock_nsec":2}\n', b"{}\n",
        b'{"class":"DEVICES","devices":[1,{"activated":1}]}\n', b'{"class":"SKY","uSat":1e400}\n', b"[]\n",
        b'{"class":"TOFF","clock_sec":"a"}\n', b'{"class":"ERROR"}\n',
        sentence("GPGGA,,,,,,0,00,99.99,,,,,,"),
    ]),
), max_size=20))  # fmt: skip
def test_whatever_gpsd_says_no_byte_is_lost_and_nothing_raises(said: list[bytes]) -> None:
    stream = _Stream("gnss", SYSTEM_CLOCK)
    told = [one for chunk in said for one in stream.feed(chunk, SYSTEM_CLOCK.raw_ns())] + stream.end()
    assert b"".join(one.data for one in told if isinstance(one, NmeaSentence)) == b"".join(said)


def test_an_address_that_is_none_is_refused() -> None:
    with pytest.raises(DeviceUnsuitable, match="not an address"):
        GpsdClient(GnssSection(source="gpsd://localhost:none")).open()


def test_where_nobody_listens_gpsd_is_absent() -> None:
    with pytest.raises(DeviceAbsent, match=r"no gpsd answers.*start gpsd"):
        client(f"gpsd://127.0.0.1:{free_port()}")
