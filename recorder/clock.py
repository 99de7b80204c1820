"""The machine's clocks, passed in wherever time is read, so that tests can drive them."""

import time
from typing import Protocol


class Clock(Protocol):
    """Four readings of now, integer nanoseconds.

    ``raw`` (CLOCK_MONOTONIC_RAW) is never slewed nor stepped: every duration and every stamp
    of the product stands on it. ``monotonic`` is slewed, ``realtime`` is slewed and stepped,
    ``boottime`` is monotonic that also counts suspension.
    """

    def raw_ns(self) -> int: ...
    def monotonic_ns(self) -> int: ...
    def realtime_ns(self) -> int: ...
    def boottime_ns(self) -> int: ...


class SystemClock:
    """The clocks of this machine."""

    def raw_ns(self) -> int:
        return time.clock_gettime_ns(time.CLOCK_MONOTONIC_RAW)

    def monotonic_ns(self) -> int:
        return time.clock_gettime_ns(time.CLOCK_MONOTONIC)

    def realtime_ns(self) -> int:
        return time.clock_gettime_ns(time.CLOCK_REALTIME)

    def boottime_ns(self) -> int:
        return time.clock_gettime_ns(time.CLOCK_BOOTTIME)


SYSTEM_CLOCK = SystemClock()
