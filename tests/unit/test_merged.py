"""The merge of recorded devices: order, errors, closing."""

from collections.abc import Iterator, Mapping, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorder.drivers.merged import Merged
from recorder.errors import DeviceLost, SourceError
from recorder.samples import Loss, LossCause, NmeaSentence, Sample, Stamp


class Listed:
    """A driver that yields what it was given."""

    live = False

    def __init__(self, name: str, items: Sequence[Sample | Exception | None], *, opens: bool = True) -> None:
        self.name = name
        self._items = items
        self._opens = opens
        self.is_open = False

    def open(self) -> None:
        if not self._opens:
            raise SourceError("no such file", where=self.name)
        self.is_open = True

    def samples(self) -> Iterator[Sample | None]:
        for item in self._items:
            if isinstance(item, Exception):
                raise item
            yield item

    def describe(self) -> Mapping[str, str]:
        return {"kind": "list"}

    def close(self) -> None:
        self.is_open = False


def line(raw_ns: int | None, text: str = "") -> NmeaSentence:
    return NmeaSentence(Stamp(raw_ns=raw_ns), text.encode())


def loss(raw_ns: int | None) -> Loss:
    return Loss("/camera/front/image", 1, 2, raw_ns, raw_ns, LossCause.DEVICE)


@given(st.lists(st.lists(st.integers(0, 50)), max_size=4))
def test_all_samples_in_order_of_time(times: list[list[int]]) -> None:
    drivers = [Listed(f"d{n}", [line(t, f"{n}") for t in sorted(one)]) for n, one in enumerate(times)]
    merged = list(Merged(drivers).samples())
    raw = [sample.stamp.raw_ns for sample in merged if isinstance(sample, NmeaSentence)]
    assert raw == sorted(t for one in times for t in one)
    # At one instant the driver named first speaks first.
    keys = [(s.stamp.raw_ns, s.data) for s in merged if isinstance(s, NmeaSentence)]
    assert keys == sorted(keys)


def test_none_passes_through_at_once() -> None:
    merged = Merged([Listed("a", [line(1), None, None, line(4)]), Listed("b", [None, line(2), line(3)])])
    found = [s.stamp.raw_ns if isinstance(s, NmeaSentence) else s for s in merged.samples()]
    assert found == [None, 1, None, None, 2, 3, 4]


def test_a_sample_without_time_follows_the_one_before() -> None:
    merged = Merged([Listed("a", [line(1), loss(None), line(5)]), Listed("b", [line(2), line(3)])])
    kinds = [s.stamp.raw_ns if isinstance(s, NmeaSentence) else "loss" for s in merged.samples()]
    assert kinds == [1, "loss", 2, 3, 5]


def test_an_error_comes_after_what_was_before_it() -> None:
    ends = DeviceLost("file ends early")
    merged = Merged([Listed("a", [line(1), line(3), ends]), Listed("b", [line(2), line(3), line(4)])])
    found: list[Sample | None] = []
    with pytest.raises(DeviceLost, match="ends early"):
        found.extend(merged.samples())
    assert [s.stamp.raw_ns for s in found if isinstance(s, NmeaSentence)] == [1, 2, 3, 3, 4]


def test_all_open_or_none() -> None:
    first, second = Listed("a", []), Listed("b", [], opens=False)
    with pytest.raises(SourceError):
        Merged([first, second]).open()
    assert not first.is_open


def test_describe_and_close() -> None:
    drivers = [Listed("a", []), Listed("b", [])]
    merged = Merged(drivers)
    merged.open()
    assert merged.describe() == {"a.kind": "list", "b.kind": "list"}
    merged.close()
    assert not any(driver.is_open for driver in drivers)


def test_nothing_to_merge() -> None:
    assert list(Merged([]).samples()) == []
