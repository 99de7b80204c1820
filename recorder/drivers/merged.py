"""Several recorded devices replayed as one, in the order in which things happened."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

from recorder.drivers.base import Driver
from recorder.errors import DeviceLost, RecorderError
from recorder.samples import ClockPair, Health, LogLine, Loss, Sample, UtcTime


@dataclass(slots=True)
class _Lane:
    """One driver's samples: the next one, and the time up to which it has spoken."""

    samples: Iterator[Sample | None]
    head: Sample | RecorderError | None = None
    reached_raw_ns: int | None = None
    """Of the head, or of the last sample before it that had a time: one without follows at once."""
    ended: bool = False

    def advance(self) -> bool:
        """Take the next sample; False if the driver has none yet."""
        try:
            self.head = next(self.samples)
        except StopIteration:
            self.ended = True
            return True
        except RecorderError as error:
            self.head = error
            return True
        if self.head is None:
            return False
        raw_ns = raw_time(self.head)
        if raw_ns is not None and (self.reached_raw_ns is None or raw_ns > self.reached_raw_ns):
            self.reached_raw_ns = raw_ns
        return True


class Merged:
    """File drivers as one driver whose samples come in the order of their ``raw_ns``.

    They must have been made with one common origin. A sample without a time follows the one
    before it. One that fails ends, the others go on to their ends; then the error is raised.
    Nothing is read ahead but one sample a driver. With drivers that play at their own pace the
    waits add up, so a sample may be late by the others' step (0.2 s at most); the order stands.
    """

    live = False

    def __init__(self, drivers: Sequence[Driver]) -> None:
        self._drivers = tuple(drivers)
        self.name = "+".join(driver.name for driver in drivers)

    def open(self) -> None:
        """Open all or none. Raises what the first that fails raises."""
        with ExitStack() as opened:
            for driver in self._drivers:
                opened.callback(driver.close)
                driver.open()
            opened.pop_all()

    def samples(self) -> Iterator[Sample | None]:
        """Raises at the end what the first that failed raised; of several, one that tells of all."""
        lanes = [_Lane(iter(driver.samples())) for driver in self._drivers]
        errors: list[RecorderError] = []
        while lanes:
            for lane in lanes:
                while lane.head is None and not lane.ended:
                    if not lane.advance():
                        yield None
            lanes = [lane for lane in lanes if not lane.ended]
            if not lanes:
                break
            first = min(lanes, key=_order)
            head, first.head = first.head, None
            if isinstance(head, RecorderError):
                first.ended = True
                errors.append(head)
            else:
                yield head
            lanes = [lane for lane in lanes if not lane.ended]
        if len(errors) > 1:
            raise DeviceLost("; ".join(map(str, errors)))
        if errors:
            raise errors[0]

    def describe(self) -> Mapping[str, str]:
        return {
            f"{driver.name}.{key}": value
            for driver in self._drivers
            for key, value in driver.describe().items()
        }

    def close(self) -> None:
        with ExitStack() as stack:
            for driver in self._drivers:
                stack.callback(driver.close)


def raw_time(sample: Sample) -> int | None:
    """The raw instant that a sample belongs to, as far as it tells."""
    if isinstance(sample, ClockPair | UtcTime | Health | LogLine):
        return sample.raw_ns
    if isinstance(sample, Loss):
        return sample.first_raw_ns
    return sample.stamp.raw_ns


def _order(lane: _Lane) -> tuple[int, int]:
    """By time; an error after the samples of the same time. Before any time is known: at once."""
    reached = lane.reached_raw_ns
    return (-1 if reached is None else reached, int(isinstance(lane.head, RecorderError)))
