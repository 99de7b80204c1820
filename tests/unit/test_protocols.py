"""Binary protocols are told by whole sound frames, wherever in the stream one begins to listen."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorder.drivers import sirf
from recorder.drivers.protocols import recognise
from recorder.simulation.nmea_pty import burst, sentence
from recorder.simulation.sirf_receiver import Instant, binary_burst, binary_message, misread

FRAMES = {
    # as published: u-blox's own example of a checksum (a poll of CFG-PRT)
    "UBX": bytes.fromhex("b562060000000618"),
    # the RTCM 3 standard's example of a station's coordinates, message 1005
    "RTCM 3": bytes.fromhex("d300133ed7d30202980edeef34b4bd62ac0941986f33360b98"),
    # SkyTraq's application note: query the software version, and its acknowledgement
    "SkyTraq binary": bytes.fromhex("a0a100020200020d0a") + bytes.fromhex("a0a1000283 02810d0a"),
    # Garmin's interface specification: an acknowledgement of packet 10
    "Garmin binary": bytes.fromhex("1006020a00ee1003"),
    # Trimble's manuals: health of receiver, 46
    "TSIP": bytes.fromhex("104600081003"),
}
# made here after the maker's description, byte by byte
FRAMES["Motorola Oncore"] = b"@@Cj" + bytes((ord("C") ^ ord("j"),)) + b"\r\n"
FRAMES["Navcom"] = b"\x02\x99\x66" + b"\x06\x04\x00" + bytes((0x06 ^ 0x04,)) + b"\x03"
FRAMES["Zodiac"] = bytes.fromhex("ff81 e803 0000 0000 197a")
FRAMES["iTalk"] = b"<!" + bytes((1, 2, 3, 4, 1, 5, 0)) + b"\x05\x00>"
FRAMES["SiRF binary"] = binary_message(b"\x29" + bytes(90))


@pytest.mark.parametrize("name", FRAMES)
def test_each_protocol_is_told_by_its_name(name: str) -> None:
    assert set(recognise(FRAMES[name])) == {name}


@pytest.mark.parametrize("name", FRAMES)
def test_a_frame_is_found_behind_the_rest_of_another_and_before_noise(name: str) -> None:
    frame = FRAMES[name]
    found = recognise(frame[len(frame) // 2 :] + frame + b"\x00\xff" + frame + frame[:3])
    assert found[name] >= 2


@pytest.mark.parametrize(
    "name", ["UBX", "RTCM 3", "SkyTraq binary", "Garmin binary", "SiRF binary", "Navcom"]
)
def test_a_frame_with_any_bit_wrong_is_none(name: str) -> None:
    frame = recognise_one(name)
    for bit in range(8 * len(frame)):
        spoilt = bytearray(frame)
        spoilt[bit // 8] ^= 1 << bit % 8
        if name == "SiRF binary" and bit == 8 * (len(frame) - 4) + 7:
            continue  # the sum has 15 bits
        assert recognise(bytes(spoilt))[name] == 0, bit


def recognise_one(name: str) -> bytes:
    """The first frame alone."""
    frame = FRAMES[name]
    return frame[:9] if name == "SkyTraq binary" else frame


@given(st.binary(max_size=600))
def test_nothing_that_arrives_raises_or_is_taken_for_sirf(data: bytes) -> None:
    assert recognise(data)["SiRF binary"] == 0


def test_nmea_is_no_binary_protocol() -> None:
    assert recognise(b"".join(burst(1_700_000_000 * 10**9, 47, 7, 24, 135)) * 20) == Counter()


@given(st.integers(0, 500), st.integers(0, 500))
def test_sirf_binary_is_recognised_from_any_byte_on(start: int, length: int) -> None:
    said = b"".join(binary_burst(Instant(1_700_000_000 * 10**9, 47, 7))) * 3
    heard = said[start : start + 400 + length]
    assert recognise(heard)["SiRF binary"] >= 1


@given(st.binary(max_size=400))
def test_what_is_framed_is_recognised_whatever_it_holds(payload: bytes) -> None:
    assert recognise(sirf.frame(b"\x04" + payload)) == Counter({"SiRF binary": 1})


def test_commands_are_those_of_the_makers_manual() -> None:
    assert sirf.set_serial(nmea=True, baud=9600) == b"$PSRF100,1,9600,8,1,0*0D\r\n"
    assert sirf.set_serial(nmea=False, baud=9600) == b"$PSRF100,0,9600,8,1,0*0C\r\n"
    assert sirf.set_interval("ZDA", 1) == b"$PSRF103,08,00,01,01*2D\r\n"
    assert sirf.set_interval("GSV", 0) == b"$PSRF103,03,00,00,01*27\r\n"
    # gpsd, gpsbabel and the EM-411's guide send the same, but for the intervals
    assert sirf.switch_to_nmea(4800, {"GGA": 1, "GSA": 1, "GSV": 5, "RMC": 1}) == bytes.fromhex(
        "a0a20018 8102 0101 0001 0101 0501 0101 0001 0001 0001 0001 0001 12c0 0167 b0b3"
    )


def test_only_what_serves_is_switched_on() -> None:
    said = sirf.only_serving().split(b"\r\n")[:-1]
    assert [line for line in said if b",00,01,01*" in line] == [
        sirf.set_interval(kind, 1).rstrip() for kind in ("GGA", "GSA", "RMC", "ZDA")
    ]
    assert sum(b",00,00,01*" in line for line in said) == 4


@given(st.binary(min_size=1, max_size=60), st.sampled_from([4800, 9600, 38400, 57600, 115200]))
def test_at_its_own_rate_a_line_is_read_as_it_was_said(data: bytes, baud: int) -> None:
    assert misread(data, baud, baud) == data
    assert misread(data, baud, round(baud * 1.02)) == data  # a UART bears two in a hundred


def test_nmea_at_a_wrong_rate_is_taken_for_no_binary_protocol() -> None:
    """A name is a refusal, so it takes two frames of one protocol; here there is none at all."""
    rates = (4800, 9600, 19200, 38400, 57600, 115200)
    said = b"".join(b"".join(burst((1_700_000_000 + n) * 10**9, 47, 7, 24, 135)) for n in range(4))
    for own in rates:
        for heard in rates:
            assert max(recognise(misread(said, own, heard)).values(), default=0) < 2, (own, heard)


@pytest.mark.parametrize(("said", "heard"), [(4800, 9600), (4800, 115200), (115200, 4800), (9600, 4800)])
def test_at_another_rate_no_sentence_is_read(said: int, heard: int) -> None:
    line = sentence("GPRMC,120000.000,A,4404.1351,N,12118.8556,W,10.00,359.11,050224,,,A") * 5
    assert b"GPRMC" not in misread(line, said, heard)
