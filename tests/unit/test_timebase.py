"""Clock algebra in whole nanoseconds, the report's combined time, UTC that never steps back."""

import json
from concurrent.futures import ThreadPoolExecutor

from hypothesis import given
from hypothesis import strategies as st

from recorder.clock import SYSTEM_CLOCK
from recorder.config import TimebaseSection
from recorder.samples import ClockPair, Fix, Stamp
from recorder.timebase import ClockHistory, Timebase, take_pair

SECOND_NS = 1_000_000_000
DAY_NS = 86_400 * SECOND_NS
BOOT_NS = 1_700_000_000 * SECOND_NS
SETTINGS = TimebaseSection(gnss_delay_ms=600, gnss_delay_sigma_ms=300).believing_every_date

instants = st.integers(0, 2**62)
short = st.integers(0, 3600 * SECOND_NS)


class FakeClock:
    """Stands still unless it is told; ``cost_ns`` is what each reading takes."""

    def __init__(self) -> None:
        self.now_ns = 1000 * SECOND_NS
        self.wall_ns = BOOT_NS
        self.costs_ns: list[int] = []

    def _read(self) -> int:
        self.now_ns += self.costs_ns.pop(0) if self.costs_ns else 0
        return self.now_ns

    def raw_ns(self) -> int:
        return self._read()

    def monotonic_ns(self) -> int:
        return self._read() + 7

    def realtime_ns(self) -> int:
        return self._read() + self.wall_ns

    def boottime_ns(self) -> int:
        return self._read() + 11


def fix(gps_ns: int | None, raw_ns: int, *, valid: bool = True) -> Fix:
    return Fix(Stamp(raw_ns=raw_ns, gps_ns=gps_ns, gps_raw_ns=raw_ns), valid=valid, mode="A/A/1")


def refined(timebase: Timebase, stamp: Stamp) -> Stamp:
    return timebase.complete(timebase.refine(stamp))


def pair(raw_ns: int, realtime_ns: int, monotonic_ns: int = 0) -> ClockPair:
    return ClockPair(raw_ns, monotonic_ns, realtime_ns, 0, 0)


def test_the_tightest_of_several_brackets_is_taken() -> None:
    clock = FakeClock()
    clock.costs_ns = [0, 50, 50, 50, 50, 1000, 10, 10, 10, 10, 1000, 90, 90, 90, 90]
    taken = take_pair(clock, tries=3)
    assert taken.bracket_ns == 40
    start_ns = taken.raw_ns - 20
    assert taken.monotonic_ns == start_ns + 10 + 7
    assert taken.realtime_ns == start_ns + 20 + BOOT_NS
    assert taken.boottime_ns == start_ns + 30 + 11


def test_this_machines_clocks_are_compared_within_a_millisecond() -> None:
    taken = take_pair(SYSTEM_CLOCK)
    assert 0 < taken.bracket_ns < SECOND_NS // 1000


def test_the_history_is_bounded_and_empty_tells_nothing() -> None:
    history = ClockHistory(kept=3)
    assert history.raw_from_realtime(0, arrival_ns=0) is None
    assert history.raw_from_monotonic(0, arrival_ns=0) is None
    assert history.realtime_from_raw(0) is None
    assert history.latest is None
    for number in range(10):
        history.add(pair(number, number))
    assert len(history) == 3


@given(instants, instants, short)
def test_combined_time_stands_on_gps_if_a_valid_fix_was_seen_before_the_first_frame(
    gps_ns: int, raw_ns: int, later_ns: int
) -> None:
    timebase = Timebase(SETTINGS, FakeClock())
    timebase.observe(fix(gps_ns, raw_ns))
    timebase.complete(Stamp(raw_ns=raw_ns + 5), frame=True)
    timebase.observe(fix(gps_ns + 17, raw_ns + 2))  # the reference stays
    assert timebase.complete(Stamp(raw_ns=raw_ns + later_ns), frame=True).combined_ns == gps_ns + later_ns


@given(short, instants)
def test_combined_time_stands_on_the_wall_clock_without_a_valid_fix(later_ns: int, gps_ns: int) -> None:
    clock = FakeClock()
    timebase = Timebase(SETTINGS, clock)
    timebase.observe(fix(gps_ns, clock.now_ns, valid=False))
    timebase.observe(fix(None, clock.now_ns))
    first = timebase.complete(Stamp(raw_ns=clock.now_ns), frame=True)
    assert first.combined_ns == first.realtime_ns == clock.now_ns + BOOT_NS
    timebase.observe(fix(gps_ns, clock.now_ns))  # too late for the reference
    later = timebase.complete(Stamp(raw_ns=clock.now_ns + later_ns), frame=True)
    assert later.combined_ns == clock.now_ns + BOOT_NS + later_ns


def test_only_a_frame_fixes_the_reference_of_combined_time() -> None:
    timebase = Timebase(SETTINGS, FakeClock())
    assert timebase.complete(Stamp(raw_ns=1)).combined_ns is None
    timebase.complete(Stamp(raw_ns=2), frame=True)
    assert timebase.complete(Stamp(raw_ns=3)).combined_ns is not None


def test_a_stamp_is_completed_and_the_devices_words_are_kept() -> None:
    clock = FakeClock()
    timebase = Timebase(SETTINGS, clock)
    kernel_ns = clock.now_ns + BOOT_NS - 3_000_000
    told = refined(timebase, Stamp(raw_ns=clock.now_ns, device_ns=42, realtime_ns=kernel_ns))
    assert (told.device_ns, told.realtime_ns, told.raw_ns) == (42, kernel_ns, clock.now_ns - 3_000_000)
    assert (told.gps_ns, told.gps_raw_ns, told.utc_ns, told.utc_sigma_ns) == (None,) * 4
    kernel_ns = clock.now_ns + 7 - 4_000_000
    told = refined(timebase, Stamp(raw_ns=clock.now_ns, monotonic_ns=kernel_ns))
    assert (told.monotonic_ns, told.raw_ns) == (kernel_ns, clock.now_ns - 4_000_000)
    told = refined(timebase, Stamp(raw_ns=clock.now_ns - 5))
    assert (told.raw_ns, told.realtime_ns) == (clock.now_ns - 5, clock.now_ns + BOOT_NS - 5)
    assert told.raw_error_ns is None
    assert refined(timebase, Stamp()).raw_ns == clock.now_ns


def test_utc_of_a_frame_is_of_the_middle_of_its_exposure_and_its_sigma_too() -> None:
    timebase = Timebase(SETTINGS, FakeClock())
    timebase.observe(fix(BOOT_NS, 0))
    plain = timebase.complete(Stamp(raw_ns=SECOND_NS))
    timed = timebase.complete(
        Stamp(raw_ns=SECOND_NS, exposure_raw_ns=SECOND_NS - 9_000_000, exposure_sigma_ns=10**9)
    )
    assert plain.utc_ns is not None
    assert plain.utc_sigma_ns is not None
    assert timed.utc_ns == plain.utc_ns - 9_000_000
    assert timed.utc_sigma_ns is not None
    assert timed.utc_sigma_ns > 10**9 > plain.utc_sigma_ns


def test_the_last_time_told_is_saved_even_without_a_fix() -> None:
    timebase = Timebase(SETTINGS, FakeClock())
    assert timebase.observe(fix(123, 456, valid=False)) is None
    told = timebase.complete(Stamp(raw_ns=500))
    assert (told.gps_ns, told.gps_raw_ns, told.utc_ns) == (123, 456, None)


def test_status_is_plain_json_with_and_without_time() -> None:
    clock = FakeClock()
    timebase = Timebase(SETTINGS, clock)
    told = json.loads(json.dumps(timebase.status()))
    assert (told["source"], told["utc_ns"], told["fix_age_ns"], told["pairs"]) == (None, None, None, 1)
    timebase.observe(fix(BOOT_NS, clock.now_ns - 9))
    told = json.loads(json.dumps(timebase.status()))
    assert (told["source"], told["fix_age_ns"], told["fix_valid"]) == ("gnss", 9, True)
    assert BOOT_NS + 600_000_009 < told["utc_ns"] < BOOT_NS + 600_000_009 + 85_000_000
    assert told["utc_half_width_ns"] > 1.96 * 300_000_000


def test_many_threads_may_use_it() -> None:
    timebase = Timebase(SETTINGS)

    def work(number: int) -> bool:
        for _ in range(50):
            timebase.sample_pair()
            timebase.observe(fix(BOOT_NS + number, SYSTEM_CLOCK.raw_ns()))
            timebase.status()
            stamp = timebase.complete(Stamp(raw_ns=SYSTEM_CLOCK.raw_ns()), frame=True)
            if None in (stamp.combined_ns, stamp.utc_ns, stamp.realtime_ns):
                return False
        return True

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(work, range(4)))
