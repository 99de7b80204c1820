"""A log played as a receiver: its own seconds, its own order, nothing lost."""

from pathlib import Path

import pytest

from recorder.drivers.nmea_log import NmeaLog
from recorder.errors import SourceError
from recorder.samples import Fix, NmeaSentence
from recorder.simulation.nmea_pty import burst, sentence, spoilt

SECOND_NS = 1_000_000_000
T0_NS = 1_700_000_000 * SECOND_NS
ORIGIN_NS = 5_000


class TickClock:
    """Raw time that goes on by 10 ms with each reading; the others stand."""

    def __init__(self) -> None:
        self.now_ns = ORIGIN_NS

    def raw_ns(self) -> int:
        self.now_ns += 10_000_000
        return self.now_ns

    def monotonic_ns(self) -> int:
        return 0

    realtime_ns = boottime_ns = monotonic_ns


def play(path: Path) -> tuple[list[NmeaSentence], list[Fix]]:
    driver = NmeaLog(path, origin_raw_ns=ORIGIN_NS, realtime=False)
    driver.open()
    samples = list(driver.samples())
    driver.close()
    return [s for s in samples if isinstance(s, NmeaSentence)], [s for s in samples if isinstance(s, Fix)]


def log(folder: Path, *lines: bytes) -> Path:
    path = folder / "log.nmea"
    path.write_bytes(b"".join(lines))
    return path


def clock(text: str) -> bytes:
    return sentence(f"GPRMC,{text},A,4404.1351,N,12118.8556,W,0,0,050224,,,A")


def arrivals(path: Path) -> list[int]:
    """Seconds after the origin."""
    return [((one.stamp.raw_ns or 0) - ORIGIN_NS) // SECOND_NS for one in play(path)[0]]


def test_sentences_arrive_by_the_logs_own_seconds(tmp_path: Path) -> None:
    lines = [line for second in (0, 1, 4) for line in burst(T0_NS + second * SECOND_NS, 47, 7, 24, 135)]
    sentences, fixes = play(log(tmp_path, sentence("GPTXT,hello"), *lines))
    elapsed = [((one.stamp.raw_ns or 0) - ORIGIN_NS) for one in sentences]
    assert elapsed == [0] * 5 + [SECOND_NS] * 4 + [4 * SECOND_NS] * 4
    for second, fix in zip((0, 1, 4), fixes, strict=True):
        assert fix.stamp.gps_ns == T0_NS + second * SECOND_NS
        assert fix.stamp.gps_raw_ns == ORIGIN_NS + second * SECOND_NS
    assert b"".join(one.data for one in sentences) == b"".join([sentence("GPTXT,hello"), *lines])


def test_comments_are_no_data_but_what_is_damaged_is_kept(tmp_path: Path) -> None:
    path = log(
        tmp_path, "# Name: $GPRMC of Zürich!\n".encode(), clock("120000"), b"#\xa0\xa2\x00\n", b"junk\n"
    )
    assert [one.problem for one in play(path)[0]] == ["", "garbage", "garbage"]


@pytest.mark.parametrize(
    ("clocks", "seconds"),
    [
        (["235959", "000000", "000001"], [0, 1, 2]),
        (["120000", "115958", "120001"], [0, 0, 1]),
        (["120005", "110000", "110001"], [0, 0, 1]),
        (["000010", "143444", "143445"], [0, 0, 1]),
        (["120000", "122000"], [0, 1200]),
        (["120000", "", "120001"], [0, 0, 1]),
    ],
)
def test_time_goes_over_midnight_and_never_back(
    tmp_path: Path, clocks: list[str], seconds: list[int]
) -> None:
    assert arrivals(log(tmp_path, *map(clock, clocks))) == seconds


def test_in_real_time_it_waits_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = TickClock()

    def nap(seconds: float) -> None:
        assert 0 < seconds <= 0.1
        ticks.now_ns += round(seconds * SECOND_NS)

    monkeypatch.setattr("time.sleep", nap)
    driver = NmeaLog(log(tmp_path, clock("120000"), clock("120001")), realtime=True, clock=ticks)
    driver.open()
    samples = list(driver.samples())
    driver.close()
    first, fix, *waits, second, last_fix = samples
    assert isinstance(first, NmeaSentence)
    assert isinstance(fix, Fix)  # told before the wait, not a second later
    assert len(waits) >= 9
    assert set(waits) == {None}
    assert isinstance(second, NmeaSentence)
    assert isinstance(last_fix, Fix)
    assert (second.stamp.raw_ns or 0) - (first.stamp.raw_ns or 0) == SECOND_NS


@pytest.mark.parametrize(
    "data", [b"", b"# comment\n", b"hello\n", spoilt(clock("120000")), bytes(range(256)) * 9]
)
def test_a_log_without_a_sound_sentence_is_refused(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(SourceError, match="no sound NMEA sentence") as caught:
        NmeaLog(log(tmp_path, data), realtime=False).open()
    assert "\n" not in str(caught.value)


def test_what_cannot_be_read_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "none.log", tmp_path):
        with pytest.raises(SourceError, match=r"cannot be read|not a file"):
            NmeaLog(path, realtime=False).open()


def test_it_may_be_played_again(tmp_path: Path) -> None:
    driver = NmeaLog(log(tmp_path, clock("120000")), realtime=False)
    for _ in range(2):
        driver.open()
        assert len(list(driver.samples())) == 2
        driver.close()
        driver.close()
