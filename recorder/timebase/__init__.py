"""Raw clock pairs, GNSS time, and from a stamp to UTC with its uncertainty."""

from recorder.timebase.combined import CombinedTime
from recorder.timebase.kernel_clock import wall_clock_error_ns
from recorder.timebase.pairs import ClockHistory, take_pair
from recorder.timebase.solve import SolvedUtc, solve
from recorder.timebase.timebase import Timebase
from recorder.timebase.utc import UtcEstimate

__all__ = [
    "ClockHistory",
    "CombinedTime",
    "SolvedUtc",
    "Timebase",
    "UtcEstimate",
    "solve",
    "take_pair",
    "wall_clock_error_ns",
]
