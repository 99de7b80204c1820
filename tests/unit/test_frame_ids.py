"""The count of image ids: no wrap, and nothing in neither or both of seen and missing."""

from hypothesis import given
from hypothesis import strategies as st

from recorder.drivers.frame_ids import LATE, SHORT_PERIOD, FrameIds


def arrivals(raw_ids: list[int]) -> list[tuple[int, list[int]] | None]:
    ids = FrameIds()
    told = (ids.arrive(raw_id) for raw_id in raw_ids)
    return [(arrival.id, list(arrival.missing)) if arrival else None for arrival in told]


def raw(count: int, start: int) -> int:
    """The 16-bit id of the image ``count`` after the one with id ``start``."""
    return (start - 1 + count) % SHORT_PERIOD + 1


def test_first_image_is_0_whatever_its_id() -> None:
    assert arrivals([65400]) == [(0, [])]


def test_wrap_skips_0() -> None:
    assert arrivals([65534, 65535, 1, 2]) == [(0, []), (1, []), (2, []), (3, [])]


def test_what_is_lost_across_the_wrap_is_missing() -> None:
    assert arrivals([65534, 2]) == [(0, []), (3, [1, 2])]


def test_extended_ids_do_not_wrap_at_16_bits() -> None:
    assert arrivals([65534, 65537, 65538]) == [(0, []), (3, [1, 2]), (4, [])]


def test_extended_ids_may_start_far_above() -> None:
    assert arrivals([2**40, 2**40 + 2]) == [(0, []), (2, [1])]


def test_late_and_repeated_images_were_counted_before() -> None:
    assert arrivals([10, 12, 11, 12, 13]) == [(0, []), (2, [1]), None, None, (3, [])]


def test_counter_that_begins_anew_goes_on_counting() -> None:
    assert arrivals([5000, 5001, 1, 2]) == [(0, []), (1, []), (2, []), (3, [])]


@given(
    start=st.integers(1, SHORT_PERIOD),
    steps=st.lists(st.integers(1, 3) | st.integers(1, 5000), max_size=60),
)
def test_unwraps_any_losses(start: int, steps: list[int]) -> None:
    sent = [0]
    for step in steps:
        sent.append(sent[-1] + step)
    told = arrivals([raw(count, start) for count in sent])
    assert [one[0] for one in told if one] == sent


@given(
    start=st.integers(1, SHORT_PERIOD),
    sent=st.lists(st.integers(0, LATE), min_size=1, max_size=60),
)
def test_every_id_up_to_the_newest_is_seen_or_missing_once(start: int, sent: list[int]) -> None:
    """In any order and with repetitions, as long as none is later than `LATE`."""
    accounted: list[int] = []
    for one in arrivals([raw(count, start) for count in sent]):
        if one is not None:
            accounted += [*one[1], one[0]]
    assert accounted == list(range(len(accounted)))
    assert len(accounted) == max(sent) - sent[0] + 1
