"""The words of the language: what devices say and what is computed from it.

Everything that flows is frozen and typed. Times are integer nanoseconds, absent ones None;
``raw`` is CLOCK_MONOTONIC_RAW. Units stand in the names.
"""

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[np.uint16]
"""An image, H x W, the values right-aligned in 16 bits."""


@dataclass(frozen=True, slots=True)
class Stamp:
    """When a sample was, on every clock that saw it (report 3.2.6.3; its names in brackets).

    A driver fills in what it knows: the device's and the kernel's stamps untouched, and
    ``raw_ns``, at first the reading at arrival, which the timebase then refines and completes.
    """

    raw_ns: int | None = None
    """CLOCK_MONOTONIC_RAW of this machine at arrival, as the kernel saw it where it stamps (SMR)."""
    device_ns: int | None = None
    """The device's own counter, its origin unknown (IITC)."""
    realtime_ns: int | None = None
    """CLOCK_REALTIME as the kernel or the driver library stamped it (SRT)."""
    gps_ns: int | None = None
    """The last time that the GNSS receiver told, Unix-like (GPS)."""
    gps_raw_ns: int | None = None
    """Raw arrival of the first byte of the burst that told it (GMR)."""
    combined_ns: int | None = None
    """The report's combined time t_combi."""
    utc_ns: int | None = None
    """Our estimate of UTC, Unix-like; None while no source is trusted."""
    utc_sigma_ns: int | None = None
    """One standard deviation of ``utc_ns``."""
    monotonic_ns: int | None = None
    """CLOCK_MONOTONIC as the kernel stamped it (V4L2)."""
    raw_error_ns: int | None = None
    """How far ``raw_ns`` may be from the kernel's stamp; None if it is the reading at arrival."""
    exposure_raw_ns: int | None = None
    """Of a frame: raw time of the middle of its exposure, by the camera's own clock. ``utc_ns`` is then
    UTC of that instant, else of ``raw_ns``."""
    exposure_sigma_ns: int | None = None
    """One standard deviation of ``exposure_raw_ns``."""


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """The settings in force while a frame was exposed, as far as the camera tells."""

    pixel_format: str = ""
    """GenICam's name of what the camera sent, such as Mono10p."""
    exposure_us: float | None = None
    gain: float | None = None
    black_level: float | None = None
    rate_hz: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One complete image of a camera; incomplete ones are a `Loss`, never a frame."""

    camera: str
    id: int
    """Counts every image the camera took, also those that never arrived; does not wrap."""
    stamp: Stamp
    pixels: Pixels
    bit_depth: int
    """1 to 16."""
    settings: CameraSettings = field(default_factory=CameraSettings)

    @property
    def topic(self) -> str:
        return image_topic(self.camera)


@dataclass(frozen=True, slots=True)
class EncodedFrame:
    """A `Frame` on its way to disk: the pixels as one complete FELICS image."""

    camera: str
    id: int
    stamp: Stamp
    width: int
    height: int
    bit_depth: int
    settings: CameraSettings
    data: bytes
    """``FF E8 … FF E9``"""

    @property
    def topic(self) -> str:
        return image_topic(self.camera)


@dataclass(frozen=True, slots=True)
class Preview:
    """A small JPEG of a frame, for people."""

    camera: str
    stamp: Stamp
    jpeg: bytes


@dataclass(frozen=True, slots=True)
class NmeaSentence:
    """One line of the GNSS receiver, or whatever stood between two lines."""

    stamp: Stamp
    """``raw_ns`` is the arrival of its first byte."""
    data: bytes
    """As it came, line end included."""
    problem: str = ""
    """Why it is not a sound sentence: "checksum", "garbage", "cut"; empty if it is sound."""


@dataclass(frozen=True, slots=True)
class Fix:
    """What one burst of NMEA sentences says together."""

    stamp: Stamp
    """``raw_ns`` and ``gps_raw_ns``: first byte of the burst; ``gps_ns``: the time it tells."""
    valid: bool
    """True if position and time come from satellites now (not estimated, manual or simulated)."""
    mode: str
    """The receiver's words: RMC status and mode, GGA quality, such as "A/A/1"."""
    satellites: int | None = None
    """Used, as far as the receiver counts them."""
    hdop: float | None = None
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    altitude_m: float | None = None
    """Above mean sea level."""
    speed_m_s: float | None = None
    course_deg: float | None = None
    """Clockwise from true north."""
    problem: str = ""
    """Why it is not valid, such as "status V"; empty if it is."""
    dimensions: int | None = None
    """GSA: 3, 2 (the height is assumed), or 1 for none."""
    leap_second: bool = False
    """Told as 23:59:60, whose ``gps_ns`` is also that of the second after it."""


@dataclass(frozen=True, slots=True)
class PpsEdge:
    """One pulse per second, as the kernel stamped its edge."""

    stamp: Stamp
    """``realtime_ns``: of the edge, by the kernel; ``raw_ns``: read after the edge was handed over,
    so the edge was before it."""
    sequence: int
    """The kernel's count of edges; a step of more than one is edges that nobody took."""


@dataclass(frozen=True, slots=True)
class ClockPair:
    """The machine's clocks read at one instant, as nearly as that can be done."""

    raw_ns: int
    monotonic_ns: int
    realtime_ns: int
    boottime_ns: int
    bracket_ns: int
    """Between the raw readings before and after: no clock was read further apart."""
    stepped: bool = False
    """The wall clock was set since the pair before."""


@dataclass(frozen=True, slots=True)
class UtcTime:
    """UTC at one raw instant, never without its uncertainty and its source."""

    raw_ns: int
    utc_ns: int
    sigma_ns: int
    """One standard deviation."""
    source: str
    """"pps": the receiver's pulse; "gnss": its sentences; "hold-over": neither just now."""
    half_width_ns: int | None = None
    """Of the 95 % interval, with what is still being corrected; None in drives that did not state it."""

    @property
    def interval_ns(self) -> tuple[int, int]:
        """UTC is between these with 95 %."""
        half_ns = self.sigma_ns * 196 // 100 if self.half_width_ns is None else self.half_width_ns
        return self.utc_ns - half_ns, self.utc_ns + half_ns


@dataclass(frozen=True, slots=True)
class FrameTime:
    """When a frame was exposed, solved again after the drive with all that is known of it."""

    camera: str
    id: int
    raw_ns: int
    """Of the frame, as it was recorded."""
    exposure_raw_ns: int
    """Raw time of the middle of its exposure."""
    exposure_sigma_ns: int
    utc_ns: int
    """UTC of that instant."""
    utc_sigma_ns: int


class LossCause(StrEnum):
    """Where a sample was lost."""

    DEVICE = "device"
    TRANSPORT = "transport"
    QUEUE = "queue"
    ENCODER = "encoder"
    DISK = "disk"
    POWER = "power"


@dataclass(frozen=True, slots=True)
class Loss:
    """Samples of one stream that will never be on disk, with their cause."""

    stream: str
    """The topic they are missing from."""
    first_id: int
    last_id: int
    """Both inclusive; ``count`` is last - first + 1."""
    first_raw_ns: int | None
    last_raw_ns: int | None
    cause: LossCause
    detail: str = ""

    @property
    def count(self) -> int:
        return self.last_id - self.first_id + 1


class DeviceState(StrEnum):
    """What the supervisor says of a device."""

    ABSENT = "absent"
    STARTING = "starting"
    STREAMING = "streaming"
    SILENT = "silent"
    FAILING = "failing"
    ENDED = "ended"


@dataclass(frozen=True, slots=True)
class Health:
    """One device's state at one raw instant."""

    raw_ns: int
    device: str
    state: DeviceState
    reason: str = ""
    samples: int = 0
    lost: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One turn of the lidar: polar points in the scan plane."""

    stamp: Stamp
    id: int
    angle_start_rad: float
    angle_step_rad: float
    range_m: NDArray[np.float32]
    """(N,), NaN where there is no echo."""
    amplitude: NDArray[np.uint16]
    """(N,), device counts."""


@dataclass(frozen=True, slots=True)
class CanMessage:
    """One frame on the vehicle bus."""

    stamp: Stamp
    bus: str
    arbitration_id: int
    data: bytes
    is_extended: bool = False
    is_remote: bool = False
    is_error: bool = False


@dataclass(frozen=True, slots=True)
class LogLine:
    """One event of the recorder itself, as it stands in the drive."""

    raw_ns: int
    level: str
    """"info", "warning" or "error"."""
    name: str
    """The room or device that speaks."""
    message: str


Sample = (
    Frame | NmeaSentence | Fix | PpsEdge | ClockPair | UtcTime | Loss | Health | LogLine | Scan | CanMessage
)
"""What a driver may yield; a `LogLine` tells of the device itself, not of what it measures."""

Record = (
    EncodedFrame
    | Preview
    | NmeaSentence
    | Fix
    | PpsEdge
    | ClockPair
    | UtcTime
    | FrameTime
    | Loss
    | Health
    | LogLine
    | Scan
    | CanMessage
)
"""What a drive may hold."""


def image_topic(camera: str) -> str:
    """The topic of a camera's frames."""
    return f"/camera/{camera}/image"


def time_topic(camera: str) -> str:
    """The topic of the times of a camera's frames, solved again."""
    return f"/camera/{camera}/time"


def preview_topic(camera: str) -> str:
    """The topic of a camera's JPEG previews."""
    return f"/camera/{camera}/preview"
