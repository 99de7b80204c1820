"""Samples as Foxglove's own message types, so that its tools show them without a plug-in."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.KeyValuePair_pb2 import KeyValuePair
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

from recorder.samples import Fix, LogLine, Preview, Scan, Stamp
from recorder.storage.stamps import STAMP_FIELDS, foxglove_time

RANGE_ERROR_M = 5.0
"""One standard deviation of a pseudorange with plain GPS: what HDOP is multiplied with. Rough,
hence APPROXIMATED."""

_LEVELS = {"debug": Log.DEBUG, "info": Log.INFO, "warning": Log.WARNING, "error": Log.ERROR}
_LEVEL_NAMES = {number: name for name, number in _LEVELS.items()}


def preview_message(preview: Preview, log_time_ns: int) -> CompressedImage:
    return CompressedImage(
        timestamp=foxglove_time(preview.stamp, log_time_ns),
        frame_id=f"camera_{preview.camera}",
        data=preview.jpeg,
        format="jpeg",
    )


def preview_sample(value: Any, raw_ns: int) -> Preview:
    return Preview(value.frame_id.removeprefix("camera_"), Stamp(raw_ns=raw_ns), value.data)


def log_message(line: LogLine, log_time_ns: int) -> Log:
    return Log(
        timestamp=foxglove_time(None, log_time_ns),
        level=_LEVELS.get(line.level, Log.UNKNOWN),
        name=line.name,
        message=line.message,
    )


def log_sample(value: Any, raw_ns: int) -> LogLine:
    return LogLine(raw_ns, _LEVEL_NAMES.get(value.level, "info"), value.name, value.message)


def scan_message(scan: Scan, log_time_ns: int) -> LaserScan:
    steps = max(len(scan.range_m) - 1, 0)
    return LaserScan(
        timestamp=foxglove_time(scan.stamp, log_time_ns),
        frame_id="lidar",
        pose=Pose(position=Vector3(), orientation=Quaternion(w=1.0)),
        start_angle=scan.angle_start_rad,
        end_angle=scan.angle_start_rad + steps * scan.angle_step_rad,
        ranges=scan.range_m.tolist(),
        intensities=scan.amplitude.tolist(),
    )


def scan_sample(value: Any, raw_ns: int, scan_id: int) -> Scan:
    """The step is what the two ends of the turn say; the id is the message's sequence."""
    steps = max(len(value.ranges) - 1, 1)
    return Scan(
        stamp=Stamp(raw_ns=raw_ns),
        id=scan_id,
        angle_start_rad=value.start_angle,
        angle_step_rad=(value.end_angle - value.start_angle) / steps,
        range_m=np.array(value.ranges, np.float32),
        amplitude=np.array(value.intensities, np.uint16),
    )


def fix_message(fix: Fix, log_time_ns: int) -> LocationFix:
    """A fix without a position is a message too: NaN, and ``valid`` says false."""
    message = LocationFix(
        timestamp=foxglove_time(fix.stamp, log_time_ns),
        frame_id="gnss",
        latitude=_or_nan(fix.latitude_deg),
        longitude=_or_nan(fix.longitude_deg),
        altitude=_or_nan(fix.altitude_m),
        metadata=[KeyValuePair(key=key, value=value) for key, value in _fix_metadata(fix).items()],
    )
    if fix.hdop is not None and fix.latitude_deg is not None:
        horizontal, vertical = (fix.hdop * RANGE_ERROR_M) ** 2, (2 * fix.hdop * RANGE_ERROR_M) ** 2
        message.position_covariance.extend([horizontal, 0, 0, 0, horizontal, 0, 0, 0, vertical])
        message.position_covariance_type = LocationFix.APPROXIMATED
    if fix.course_deg is not None:
        course = math.radians(fix.course_deg)
        message.heading = course
        if fix.speed_m_s is not None:
            east, north = fix.speed_m_s * math.sin(course), fix.speed_m_s * math.cos(course)
            message.velocity.CopyFrom(Vector3(x=east, y=north, z=0.0))
    return message


_FIX_METADATA: dict[str, Callable[[str], Any]] = {
    "mode": str,
    "problem": str,
    "dimensions": int,
    "leap_second": lambda text: text == "True",
    "satellites": int,
    "hdop": float,
    "speed_m_s": float,
    "course_deg": float,
}


def _fix_metadata(fix: Fix) -> dict[str, str]:
    """What the message type has no field for, or would round."""
    values: dict[str, Any] = {name: getattr(fix, name) for name in _FIX_METADATA}
    values |= {name: getattr(fix.stamp, name) for name in STAMP_FIELDS}
    known = {name: str(one) for name, one in values.items() if one not in (None, "") and one is not False}
    return {"valid": "true" if fix.valid else "false"} | known


def fix_sample(value: Any, raw_ns: int) -> Fix:
    told = {pair.key: pair.value for pair in value.metadata}
    stamp = {name: int(told[name]) for name in STAMP_FIELDS if name in told}
    numbers = {name: kind(told[name]) for name, kind in _FIX_METADATA.items() if name in told}
    return Fix(
        stamp=Stamp(**{"raw_ns": raw_ns} | stamp),
        valid=told.get("valid") == "true",
        latitude_deg=_or_none(value.latitude),
        longitude_deg=_or_none(value.longitude),
        altitude_m=_or_none(value.altitude),
        **{"mode": ""} | numbers,
    )


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value
