"""The receiver's driver against its twin: real pyserial on a pseudo-terminal."""

import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from recorder.clock import SYSTEM_CLOCK
from recorder.config import GnssSection
from recorder.drivers.gnss import GnssReceiver
from recorder.errors import DeviceAbsent, DeviceBusy, DeviceDenied, DeviceLost, DeviceUnsuitable
from recorder.samples import Fix, NmeaSentence
from recorder.simulation.nmea_pty import NmeaPty, burst, moving_train

SECOND_NS = 1_000_000_000
T0_NS = 1_700_000_000 * SECOND_NS
FAST = 115_200
"""Baud, to keep the tests short; the pace itself has its own test."""
LONGEST_WAIT_S = 0.5
"""Contract: 0.2 s; the rest is for a machine that is busy with other tests."""


def bursts(count: int, *, first: int = 0) -> Iterator[list[bytes]]:
    for second in range(first, first + count):
        yield burst(T0_NS + second * SECOND_NS, 46.9533, 7.4826, 24.0, 135.0)
        pause = SYSTEM_CLOCK.raw_ns() + SECOND_NS // 5
        while SYSTEM_CLOCK.raw_ns() < pause:
            yield []


def receiver(twin: NmeaPty) -> GnssReceiver:
    driver = GnssReceiver(GnssSection(source=str(twin.path)))
    driver.open()
    return driver


def listen(driver: GnssReceiver, seconds: float) -> tuple[list[NmeaSentence], list[Fix], float]:
    """Sentences, fixes, and the longest time without any word of the driver, seconds."""
    sentences: list[NmeaSentence] = []
    fixes: list[Fix] = []
    start = last = time.monotonic()
    longest = 0.0
    for sample in driver.samples():
        now = time.monotonic()
        longest, last = max(longest, now - last), now
        if isinstance(sample, NmeaSentence):
            sentences.append(sample)
        elif isinstance(sample, Fix):
            fixes.append(sample)
        if now - start > seconds:
            break
    return sentences, fixes, longest


def test_every_burst_becomes_a_fix_stamped_at_its_first_byte() -> None:
    with NmeaPty(bursts(3), baud=FAST) as twin:
        time.sleep(0.1)  # the first burst is said to nobody
        driver = receiver(twin)
        sentences, fixes, longest = listen(driver, 0.8)
        driver.close()
    assert [fix.stamp.gps_ns for fix in fixes] == [T0_NS + SECOND_NS, T0_NS + 2 * SECOND_NS]
    assert all(fix.valid for fix in fixes)
    firsts = [one.stamp.raw_ns for one in sentences if one.data.startswith(b"$GPGGA")]
    assert [fix.stamp.gps_raw_ns for fix in fixes] == firsts
    assert longest < LONGEST_WAIT_S


def test_a_paced_line_is_heard_without_delay() -> None:
    with NmeaPty(baud=4800) as twin:
        driver = receiver(twin)
        said_ns = SYSTEM_CLOCK.raw_ns()
        twin.inject(b"".join(burst(T0_NS, 46.9533, 7.4826, 24.0, 135.0)))
        sentences, fixes, _ = listen(driver, 0.5)
        driver.close()
    assert len(fixes) == 1
    assert fixes[0].stamp.gps_raw_ns is None  # no pause was heard before: it may have been under way
    assert sentences[0].stamp.raw_ns is not None
    assert 0 <= sentences[0].stamp.raw_ns - said_ns < SECOND_NS // 10


def test_the_twin_speaks_at_the_pace_of_its_line() -> None:
    ready = threading.Event()
    said = burst(T0_NS, 46.9533, 7.4826, 24.0, 135.0)

    def when_ready() -> Iterator[list[bytes]]:
        while not ready.is_set():
            yield []
        yield said

    with NmeaPty(when_ready(), baud=4800) as twin:
        driver = receiver(twin)
        ready.set()
        sentences, fixes, longest = listen(driver, 0.8)
        driver.close()
    assert [one.data for one in sentences] == said
    # where the line pauses, on a busy machine, the burst is told a second time in full
    assert len({fix.stamp.gps_raw_ns for fix in fixes}) == 1
    assert longest < LONGEST_WAIT_S
    took_ns = (sentences[-1].stamp.raw_ns or 0) - (sentences[0].stamp.raw_ns or 0)
    line_ns = sum(map(len, said[:-1])) * 10 * SECOND_NS // 4800
    assert abs(took_ns - line_ns) < SECOND_NS // 10


def test_nothing_is_echoed_and_with_configure_off_nothing_written() -> None:
    with NmeaPty(baud=FAST) as twin:
        driver = GnssReceiver(GnssSection(source=str(twin.path), configure=False))
        driver.open()
        twin.inject(b"".join(burst(T0_NS, 46.9533, 7.4826, 24.0, 135.0)))
        listen(driver, 0.3)
        driver.close()
        assert twin.received == b""


def test_silence_is_told_and_survived() -> None:
    with NmeaPty(bursts(20), baud=FAST) as twin:
        driver = receiver(twin)
        twin.silent = True
        time.sleep(0.05)
        listen(driver, 0.2)
        assert listen(driver, 0.4)[:2] == ([], [])
        twin.silent = False
        assert len(listen(driver, 0.7)[1]) >= 2
        driver.close()


def test_garbage_and_bad_checksums_are_told_and_survived() -> None:
    with NmeaPty(bursts(20), baud=FAST) as twin:
        driver = receiver(twin)
        twin.inject(b"\xa0\xa2\x00\x12\xb0\xb3" * 50 + b"\n")
        sentences, fixes, _ = listen(driver, 0.5)
        assert "garbage" in {one.problem for one in sentences}
        assert fixes
        twin.spoil_checksums = True
        time.sleep(0.3)
        listen(driver, 0.1)
        sentences, fixes, _ = listen(driver, 0.5)
        driver.close()
    assert {one.problem for one in sentences} == {"checksum"}
    assert fixes == []


def test_bytes_that_trickle_without_a_line_do_not_hold_up_the_caller() -> None:
    with NmeaPty([b"x" * 200], baud=4800) as twin:
        driver = receiver(twin)
        sentences, _, longest = listen(driver, 0.4)
        driver.close()
    assert sentences == []
    assert longest < LONGEST_WAIT_S


def test_an_unplugged_receiver_is_lost() -> None:
    with NmeaPty(bursts(20), baud=FAST) as twin:
        driver = receiver(twin)
        samples = driver.samples()
        next(samples)
        twin.unplug()
        with pytest.raises(DeviceLost, match=r"went away") as caught:
            for _ in samples:
                pass
        driver.close()
    assert caught.value.where == str(twin.path)
    assert caught.value.todo


def test_half_a_line_before_the_unplugging_is_kept() -> None:
    with NmeaPty(baud=FAST) as twin:
        driver = receiver(twin)
        twin.inject(b"$GPRMC,1200")
        samples = driver.samples()
        assert [next(samples) for _ in range(2)] == [None, None]
        twin.unplug()
        kept = next(samples)
        with pytest.raises(DeviceLost):
            next(samples)
        driver.close()
    assert isinstance(kept, NmeaSentence)
    assert (kept.data, kept.problem) == (b"$GPRMC,1200", "cut")


def test_a_port_that_is_held_is_busy_and_free_afterwards() -> None:
    with NmeaPty(bursts(20), baud=FAST) as twin:
        first, second = receiver(twin), GnssReceiver(GnssSection(source=str(twin.path)))
        with pytest.raises(DeviceBusy, match="another program holds it"):
            second.open()
        assert listen(first, 0.5)[1], "the holder was disturbed"
        first.close()
        second.open()
        assert listen(second, 0.5)[1]
        second.close()


def test_no_such_device_is_absent(tmp_path: Path) -> None:
    with pytest.raises(DeviceAbsent, match="no such device"):
        GnssReceiver(GnssSection(source=str(tmp_path / "ttyUSB9"))).open()


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_what_is_no_serial_line_is_unsuitable(tmp_path: Path, kind: str) -> None:
    path = tmp_path
    if kind == "file":
        path = tmp_path / "log.nmea"
        path.write_bytes(b"$GPRMC")
    with pytest.raises(DeviceUnsuitable, match="not a serial line"):
        GnssReceiver(GnssSection(source=str(path))).open()


def test_a_refused_port_is_denied(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: str, flags: int) -> int:
        raise PermissionError(13, "Permission denied", path)

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(DeviceDenied, match="dialout"):
        GnssReceiver(GnssSection(source="/dev/ttyUSB0")).open()


def test_it_says_what_it_is_and_may_be_closed_twice() -> None:
    with NmeaPty() as twin:
        driver = receiver(twin)
        assert driver.describe()["port"] == str(twin.path)
        assert driver.describe()["baud"] == "4800"
        driver.close()
        driver.close()
        driver.open()
        driver.close()


def test_the_moving_train_says_each_second_once_and_moves() -> None:
    now_ns = T0_NS
    train = moving_train(46.9533, 7.4826, speed_m_s=25.0, course_deg=90.0, clock_ns=lambda: now_ns)
    said = []
    for _ in range(100):
        said += [one] if (one := next(train)) else []
        now_ns += SECOND_NS // 10
    assert len(said) == 10
    assert b"4657.1980,N,00728.9560,E" in said[0][0]
    assert b"4657.1980,N,00729.1339,E" in said[9][0]  # 225 m to the east
