"""What is done to bring a receiver to say what serves, step by step, with a clock of the test's."""

from collections.abc import Iterable
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorder.drivers import sirf
from recorder.drivers.gnss_setup import (
    ANSWER_NS,
    BINARY_NS,
    BYTES_A_RATE,
    DWELL_NS,
    FRAMING_ERRORS,
    GARBAGE_BYTES,
    LEAVING_NS,
    RATES,
    TRIES,
    WATCH_NS,
    Action,
    ReceiverSetup,
    Say,
    Send,
    SetBaud,
)
from recorder.drivers.nmea import SentenceSplitter
from recorder.errors import DeviceUnsuitable
from recorder.simulation.nmea_pty import burst, sentence, spoilt
from recorder.simulation.sirf_receiver import Instant, binary_burst

SECOND_NS = 1_000_000_000
T0_NS = 1_700_000_000 * SECOND_NS
NMEA = burst(T0_NS, 47, 7, 24, 135)
SIRF = b"".join(binary_burst(Instant(T0_NS, 47, 7)))
UBX = bytes.fromhex("b562060000000618") * 6
GSV = sentence("GPGSV,1,1,01,15,40,083,46")
NOISE = bytes((0x00, 0x80, 0x78, 0xF8, 0xE0)) * 40


class Bench:
    """A setup, its splitter and a clock; keeps all that was asked for."""

    def __init__(self, *rates: int, configure: bool = True) -> None:
        self.setup = ReceiverSetup(rates or RATES, configure=configure, where="/dev/ttyUSB0")
        self.splitter = SentenceSplitter()
        self.now_ns = 5 * SECOND_NS
        self.actions: list[Action] = []

    def hear(self, *chunks: bytes, step_ns: int = SECOND_NS // 100, framing_errors: int = 0) -> list[Action]:
        """Chunk after chunk; what was asked for meanwhile."""
        before = len(self.actions)
        for chunk in chunks:
            self.now_ns += step_ns
            pieces = self.splitter.feed(chunk, self.now_ns)
            self.actions += self.setup.hear(chunk, pieces, self.now_ns, framing_errors=framing_errors)
        return self.actions[before:]

    def silence(self, ns: int) -> list[Action]:
        return self.hear(*[b""] * (ns // (SECOND_NS // 10) + 1), step_ns=SECOND_NS // 10)

    def said(self) -> list[str]:
        return [action.message for action in self.actions if isinstance(action, Say)]


def rates(actions: Iterable[Action]) -> list[int]:
    return [action.baud for action in actions if isinstance(action, SetBaud)]


def sends(actions: Iterable[Action]) -> list[bytes]:
    return [action.data for action in actions if isinstance(action, Send)]


def test_a_sound_sentence_proves_the_rate() -> None:
    bench = Bench()
    bench.hear(NMEA[0])
    assert (bench.setup.baud, bench.setup.speaks) == (4800, "NMEA")
    assert bench.said() == ["speaks NMEA at 4800 baud"]


def test_one_sentence_in_which_a_digit_is_wrong_proves_nothing() -> None:
    bench = Bench()
    bench.hear(spoilt(NMEA[0]), NMEA[1][:20])
    assert bench.setup.speaks == ""


def test_an_echo_of_our_own_commands_proves_nothing() -> None:
    bench = Bench()
    bench.hear(sirf.only_serving())
    assert bench.setup.speaks == ""


def test_a_silent_line_is_listened_to_at_every_rate_longer_each_round() -> None:
    bench = Bench()
    changes: list[tuple[int, int]] = []
    began_ns = bench.now_ns
    while len(changes) < 4 * len(RATES):
        for baud in rates(bench.silence(0)):
            changes.append((baud, bench.now_ns - began_ns))
            began_ns = bench.now_ns
    assert [baud for baud, _ in changes] == [*RATES[1:], RATES[0]] * 4
    for number, (_, took_ns) in enumerate(changes):
        dwell_ns = DWELL_NS << min(number // len(RATES), 2)
        assert dwell_ns < took_ns < dwell_ns + SECOND_NS // 4
    assert bench.said() == [
        "no NMEA at any rate from 4800 to 115200 baud, nothing at all; going on to listen"
    ]


def test_garbage_is_left_before_the_time_is_up() -> None:
    bench = Bench()
    assert rates(bench.hear(*[NOISE] * (BYTES_A_RATE // len(NOISE) + 1))) == [9600]


def test_framing_errors_are_left_at_once() -> None:
    bench = Bench()
    assert rates(bench.hear(NOISE[:16], framing_errors=FRAMING_ERRORS)) == [9600]


def test_the_rates_go_round_until_one_serves() -> None:
    bench = Bench()
    while bench.setup.baud != 57600:
        bench.hear(NOISE)
    bench.hear(*NMEA)
    assert bench.setup.speaks == "NMEA"
    assert rates(bench.actions) == [9600, 38400, 57600]


def test_a_given_rate_is_never_left() -> None:
    bench = Bench(9600)
    bench.hear(*[NOISE] * 40)
    bench.silence(10 * SECOND_NS)
    assert rates(bench.actions) == []
    assert len(bench.said()) == 1
    assert bench.said()[0].startswith("no NMEA at 9600 baud")


def test_lines_without_sound_checksums_prove_the_rate_too() -> None:
    bench = Bench()
    bench.hear(*[line.partition(b"*")[0] + b"\r\n" for line in NMEA])
    assert bench.setup.speaks == "NMEA"
    assert "no sound checksums" in bench.said()[0]


def test_sirf_binary_is_told_to_speak_nmea_at_the_same_rate() -> None:
    bench = Bench()
    asked = bench.hear(SIRF[37:])
    assert sends(asked) == [sirf.switch_to_nmea(4800, dict.fromkeys(sirf.SERVING, 1))]
    assert "SiRF binary" in bench.said()[0]
    bench.hear(*NMEA)
    assert bench.said()[1] == "speaks NMEA at 4800 baud, switched from SiRF binary"


def test_sirf_binary_at_115200_is_followed_to_the_rate_that_the_command_can_name() -> None:
    bench = Bench(115200, 4800)
    asked = bench.hear(SIRF)
    assert sends(asked) == [sirf.switch_to_nmea(57600, dict.fromkeys(sirf.SERVING, 1))]
    assert rates(asked) == [], "what was written has not left yet"
    assert rates(bench.silence(LEAVING_NS)) == [57600]
    bench.hear(*NMEA)
    assert bench.setup.speaks == "NMEA"


def test_sirf_binary_that_goes_on_is_refused_after_three_commands() -> None:
    bench = Bench()
    with pytest.raises(DeviceUnsuitable, match=r"speaks SiRF binary, not NMEA.*does not obey"):
        bench.hear(*[SIRF] * 100, step_ns=ANSWER_NS // 10)
    assert len(sends(bench.actions)) == TRIES


def test_sirf_binary_is_refused_by_name_where_nothing_may_be_written() -> None:
    bench = Bench(configure=False)
    with pytest.raises(DeviceUnsuitable, match=r"speaks SiRF binary.*configure = true"):
        bench.hear(SIRF)
    assert sends(bench.actions) == []


def test_another_protocol_is_refused_by_name_and_never_written_to() -> None:
    bench = Bench()
    with pytest.raises(DeviceUnsuitable, match=r"/dev/ttyUSB0: speaks UBX, not NMEA; switch it"):
        bench.hear(*[UBX] * 20, step_ns=BINARY_NS // 10)
    assert sends(bench.actions) == []


def test_a_receiver_that_mixes_binary_frames_with_nmea_is_taken() -> None:
    bench = Bench()
    bench.hear(UBX, UBX, *NMEA, UBX)
    assert bench.setup.speaks == "NMEA"


def test_with_configure_off_nothing_is_written_and_nothing_judged() -> None:
    bench = Bench(configure=False)
    bench.hear(*[*NMEA, GSV] * 30)
    assert sends(bench.actions) == []
    assert bench.setup.obeys is None


def test_a_receiver_that_says_what_it_was_told_to_obeys() -> None:
    bench = Bench()
    bench.hear(*NMEA[:3], GSV)
    assert sends(bench.actions) == [sirf.only_serving()]
    bench.hear(*NMEA[:3], GSV)  # what it says before it has read the command does not count
    bench.hear(*NMEA * 10)
    assert bench.setup.obeys
    assert bench.said()[-1] == "obeys: ZDA, GGA, GSA, RMC and nothing else"
    assert sends(bench.actions) == [sirf.only_serving()]


def test_a_receiver_that_does_not_obey_is_told_three_times_and_recorded_as_it_is() -> None:
    bench = Bench()
    bench.hear(*[*NMEA[:3], GSV] * 60)
    assert sends(bench.actions) == [sirf.only_serving()] * TRIES
    assert bench.setup.obeys is False
    assert bench.said()[1:] == ["does not obey $PSRF103: ZDA missing; GSV still said; recorded as it is"]


def test_gsv_in_every_fifth_burst_is_noticed() -> None:
    bench = Bench()
    for number in range(60):
        bench.hear(*NMEA, *([GSV] if number % 5 == 0 else []))
    assert bench.setup.obeys is False


def test_a_receiver_that_forgets_its_settings_is_told_again() -> None:
    bench = Bench()
    bench.hear(*NMEA * 10)
    assert bench.setup.obeys
    bench.hear(*[*NMEA[:3], GSV] * 8)
    assert len(sends(bench.actions)) == 2


def test_a_receiver_that_falls_silent_is_told_what_to_say() -> None:
    bench = Bench()
    bench.hear(*NMEA * 10)
    bench.silence(2 * WATCH_NS)
    assert len(sends(bench.actions)) >= 2


def test_a_receiver_that_changes_its_rate_is_looked_for_again() -> None:
    bench = Bench()
    bench.hear(*NMEA)
    bench.hear(*[NOISE] * (GARBAGE_BYTES // len(NOISE) + 1))
    assert bench.setup.speaks == ""
    assert "no NMEA any more at 4800 baud" in bench.said()[-1]
    bench.hear(*[NOISE] * 4)
    bench.hear(*NMEA)
    assert (bench.setup.baud, bench.setup.speaks) == (9600, "NMEA")


def test_a_receiver_that_falls_back_to_binary_is_switched_again() -> None:
    bench = Bench()
    bench.hear(*NMEA)
    bench.hear(*[SIRF] * 12)
    assert sends(bench.actions)[-1] == sirf.switch_to_nmea(4800, dict.fromkeys(sirf.SERVING, 1))


def test_bad_checksums_and_cut_lines_do_not_lose_the_rate() -> None:
    bench = Bench()
    bench.hear(*NMEA)
    bench.hear(*[spoilt(line) for line in NMEA * 20], *[line[:40] + b"\r\n" for line in NMEA * 20])
    assert bench.setup.speaks == "NMEA"
    assert rates(bench.actions) == []


noise = st.one_of(
    st.binary(max_size=300),
    st.sampled_from([*NMEA, GSV, SIRF, SIRF[50:], UBX, NOISE, b"", sirf.only_serving(), spoilt(NMEA[0])]),
)


@given(st.lists(st.tuples(noise, st.integers(0, 2 * SECOND_NS)), max_size=40), st.booleans())
def test_whatever_arrives_it_keeps_to_its_rates_and_raises_only_refusals(
    heard: list[tuple[bytes, int]], configure: bool
) -> None:
    bench = Bench(configure=configure)
    with suppress(DeviceUnsuitable):
        for data, step_ns in heard:
            bench.hear(data, step_ns=step_ns)
    assert set(rates(bench.actions)) <= set(RATES)
    assert configure or not sends(bench.actions)
