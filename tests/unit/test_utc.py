"""UTC from fixes and pulses: never a step back, an honest interval, the same afterwards and better."""

from collections.abc import Iterable
from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorder.config import TimebaseSection
from recorder.samples import Fix, Stamp
from recorder.simulation.receiver_time import ReceiverModel, receiver_drive
from recorder.timebase import UtcEstimate, Verdict, judge, solve
from recorder.timebase.arrivals import WOBBLE_MS, Arrivals, fit
from recorder.timebase.dates import ROLLOVER_NS, day_ns, is_leap_second
from recorder.timebase.pulses import PulseClock
from recorder.timebase.steering import FASTEST_PICO, KEPT_SEGMENTS, Line, Steering

SECOND_NS = 1_000_000_000
DAY_NS = 86_400 * SECOND_NS
BOOT_NS = 1_790_000_000 * SECOND_NS
RAW_NS = 5_000 * SECOND_NS
SETTINGS = TimebaseSection(gnss_delay_ms=600, gnss_delay_sigma_ms=300)

instants = st.integers(0, 2**62)


def fix(gps_ns: int | None, raw_ns: int, *, valid: bool = True) -> Fix:
    return Fix(Stamp(raw_ns=raw_ns, gps_ns=gps_ns, gps_raw_ns=raw_ns), valid=valid, mode="A/A/1")


def steady(
    seconds: Iterable[int], *, delay_ns: int = 600_000_000, ppm: float = 0.0, ahead_ns: int = 0
) -> list[Fix]:
    """Fixes of a receiver without any wobble; raw time is ``ppm`` too slow."""
    return [
        fix(BOOT_NS + second * SECOND_NS + ahead_ns, _raw_ns(second, ppm) + delay_ns) for second in seconds
    ]


def _raw_ns(second: float, ppm: float = 0.0) -> int:
    return RAW_NS + round(second * (1 - ppm * 1e-6) * SECOND_NS)


def test_there_is_no_utc_before_the_first_fix_that_is_accepted() -> None:
    estimate = UtcEstimate(SETTINGS)
    estimate.observe(fix(BOOT_NS, 1, valid=False))
    estimate.observe(fix(None, 1))
    estimate.observe(fix(day_ns(date(1980, 1, 6)), 1))
    estimate.observe(replace(fix(BOOT_NS, 1), stamp=Stamp(raw_ns=1, gps_ns=BOOT_NS)))
    assert estimate.at(5) is None
    assert not estimate.observe_pulse(5)


@given(instants, st.integers(-(10**13), 10**13))
def test_utc_of_one_fix_allows_for_delay_wobble_and_drift(raw_ns: int, age_ns: int) -> None:
    estimate = UtcEstimate(SETTINGS)
    estimate.observe(fix(BOOT_NS, raw_ns))
    utc = estimate.at(raw_ns + age_ns)
    assert utc is not None
    early_ns = utc.utc_ns - (BOOT_NS + 600_000_000 + age_ns)
    assert 0 < early_ns < WOBBLE_MS * 1e6  # it came a part of the wobble late, most likely
    assert utc.half_width_ns is not None
    assert utc.half_width_ns >= round(1.96 * 300_000_000)
    assert utc.half_width_ns >= 1.96 * 30e-6 * abs(age_ns)
    assert utc.half_width_ns == pytest.approx(1.96 * utc.sigma_ns, abs=2)
    assert utc.interval_ns == (utc.utc_ns - utc.half_width_ns, utc.utc_ns + utc.half_width_ns)


steps = st.lists(
    st.one_of(
        st.tuples(st.just("fix"), st.integers(0, 10**12), st.integers(-(10**9), 10**9)),
        st.tuples(st.just("pulse"), st.integers(0, 10**12), st.just(0)),
        st.tuples(st.just("ask"), st.integers(0, 10**12), st.just(0)),
    ),
    max_size=40,
)


@given(steps)
def test_utc_never_steps_back_in_whatever_order_it_is_asked(told: list[tuple[str, int, int]]) -> None:
    estimate = UtcEstimate(SETTINGS)
    answers: list[tuple[int, int]] = []
    for what, raw_ns, off_ns in told:
        if what == "fix":
            estimate.observe(fix(BOOT_NS + raw_ns + off_ns, raw_ns))
        elif what == "pulse":
            estimate.observe_pulse(raw_ns)
        elif utc := estimate.at(raw_ns):
            answers.append((raw_ns, utc.utc_ns))
    answers.sort()
    assert [utc_ns for _, utc_ns in answers] == sorted(utc_ns for _, utc_ns in answers)


lines = st.builds(
    Line,
    raw_ns=st.integers(0, 10**10),
    utc_ns=st.integers(BOOT_NS, BOOT_NS + 10**10),
    rate_pico=st.integers(-(10**9), 10**9),
    variance_ns2=st.just(1.0),
    covariance=st.just(0.0),
    rate_variance=st.just(0.0),
    source=st.just("gnss"),
)


@given(st.lists(st.one_of(lines, st.integers(0, 10**10)), max_size=KEPT_SEGMENTS), st.integers(-5, 5))
def test_steering_is_one_function_of_raw_time_that_never_decreases(told: list[Line | int], near: int) -> None:
    steering = Steering()
    asked = []
    for one in told:
        if isinstance(one, Line):
            steering.follow(one)
        else:
            for raw_ns in (one, one + 1, one + near):
                if (found := steering.at(raw_ns)) is not None:
                    asked.append((raw_ns, found.utc_ns))
    again = [(raw_ns, steering.peek(raw_ns)) for raw_ns, _ in asked]
    assert [(raw_ns, found.utc_ns) for raw_ns, found in again if found] == asked
    assert [utc_ns for _, utc_ns in sorted(asked)] == sorted(utc_ns for _, utc_ns in asked)


@given(st.integers(-29 * SECOND_NS, SECOND_NS), instants)
def test_a_correction_is_slewed_and_what_is_left_of_it_is_stated(off_ns: int, raw_ns: int) -> None:
    steering = Steering()
    line = Line(raw_ns, BOOT_NS, 0, 1.0, 0.0, 0.0, "gnss")
    steering.follow(line)
    steering.at(raw_ns)
    steering.follow(replace(line, utc_ns=BOOT_NS + off_ns))
    at_once, later = steering.at(raw_ns + 1), steering.at(raw_ns + 300 * SECOND_NS)
    assert at_once is not None
    assert later is not None
    assert at_once.utc_ns == BOOT_NS + 1
    assert at_once.left_ns == -off_ns
    assert later.utc_ns == BOOT_NS + 300 * SECOND_NS + off_ns
    soon = steering.peek(raw_ns + 1 + SECOND_NS)
    assert soon is not None
    assert abs(soon.utc_ns - BOOT_NS - 1 - SECOND_NS) <= SECOND_NS * FASTEST_PICO // 10**12


def test_looking_at_utc_changes_nothing_that_is_recorded() -> None:
    def run(*, look: bool) -> list[int]:
        estimate = UtcEstimate(SETTINGS)
        told = []
        for second in range(10):
            late_ns = (second % 3) * 50_000_000
            estimate.observe(fix(BOOT_NS + second * SECOND_NS, second * SECOND_NS + late_ns))
            if look:
                estimate.peek((second + 1) * SECOND_NS)
            found = estimate.at(second * SECOND_NS + SECOND_NS // 2)
            told.append(found.utc_ns if found else 0)
        return told

    assert run(look=True) == run(look=False)


def feed(estimate: UtcEstimate, fixes: Iterable[Fix]) -> None:
    for one in fixes:
        estimate.observe(one)
        estimate.at(one.stamp.raw_ns or 0)


def test_one_fix_with_a_wrong_date_moves_nothing() -> None:
    estimate = UtcEstimate(SETTINGS)
    feed(estimate, steady(range(5)))
    before = estimate.peek(_raw_ns(10))
    estimate.observe(fix(BOOT_NS + 900 * DAY_NS, _raw_ns(5.6)))
    assert estimate.peek(_raw_ns(10)) == before


def test_a_date_that_was_wrong_is_left_at_one_step_once_three_fixes_agree() -> None:
    estimate = UtcEstimate(SETTINGS)
    feed(estimate, steady(range(3), ahead_ns=900 * DAY_NS))
    feed(estimate, steady(range(3, 6)))
    healed = estimate.at(_raw_ns(7))
    assert healed is not None
    assert abs(healed.utc_ns - BOOT_NS - 7 * SECOND_NS) < SECOND_NS // 5
    assert healed.sigma_ns < SECOND_NS


@pytest.mark.parametrize("seconds", [-3, 3, 18])
def test_leap_seconds_that_the_almanac_brings_are_slewed_and_afterwards_never_were(seconds: int) -> None:
    fixes = steady(range(60), ahead_ns=seconds * SECOND_NS) + steady(range(60, 600))
    estimate = UtcEstimate(SETTINGS)
    feed(estimate, fixes)
    end = estimate.at(_raw_ns(600))
    solved = solve(fixes, SETTINGS)
    assert end is not None
    assert solved is not None
    for utc, second in ((end, 600), (solved.at(_raw_ns(10)), 10)):
        assert abs(utc.utc_ns - BOOT_NS - second * SECOND_NS) < SECOND_NS // 10


def test_before_a_leap_second_unix_time_was_a_second_further_on() -> None:
    midnight_ns = day_ns(date(2028, 1, 1))
    raw_ns = [RAW_NS + second * SECOND_NS for second in range(120)]
    fixes = [fix(midnight_ns - 60 * SECOND_NS + raw - RAW_NS, raw + 600_000_000) for raw in raw_ns[:61]]
    fixes += [fix(midnight_ns - 61 * SECOND_NS + raw - RAW_NS, raw + 600_000_000) for raw in raw_ns[61:]]
    solved = solve(fixes, SETTINGS)
    assert solved is not None
    assert abs(solved.at(raw_ns[30]).utc_ns - (midnight_ns - 30 * SECOND_NS)) < SECOND_NS // 5
    assert abs(solved.at(raw_ns[90]).utc_ns - (midnight_ns + 29 * SECOND_NS)) < SECOND_NS // 5
    assert not is_leap_second(day_ns(date(2028, 1, 2)))


def test_the_drift_is_found_and_holds_over_a_tunnel_with_growing_uncertainty() -> None:
    estimate = UtcEstimate(SETTINGS)
    feed(estimate, steady(range(1200), ppm=37.0))
    asked = (1200, 1500, 2400)
    told = [estimate.at(_raw_ns(second, 37.0)) for second in asked]
    errors_ns = [
        t.utc_ns - BOOT_NS - s * SECOND_NS for t, s in zip(told, (1200, 1500, 2400), strict=True) if t
    ]
    sigmas_ns = [t.sigma_ns for t in told if t]
    assert max(errors_ns) - min(errors_ns) < 3_000_000
    assert sigmas_ns == sorted(sigmas_ns)
    assert sigmas_ns[2] > sigmas_ns[0]
    assert [t.source for t in told if t] == ["gnss", "hold-over", "hold-over"]


def test_a_jump_of_the_delay_moves_utc_by_less_than_a_tenth_of_it() -> None:
    for delay_ns in (400_000_000, 800_000_000):
        estimate = UtcEstimate(SETTINGS)
        feed(estimate, steady(range(1200)) + steady(range(1200, 1800), delay_ns=delay_ns))
        end = estimate.at(_raw_ns(1800))
        assert end is not None
        assert abs(end.utc_ns - BOOT_NS - 1800 * SECOND_NS) < 20_000_000


def test_pulses_take_the_delay_away_and_teach_it() -> None:
    estimate = UtcEstimate(SETTINGS)
    for number, one in enumerate(steady(range(900), delay_ns=820_000_000)):
        if number:
            estimate.observe_pulse(_raw_ns(number))
        estimate.observe(one)
        estimate.at(_raw_ns(number + 0.9))
    utc = estimate.at(_raw_ns(900))
    assert utc is not None
    assert utc.source == "pps"
    assert abs(utc.utc_ns - BOOT_NS - 900 * SECOND_NS) < 1_000
    assert utc.half_width_ns is not None
    assert utc.half_width_ns < 50_000
    feed(estimate, steady(range(901, 8000), delay_ns=820_000_000))  # the pulse has failed
    later = estimate.at(_raw_ns(8000))
    assert later is not None
    assert later.half_width_ns is not None
    assert later.half_width_ns < 60_000_000
    assert abs(later.utc_ns - BOOT_NS - 8000 * SECOND_NS) < later.half_width_ns


def test_a_pulse_without_a_recent_fix_or_a_certain_second_is_not_believed() -> None:
    estimate = UtcEstimate(SETTINGS)
    feed(estimate, steady(range(300)))
    assert not estimate.observe_pulse(_raw_ns(400))
    unsure = UtcEstimate(SETTINGS)
    feed(unsure, steady(range(300), delay_ns=1_090_000_000))
    assert not unsure.observe_pulse(_raw_ns(301))


def test_a_pulse_that_does_not_fit_is_left_out_and_five_of_them_are_right() -> None:
    clock = PulseClock()
    assert all(clock.observe(second * SECOND_NS, BOOT_NS + second * SECOND_NS) for second in range(60))
    before = clock.line()
    late = [
        clock.observe(second * SECOND_NS + 2_000_000, BOOT_NS + second * SECOND_NS)
        for second in range(60, 65)
    ]
    assert late == [False] * 4 + [True]
    after = clock.line()
    assert before is not None
    assert after is not None
    assert after.raw_ns - after.utc_ns == before.raw_ns - before.utc_ns + 2_000_000


@pytest.mark.parametrize("seed", range(4))
def test_solved_afterwards_it_covers_the_truth_never_steps_back_and_is_no_wider(seed: int) -> None:
    model = ReceiverModel(seconds=2400, delay_ms=(200.0, 1000.0))
    drive = receiver_drive(model, np.random.default_rng(seed))
    arrivals = [RAW_NS + round(raw_s * 1e9) for raw_s in drive.arrival_raw_s().tolist()]
    fixes = [fix(BOOT_NS + second * SECOND_NS, raw_ns) for second, raw_ns in enumerate(arrivals)]
    pulses = [RAW_NS + round(raw_s * 1e9) for raw_s in drive.pulse_raw_s().tolist()]
    pulses = pulses[300:900] if seed % 2 else []
    estimate, solved = UtcEstimate(SETTINGS), solve(fixes, SETTINGS, pulses_raw_ns=pulses)
    assert solved is not None
    events = sorted([(raw_ns, 0) for raw_ns in pulses] + [(one.stamp.raw_ns or 0, 1) for one in fixes])
    remaining = iter(fixes)
    last_ns = 0
    for raw_ns, kind in events:
        if kind == 0:
            estimate.observe_pulse(raw_ns)
            continue
        estimate.observe(next(remaining))
        online, after = estimate.at(raw_ns), solved.at(raw_ns)
        truth_ns = BOOT_NS + round(float(drive.utc_s(np.array([(raw_ns - RAW_NS) / 1e9]))[0]) * 1e9)
        assert online is not None
        assert after.half_width_ns is not None
        assert online.half_width_ns is not None
        assert after.half_width_ns <= online.half_width_ns * 1.001
        assert after.interval_ns[0] <= truth_ns <= after.interval_ns[1]
        assert after.utc_ns > last_ns
        last_ns = after.utc_ns


def test_nothing_that_can_be_trusted_solves_nothing() -> None:
    assert solve([], SETTINGS) is None
    assert solve([fix(BOOT_NS, 1, valid=False)], SETTINGS) is None


def test_arrivals_hold_no_more_than_they_were_given_room_for() -> None:
    arrivals = Arrivals(kept=10)
    for second in range(2000):
        arrivals.add(float(second), 250.0 if second // 300 % 2 else 0.0)
    assert len(arrivals.blocks) == 10
    assert len(arrivals.levels) <= 1
    assert arrivals.left_ms + sum(level.step_ms for level in arrivals.levels) == 0.0
    assert fit(arrivals).sigma(2000.0) > 0


@given(st.integers(1, 2), st.integers(0, 11 * 365))
def test_a_week_count_that_rolled_over_is_corrected_and_said_so(rollovers: int, days: int) -> None:
    true_ns = day_ns(date(2025, 1, 1)) + days * DAY_NS + 12_345
    judged = judge(fix(true_ns - rollovers * ROLLOVER_NS, 1), day_ns(SETTINGS.not_before))
    if judged.verdict is not Verdict.REFUSED:  # a day that receivers start with
        assert (judged.verdict, judged.gps_ns) == (Verdict.CORRECTED, true_ns)
    assert judged.reason


@pytest.mark.parametrize(
    ("day", "verdict"),
    [
        (date(2026, 11, 21), Verdict.ACCEPTED),
        (date(2007, 4, 7), Verdict.CORRECTED),
        (date(1980, 1, 6), Verdict.REFUSED),
        (date(1999, 8, 22), Verdict.REFUSED),
        (date(2000, 1, 1), Verdict.REFUSED),
        (date(2022, 6, 1), Verdict.REFUSED),
        (date(2099, 1, 1), Verdict.REFUSED),
    ],
)
def test_a_date_is_accepted_corrected_or_refused_with_the_reason(day: date, verdict: Verdict) -> None:
    judged = judge(fix(day_ns(day), 1), day_ns(SETTINGS.not_before))
    assert judged.verdict is verdict
    assert bool(judged.reason) == (verdict is not Verdict.ACCEPTED)
    assert (judged.gps_ns is None) == (verdict is Verdict.REFUSED)


def test_a_replay_believes_every_date() -> None:
    old = fix(day_ns(date(2014, 5, 1)), 1)
    assert judge(old, day_ns(SETTINGS.not_before)).verdict is not Verdict.ACCEPTED
    assert judge(old, day_ns(SETTINGS.believing_every_date.not_before)).verdict is Verdict.ACCEPTED
