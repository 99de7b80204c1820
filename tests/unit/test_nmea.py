"""NMEA: no byte is lost, what is told is read to the last digit, and no fix is claimed without one."""

from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorder.drivers.nmea import (
    DAY_NS,
    LONGEST_LINE,
    SECOND_NS,
    FixAssembler,
    SentenceSplitter,
    degrees,
    parse,
    time_of_day,
)
from recorder.samples import Fix, NmeaSentence, Stamp
from recorder.simulation.nmea_pty import burst, sentence, spoilt

RMC = sentence("GPRMC,120000.000,A,4404.1351,N,12118.8556,W,10.00,359.11,050224,,,A")
GGA = sentence("GPGGA,120000.000,4404.1351,N,12118.8556,W,1,08,0.9,1123.9,M,-19.6,M,,0000")
NOON_NS = int(datetime(2024, 2, 5, 12, tzinfo=UTC).timestamp()) * SECOND_NS

noise = st.one_of(
    st.binary(max_size=400),
    st.sampled_from([RMC, GGA, spoilt(RMC), RMC[:30], RMC[20:], b"\n", b"\r\n", b"$", b"!", b"$" * 3]),
    st.text("$!*\r\nGPRMC,019", max_size=40).map(str.encode),
)


def split(data: bytes, *cuts: int) -> list[NmeaSentence]:
    splitter = SentenceSplitter()
    ends = sorted({min(cut, len(data)) for cut in cuts} | {len(data)})
    pieces, start = [], 0
    for end in ends:
        pieces += splitter.feed(data[start:end], end)
        start = end
    return pieces + splitter.flush()


def fixes(*lines: bytes) -> list[Fix]:
    """Each line arrives a second of raw time after the former; the stream ends."""
    assembler = FixAssembler()
    told = [
        assembler.add(piece)
        for number, line in enumerate(lines)
        for piece in SentenceSplitter().feed(line, number * SECOND_NS)
    ]
    return [fix for fix in [*told, assembler.silence()] if fix is not None]


@given(st.lists(noise, max_size=20).map(b"".join), st.lists(st.integers(0, 2000), max_size=20))
def test_no_byte_is_lost_and_the_reads_do_not_matter(data: bytes, cuts: list[int]) -> None:
    pieces = split(data, *cuts)
    assert b"".join(piece.data for piece in pieces) == data
    assert [(piece.data, piece.problem) for piece in pieces] == [
        (piece.data, piece.problem) for piece in split(data)
    ]
    assert all(0 < len(piece.data) <= LONGEST_LINE for piece in pieces)


@given(st.lists(noise, max_size=10).map(b"".join))
def test_nothing_that_arrives_raises(data: bytes) -> None:
    assembler = FixAssembler()
    for piece in split(data):
        assembler.add(piece)
    assembler.silence()


def test_a_sentence_is_stamped_by_its_first_byte() -> None:
    splitter = SentenceSplitter()
    assert splitter.feed(b"tail*00\r\n" + RMC[:1], 10)[0].stamp.raw_ns == 10
    assert splitter.feed(RMC[1:40], 20) == []
    first, second = splitter.feed(RMC[40:] + GGA, 30)
    assert (first.stamp.raw_ns, second.stamp.raw_ns) == (10, 30)
    assert (first.data, first.problem) == (RMC, "")


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (RMC, ""),
        (RMC.replace(b"\r\n", b"\n"), ""),
        (RMC.replace(b"\r\n", b"\r\r\n"), ""),
        (sentence("PGRMC,A,218.8,100,6378137.000,298.257223563"), ""),
        (spoilt(RMC), "checksum"),
        (sentence("GPGGA,120000,4404.1,N,12118.8,W,1,eight,0.9"), "fields"),
        (b"$GPRMC,120000.000,A\r\n", "cut"),
        (RMC[30:], "cut"),
        (b"\xa0\xa2\x00\x12\xb0\xb3", "garbage"),
        (b"$GP\x00\x01\r\n", "garbage"),
        (b"$" + b"A" * (LONGEST_LINE - 1), "garbage"),
        (b"\r\n", "garbage"),
    ],
)
def test_whatever_is_no_sound_sentence_says_why(data: bytes, problem: str) -> None:
    assert [(piece.data, piece.problem) for piece in split(data)] == [(data, problem)]


def test_a_sentence_that_lost_its_line_end_is_still_sound() -> None:
    assert [piece.problem for piece in split(RMC.rstrip() + GGA)] == ["", ""]


@given(st.integers(0, 90 * 60 * 10**7), st.sampled_from("NS"))
def test_positions_keep_every_digit(tens_of_nanominutes: int, hemisphere: str) -> None:
    minutes, fraction = divmod(tens_of_nanominutes, 10**7)
    text = f"{minutes // 60:02d}{minutes % 60:02d}.{fraction:07d}"
    read = degrees(text, hemisphere)
    assert read is not None
    assert round(abs(read) * 60 * 10**7) == tens_of_nanominutes
    assert read <= 0 if hemisphere == "S" else read >= 0


@pytest.mark.parametrize(
    ("text", "hemisphere"),
    [
        ("", "N"),
        ("4404.1", ""),
        ("9000.1", "N"),
        ("4460.0", "N"),
        ("nan", "N"),
        ("-404.1", "N"),
        ("44041e3", "N"),
    ],
)
def test_a_position_that_is_none_is_never_zero(text: str, hemisphere: str) -> None:
    assert degrees(text, hemisphere) is None


@given(st.integers(0, DAY_NS - 1))
def test_a_time_of_day_is_read_to_the_nanosecond(time_ns: int) -> None:
    seconds, rest_ns = divmod(time_ns, SECOND_NS)
    text = f"{seconds // 3600:02d}{seconds // 60 % 60:02d}{seconds % 60:02d}.{rest_ns:09d}"
    assert time_of_day(text) == time_ns


@pytest.mark.parametrize(
    "text", ["", "1200", "240000", "126000", "120061", "12:00:00", "120000.5x", "١٢٠٠٠٠"]
)
def test_what_is_no_time_of_day_is_none(text: str) -> None:
    assert time_of_day(text) is None


def test_a_burst_becomes_one_fix_stamped_by_its_first_sentence() -> None:
    gsa = sentence("GPGSA,A,3,15,17,30,28,,,,,,,,,1.8,0.9,1.5")
    (fix,) = fixes(gsa, GGA, RMC)
    assert fix.stamp == Stamp(raw_ns=0, gps_ns=NOON_NS, gps_raw_ns=0)
    assert (fix.valid, fix.mode, fix.satellites, fix.hdop, fix.altitude_m) == (True, "A/A/1", 8, 0.9, 1123.9)
    assert fix.latitude_deg == pytest.approx(44 + 4.1351 / 60, abs=1e-9)
    assert fix.longitude_deg == pytest.approx(-(121 + 18.8556 / 60), abs=1e-9)
    assert fix.speed_m_s == pytest.approx(5.14444, abs=1e-5)
    assert fix.course_deg == 359.11


@given(st.integers(0, 4 * 10**18), st.floats(-90, 90), st.floats(-180, 180))
def test_what_the_twin_says_is_what_is_read(utc_ns: int, latitude_deg: float, longitude_deg: float) -> None:
    (fix,) = fixes(*burst(utc_ns, latitude_deg, longitude_deg, 24.0, 135.0))
    assert fix.stamp.gps_ns == utc_ns // 10**6 * 10**6
    assert fix.valid
    assert fix.latitude_deg == pytest.approx(latitude_deg, abs=0.5e-4 / 60 + 1e-9)
    assert fix.longitude_deg == pytest.approx(longitude_deg, abs=0.5e-4 / 60 + 1e-9)


def test_another_time_of_day_ends_a_burst() -> None:
    first, second = burst(NOON_NS, 47, 7, 24, 135), burst(NOON_NS + SECOND_NS, 47, 7, 24, 135)
    told = fixes(*first, *second)
    assert [fix.stamp.gps_ns for fix in told] == [NOON_NS, NOON_NS + SECOND_NS]
    assert [fix.stamp.gps_raw_ns for fix in told] == [0, 4 * SECOND_NS]


def test_a_receiver_without_time_ends_a_burst_by_repeating_itself() -> None:
    told = fixes(*[sentence("GPRMC,,V,,,,,,,,,,N"), sentence("GPZDA,,,,,00,00")] * 3)
    assert [(fix.valid, fix.mode, fix.stamp.gps_ns, fix.latitude_deg) for fix in told] == [
        (False, "V/N/-", None, None)
    ] * 3


def test_what_comes_late_after_a_silence_belongs_to_its_burst() -> None:
    assembler = FixAssembler()
    assert assembler.add(NmeaSentence(Stamp(raw_ns=5), RMC)) is None
    early = assembler.silence()
    assert early is not None
    assert assembler.silence() is None
    assert assembler.add(NmeaSentence(Stamp(raw_ns=700_000_000), GGA)) is None
    full = assembler.silence()
    assert full is not None
    assert (early.stamp, early.satellites) == (full.stamp, None)
    assert full.satellites == 8


@pytest.mark.parametrize(
    ("status", "mode", "quality", "valid"),
    [
        ("A", "A", "1", True), ("A", "D", "2", True), ("A", "", "1", True), ("A", "R", "4", True),
        ("A", "F", "5", True), ("A", "D", "9", True), ("A", "A", "3", True),
        ("V", "A", "1", False), ("V", "N", "0", False), ("A", "N", "1", False), ("A", "E", "6", False),
        ("A", "M", "7", False), ("A", "S", "8", False), ("V", "S", "8", False), ("A", "A", "0", False),
        ("A", "A", "6", False), ("A", "A", "", False), ("", "", "1", False),
    ],
)  # fmt: skip
def test_estimated_manual_and_simulated_positions_are_no_fixes(
    status: str, mode: str, quality: str, valid: bool
) -> None:
    rmc = sentence(f"GNRMC,120000.000,{status},4404.1351,N,12118.8556,W,0,0,050224,,,{mode}")
    gga = sentence(f"GNGGA,120000.000,4404.1351,N,12118.8556,W,{quality},08,0.9,1,M,1,M,,")
    assert [fix.valid for fix in fixes(rmc, gga)] == [valid]


@pytest.mark.parametrize(
    ("lines", "problem"),
    [
        ([RMC, GGA], ""),
        ([RMC.replace(b",A,4404", b",V,4404")], "status V"),
        ([sentence("GPRMC,120000,A,4404.1,N,12118.8,W,0,0,050224,,,E")], "mode E, estimated"),
        ([sentence("GPRMC,120000,A,4404.1,N,12118.8,W,0,0,050224,,,S")], "mode S, simulated"),
        ([sentence("GPRMC,120000,A,4404.1,N,12118.8,W,0,0,050224,,,N")], "mode N, no fix"),
        ([sentence("GPGGA,120000,4404.1,N,12118.8,W,0,00,,,M,,M,,")], "quality 0, no fix"),
        ([sentence("GPGGA,120000,4404.1,N,12118.8,W,1,00,,,M,,M,,")], "no satellite used"),
        ([GGA, sentence("GPGSA,A,1,,,,,,,,,,,,,,,")], "no fix, says GSA"),
        ([sentence("GPRMC,,A,4404.1,N,12118.8,W,0,0,050224,,,A")], "no time"),
        ([sentence("GPRMC,120000,A,,,,,,,050224,,,A")], "no position"),
    ],
)
def test_a_fix_that_is_none_says_why(lines: list[bytes], problem: str) -> None:
    lines = [sentence(line[1:-5].decode()) for line in lines]  # the checksum after a change
    (fix,) = fixes(*lines)
    assert (fix.valid, fix.problem) == (not problem, problem)


def test_of_several_constellations_the_best_gsa_counts() -> None:
    none, three = sentence("GNGSA,A,1,,,,,,,,,,,,,,,"), sentence("GNGSA,A,3,65,70,71,72,,,,,,,,,1.8,0.9,1.5")
    (fix,) = fixes(GGA, none, three, none, RMC)
    assert (fix.valid, fix.dimensions) == (True, 3)


def test_a_burst_that_was_under_way_when_listening_began_dates_nothing() -> None:
    second = burst(NOON_NS + SECOND_NS, 47, 7, 24, 135)
    assembler = FixAssembler()
    assembler.interrupted()
    told = [
        assembler.add(NmeaSentence(Stamp(raw_ns=raw_ns), line)) for raw_ns, line in enumerate([RMC, *second])
    ]
    assert [fix.stamp.gps_raw_ns for fix in [*told, assembler.silence()] if fix] == [None, 1]


def test_after_a_silence_a_burst_is_heard_from_its_start() -> None:
    assembler = FixAssembler()
    assembler.interrupted()
    assembler.silence()
    assembler.add(NmeaSentence(Stamp(raw_ns=7), RMC))
    fix = assembler.silence()
    assert fix is not None
    assert fix.stamp.gps_raw_ns == 7


def test_bursts_that_had_waited_before_they_were_read_date_nothing() -> None:
    assembler = FixAssembler()
    assembler.interrupted()
    lines = [burst(NOON_NS + second * SECOND_NS, 47, 7, 24, 135)[2] for second in range(5)]
    told = [
        assembler.add(NmeaSentence(Stamp(raw_ns=raw_ns), line), dated=raw_ns > 2)
        for raw_ns, line in enumerate(lines)
    ]
    assert [fix.stamp.gps_raw_ns for fix in [*told, assembler.silence()] if fix] == [None, None, None, 3, 4]


def test_a_fix_without_a_position_is_not_valid() -> None:
    assert not fixes(sentence("GPRMC,120000,A,,,,,,,050224,,,A"))[0].valid


def test_a_gga_alone_that_counts_no_satellite_is_no_fix() -> None:
    none = sentence("GPGGA,120000.000,4404.1351,N,12118.8556,W,1,00,0.9,1,M,1,M,,")
    assert [fix.valid for fix in fixes(none)] == [False]
    assert [fix.valid for fix in fixes(none, RMC)] == [True]


def test_of_several_constellations_the_one_with_a_fix_counts() -> None:
    none = sentence("GPGGA,120000.000,,,,,0,00,,,M,,M,,")
    other = sentence("GLGGA,120000.000,4404.1351,N,12118.8556,W,1,05,1.2,1123.9,M,-19.6,M,,")
    (fix,) = fixes(none, other, RMC)
    assert (fix.valid, fix.mode, fix.satellites) == (True, "A/A/1", 5)


def test_the_leap_second_is_the_next_days_first_second() -> None:
    (fix,) = fixes(sentence("GPRMC,235960.000,A,4404.1351,N,12118.8556,W,0,0,311216,,,A"))
    assert fix.stamp.gps_ns == int(datetime(2017, 1, 1, tzinfo=UTC).timestamp()) * SECOND_NS
    assert fix.leap_second
    assert not fixes(RMC)[0].leap_second


def test_the_last_date_serves_until_midnight() -> None:
    def gga(clock: str) -> bytes:
        return sentence(f"GPGGA,{clock},4404.1351,N,12118.8556,W,1,08,0.9,1,M,1,M,,")

    told = fixes(gga("115959"), RMC, gga("120001"), gga("235959"), gga("000000"), gga("000001"))
    assert [fix.stamp.gps_ns for fix in told] == [
        None, NOON_NS, NOON_NS + SECOND_NS, NOON_NS + DAY_NS // 2 - SECOND_NS, None, None,
    ]  # fmt: skip


@pytest.mark.parametrize(("told", "year"), [("80", 1980), ("99", 1999), ("00", 2000), ("79", 2079)])
def test_a_year_of_two_digits_is_after_gps_began(told: str, year: int) -> None:
    (fix,) = fixes(sentence(f"GPRMC,000000,A,4404.1351,N,12118.8556,W,0,0,0601{told},,,A"))
    assert fix.stamp.gps_ns == int(datetime(year, 1, 6, tzinfo=UTC).timestamp()) * SECOND_NS


@pytest.mark.parametrize("date", ["310224", "000024", "3102", ""])
def test_a_date_that_is_none_tells_no_time(date: str) -> None:
    (fix,) = fixes(sentence(f"GPRMC,120000,A,4404.1351,N,12118.8556,W,0,0,{date},,,A"))
    assert fix.stamp.gps_ns is None


def test_only_sound_timed_sentences_are_parsed() -> None:
    for data in (spoilt(RMC), sentence("GPGSV,1,1,00"), sentence("PGRMC,A"), b"junk\n"):
        assert [parse(piece) for piece in split(data)] == [None]
