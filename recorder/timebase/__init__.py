"""Raw clock pairs, GNSS time, the cameras' clocks, and from a stamp to UTC with its uncertainty."""

from recorder.timebase.camera_clock import CameraClock, CameraClockSettings, Exposure
from recorder.timebase.combined import CombinedTime
from recorder.timebase.dates import Judgement, Verdict, judge
from recorder.timebase.kernel_clock import wall_clock_error_ns
from recorder.timebase.pairs import ClockHistory, Conversion, take_pair
from recorder.timebase.solve import SolvedUtc, solve
from recorder.timebase.timebase import Timebase
from recorder.timebase.utc import UtcEstimate
from recorder.timebase.wall_clock import ClockWatch, NoWatch, WallClockWatch, clock_watch

__all__ = [
    "CameraClock",
    "CameraClockSettings",
    "ClockHistory",
    "ClockWatch",
    "CombinedTime",
    "Conversion",
    "Exposure",
    "Judgement",
    "NoWatch",
    "SolvedUtc",
    "Timebase",
    "UtcEstimate",
    "Verdict",
    "WallClockWatch",
    "clock_watch",
    "judge",
    "solve",
    "take_pair",
    "wall_clock_error_ns",
]
