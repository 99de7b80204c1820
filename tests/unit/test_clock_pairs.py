"""Kernel stamps in raw time: exact while the clocks run evenly, bounded while they are slewed or set."""

import threading
import time
from itertools import pairwise

from camera_time import AS_REQUIRED, Disturbance, changes_ns, solved_times
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from recorder.clock import SYSTEM_CLOCK
from recorder.config import TimebaseSection
from recorder.samples import ClockPair, Stamp
from recorder.service.clock_pairs import ClockPairs
from recorder.simulation.clocks import SimulatedClock
from recorder.timebase import ClockHistory, NoWatch, Timebase, WallClockWatch

SECOND_NS = 1_000_000_000
DAY_NS = 86_400 * SECOND_NS
MS_NS = 1_000_000

instants = st.integers(0, 2**62)
latencies = st.integers(0, 50 * MS_NS)
slews = st.integers(-500, 500)


def pair(raw_ns: int, realtime_ns: int, *, stepped: bool = False) -> ClockPair:
    return ClockPair(raw_ns, realtime_ns, realtime_ns, 0, bracket_ns=0, stepped=stepped)


@given(instants, instants, st.integers(0, SECOND_NS), st.integers(0, SECOND_NS))
def test_one_pair_converts_there_and_back_without_loss(
    raw_ns: int, realtime_ns: int, before_ns: int, latency_ns: int
) -> None:
    history = ClockHistory()
    history.add(pair(raw_ns, realtime_ns))
    for told_ns, expected_ns in ((realtime_ns + before_ns, raw_ns + before_ns), (realtime_ns, raw_ns)):
        found = history.raw_from_realtime(told_ns, arrival_ns=expected_ns + latency_ns)
        assert found is not None
        assert found.raw_ns == expected_ns
        assert history.raw_from_monotonic(told_ns, arrival_ns=expected_ns + latency_ns) == found
        assert history.realtime_from_raw(found.raw_ns) == told_ns


@given(instants, instants, slews, st.integers(0, SECOND_NS))
def test_between_two_pairs_a_slewed_clock_is_followed_exactly(
    raw_ns: int, realtime_ns: int, ppm: int, after_ns: int
) -> None:
    history = ClockHistory()
    history.add(pair(raw_ns, realtime_ns))
    history.add(pair(raw_ns + SECOND_NS, realtime_ns + SECOND_NS + ppm * 1000))
    told_ns = realtime_ns + after_ns + after_ns * ppm // 1_000_000
    found = history.raw_from_realtime(told_ns, arrival_ns=raw_ns + after_ns + 2)
    assert found is not None
    assert abs(found.raw_ns - (raw_ns + after_ns)) <= 2
    back_ns = history.realtime_from_raw(raw_ns + after_ns)
    assert back_ns is not None
    assert abs(back_ns - told_ns) <= 1


@given(instants, st.integers(-DAY_NS, DAY_NS), st.integers(1, SECOND_NS - 1))
def test_across_a_step_the_later_possible_instant_not_after_the_arrival_is_taken(
    raw_ns: int, step_ns: int, after_ns: int
) -> None:
    """After the step the pair behind it holds, whatever the step; the error spans what was possible."""
    history = ClockHistory()
    history.add(pair(raw_ns, raw_ns))
    history.add(pair(raw_ns + SECOND_NS, raw_ns + SECOND_NS + step_ns, stepped=True))
    true_ns = raw_ns + after_ns
    found = history.raw_from_realtime(true_ns + step_ns, arrival_ns=true_ns)
    assert found is not None
    assert found.raw_ns == true_ns
    other_ns = true_ns + step_ns  # by the pair before the step
    possible = raw_ns <= other_ns < true_ns
    assert found.error_ns >= (true_ns - other_ns if possible else 0)


def test_a_stamp_before_a_step_forward_is_converted_by_the_pair_before_it() -> None:
    history = ClockHistory()
    history.add(pair(0, 0))
    history.add(pair(SECOND_NS, SECOND_NS + 100 * DAY_NS, stepped=True))
    found = history.raw_from_realtime(SECOND_NS // 2, arrival_ns=SECOND_NS // 2 + 5 * MS_NS)
    assert found is not None
    assert found.raw_ns == SECOND_NS // 2


def test_a_stamp_is_not_older_than_the_last_one_of_its_device() -> None:
    """A step back by 3 ms leaves two instants; the device's last sample rules one out."""
    history = ClockHistory()
    history.add(pair(0, 0))
    history.add(pair(SECOND_NS, SECOND_NS - 3 * MS_NS, stepped=True))
    told_ns, arrival_ns = 500 * MS_NS, 510 * MS_NS
    loose = history.raw_from_realtime(told_ns, arrival_ns=arrival_ns)
    bound = history.raw_from_realtime(told_ns, arrival_ns=arrival_ns, after_ns=501 * MS_NS)
    assert loose is not None
    assert bound is not None
    assert loose.raw_ns == bound.raw_ns == 503 * MS_NS
    assert loose.error_ns > 3 * MS_NS > bound.error_ns


def test_a_stamp_that_no_instant_before_its_arrival_explains_is_not_believed() -> None:
    history = ClockHistory()
    history.add(pair(0, 0))
    history.add(pair(SECOND_NS, SECOND_NS))
    assert history.raw_from_realtime(SECOND_NS, arrival_ns=SECOND_NS - MS_NS) is None
    assert history.raw_from_realtime(-SECOND_NS, arrival_ns=SECOND_NS) is None
    assert history.raw_from_realtime(MS_NS, arrival_ns=SECOND_NS, after_ns=2 * MS_NS) is None


def test_a_pair_that_moved_further_than_slewing_can_tells_of_a_step_by_itself() -> None:
    history = ClockHistory()
    history.add(pair(0, 0))
    assert not history.add(pair(SECOND_NS, SECOND_NS + 500_000)).stepped
    assert history.add(pair(2 * SECOND_NS, 2 * SECOND_NS + 1_700_000)).stepped


class Kernel:
    """What a stamp of a simulated machine is, and what the timebase makes of it."""

    def __init__(self) -> None:
        self.clock = SimulatedClock(reading_ns=0)
        self.timebase = Timebase(TimebaseSection(), self.clock)

    def advance(self, ns: int) -> None:
        """Pairs are taken every half second meanwhile."""
        for _ in range(ns // (SECOND_NS // 2)):
            self.clock.advance(SECOND_NS // 2)
            self.timebase.sample_pair()
        self.clock.advance(ns % (SECOND_NS // 2))

    def stamp(self, latency_ns: int) -> tuple[int, Stamp, Stamp]:
        """The true raw instant of a stamp, and it by the wall clock and by the monotonic one."""
        true_ns = self.clock.now_ns
        realtime_ns, monotonic_ns = self.clock.wall_at_now_ns(), self.clock.monotonic_at_now_ns()
        self.clock.advance(latency_ns)
        return true_ns, Stamp(self.clock.now_ns, realtime_ns=realtime_ns), Stamp(
            self.clock.now_ns, monotonic_ns=monotonic_ns
        )  # fmt: skip


@given(st.lists(st.tuples(slews, st.integers(0, 3 * SECOND_NS), latencies), max_size=6))
def test_a_slewed_clock_moves_no_stamp_by_more_than_the_error_that_is_told(
    steps: list[tuple[int, int, int]],
) -> None:
    kernel = Kernel()
    for ppm, wait_ns, latency_ns in steps:
        kernel.clock.slew(ppm)
        kernel.advance(wait_ns)
        true_ns, *stamps = kernel.stamp(latency_ns)
        for stamp in stamps:
            told = kernel.timebase.refine(stamp)
            assert told.raw_ns is not None
            assert told.raw_error_ns is not None
            assert abs(told.raw_ns - true_ns) <= told.raw_error_ns <= 600_000
            assert told.raw_ns <= stamp.raw_ns  # type: ignore[operator]


@given(
    st.lists(
        st.tuples(
            st.one_of(
                st.integers(-5 * MS_NS, 5 * MS_NS),
                st.integers(-2 * SECOND_NS, 2 * SECOND_NS),
                st.integers(-100 * DAY_NS, 100 * DAY_NS),
            ),
            st.integers(0, 2 * SECOND_NS),
            st.integers(0, 20 * MS_NS),
            latencies,
            st.booleans(),
        ),
        max_size=6,
    )
)
def test_a_clock_that_is_set_moves_no_stamp_by_more_than_the_error_that_is_told(
    steps: list[tuple[int, int, int, int, bool]],
) -> None:
    """Set before or after the kernel stamped, by anything, noticed or not."""
    kernel = Kernel()
    for step_ns, wait_ns, since_ns, latency_ns, noticed in steps:
        kernel.advance(wait_ns)
        after_ns = kernel.clock.now_ns
        true_ns, stamp, steady = kernel.stamp(since_ns)
        kernel.clock.set_wall(step_ns)
        if noticed:
            kernel.timebase.sample_pair(stepped=True)
        kernel.clock.advance(latency_ns)
        told = kernel.timebase.refine(stamp, after_ns=after_ns - MS_NS)
        assert told.raw_ns is not None
        if told.raw_error_ns is not None:
            assert abs(told.raw_ns - true_ns) <= told.raw_error_ns
        assert told.realtime_ns == stamp.realtime_ns
        told = kernel.timebase.refine(steady)
        assert told.raw_ns is not None
        assert abs(told.raw_ns - true_ns) <= 100


@given(st.sampled_from([-100 * DAY_NS, 100 * DAY_NS]), latencies)
def test_setting_the_wall_clock_by_100_days_moves_no_raw_time(step_ns: int, latency_ns: int) -> None:
    kernel = Kernel()
    offset_ns = kernel.timebase.log_offset_ns
    kernel.advance(SECOND_NS)
    kernel.clock.set_wall(step_ns)
    true_ns, stamp, _ = kernel.stamp(latency_ns)
    told = kernel.timebase.refine(stamp)
    assert told.raw_ns is not None
    assert abs(told.raw_ns - true_ns) <= 1
    assert kernel.timebase.log_offset_ns == offset_ns


@settings(max_examples=10, deadline=None, phases=(Phase.explicit, Phase.reuse, Phase.generate))
@given(st.integers(0, 10**6), st.integers(5_000, 15_000), st.integers(0, 10_000))
def test_a_wall_clock_that_is_set_and_slewed_changes_no_solved_time_by_50_us(
    seed: int, first_ms: int, later_ms: int
) -> None:
    disturbances = (
        Disturbance(first_ms / 1e3, set_ns=100 * DAY_NS),
        Disturbance(first_ms / 1e3 + 0.5, slew_ppm=500),
        Disturbance((first_ms + later_ms) / 1e3 + 1, set_ns=-100 * DAY_NS),
        Disturbance((first_ms + later_ms) / 1e3 + 2, slew_ppm=-500),
    )
    changes = changes_ns(solved_times((), 30, seed), solved_times(disturbances, 30, seed))
    assert max(changes.values()) <= 50_000


@settings(max_examples=10, deadline=None, phases=(Phase.explicit, Phase.reuse, Phase.generate))
@given(st.integers(0, 10**6), st.integers(-2000, 2000))
def test_a_small_step_moves_no_exposure(seed: int, step_us: int) -> None:
    """Also one that a stamp cannot be told from: the envelope is under it."""
    disturbances = (Disturbance(12.3456, set_ns=1000 * step_us),)
    changes = changes_ns(solved_times((), 20, seed), solved_times(disturbances, 20, seed))
    assert changes["exposure_raw_ns"] <= 50_000


def test_the_required_disturbances_do_disturb() -> None:
    quiet, disturbed = solved_times((), 45), solved_times(AS_REQUIRED, 45)
    shifts = [abs(a.realtime_ns - b.realtime_ns) for a, b in zip(quiet, disturbed, strict=True)]  # type: ignore[operator]
    assert max(shifts) > 99 * DAY_NS


class StepNow(NoWatch):
    """Says once that the clock was set."""

    def __init__(self) -> None:
        super().__init__()
        self.steps = [True]

    def wait(self, timeout_s: float) -> bool:
        return True if self.steps and self.steps.pop() else super().wait(timeout_s)


def test_a_pair_is_taken_at_once_when_the_wall_clock_is_set_and_says_so() -> None:
    taken: list[ClockPair] = []
    seen = threading.Event()

    def record(pair: ClockPair) -> None:
        taken.append(pair)
        if len(taken) == 2:
            seen.set()

    pairs = ClockPairs(
        Timebase(TimebaseSection()), record, 60.0, clock=SYSTEM_CLOCK, watch=StepNow()
    )  # fmt: skip
    pairs.start()
    assert seen.wait(5)
    pairs.close()
    assert [pair.stepped for pair in taken] == [False, True]


def test_pairs_are_taken_at_least_once_a_second_and_end_at_once() -> None:
    taken: list[ClockPair] = []
    pairs = ClockPairs(
        Timebase(TimebaseSection()), taken.append, 0.05, clock=SYSTEM_CLOCK, watch=WallClockWatch()
    )
    pairs.start()
    time.sleep(1.0)
    began = time.monotonic()
    pairs.close()
    assert time.monotonic() - began < 1
    gaps = [later.raw_ns - former.raw_ns for former, later in pairwise(taken)]
    assert len(taken) >= 5
    assert max(gaps) < SECOND_NS


def test_the_kernels_timer_on_the_wall_clock_says_nothing_while_nobody_sets_it() -> None:
    watch = WallClockWatch()
    began = time.monotonic()
    assert watch.wait(0.05) is False
    assert time.monotonic() - began >= 0.05
    watch.wake()
    assert watch.wait(60) is False
    watch.close()
