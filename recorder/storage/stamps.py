"""`Stamp` and `CameraSettings` as protobuf and back; times as Foxglove's messages carry them."""

from typing import Any

from google.protobuf.timestamp_pb2 import Timestamp

from recorder.samples import CameraSettings, Stamp
from recorder.storage import recorder_pb2 as pb

STAMP_FIELDS = tuple(Stamp.__dataclass_fields__)
_SETTINGS_FIELDS = tuple(CameraSettings.__dataclass_fields__)


def _known(sample: object, fields: tuple[str, ...]) -> dict[str, Any]:
    values = {name: getattr(sample, name) for name in fields}
    return {name: value for name, value in values.items() if value is not None}


def stamp_to_proto(stamp: Stamp) -> pb.Stamp:
    return pb.Stamp(**_known(stamp, STAMP_FIELDS))


def settings_to_proto(settings: CameraSettings) -> pb.CameraSettings:
    return pb.CameraSettings(**_known(settings, _SETTINGS_FIELDS))


def stamp_from_proto(value: Any) -> Stamp:
    """From a ``recorder.Stamp``, of whatever version of the schema."""
    return Stamp(**{field.name: number for field, number in value.ListFields() if field.name in STAMP_FIELDS})


def settings_from_proto(value: Any) -> CameraSettings:
    """From a ``recorder.CameraSettings``, of whatever version of the schema."""
    known = {field.name: number for field, number in value.ListFields() if field.name in _SETTINGS_FIELDS}
    return CameraSettings(**known)


def timestamp(ns: int) -> Timestamp:
    """Nanoseconds since 1970 as protobuf's time."""
    seconds, nanos = divmod(ns, 1_000_000_000)
    return Timestamp(seconds=seconds, nanos=nanos)


def timestamp_ns(value: Any) -> int:
    """protobuf's time as nanoseconds since 1970."""
    return int(value.seconds) * 1_000_000_000 + int(value.nanos)


def foxglove_time(stamp: Stamp | None, log_time_ns: int) -> Timestamp:
    """The time of a Foxglove message: UTC if it is known, else the log time."""
    known = stamp.utc_ns if stamp is not None else None
    return timestamp(log_time_ns if known is None else known)
