"""One table: which topic a sample goes to, as which message, and how it is read back."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.LaserScan_pb2 import LaserScan
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.Log_pb2 import Log

from recorder.samples import (
    CanMessage,
    ClockPair,
    DeviceState,
    EncodedFrame,
    Fix,
    FrameTime,
    Health,
    LogLine,
    Loss,
    LossCause,
    NmeaSentence,
    PpsEdge,
    Preview,
    Record,
    Scan,
    UtcTime,
    preview_topic,
    time_topic,
)
from recorder.storage import foxglove
from recorder.storage import recorder_pb2 as pb
from recorder.storage.frame_message import frame_to_bytes
from recorder.storage.schemas import MessageClass
from recorder.storage.stamps import settings_from_proto, stamp_from_proto, stamp_to_proto


@dataclass(frozen=True, slots=True)
class Times:
    """What a message may say of time beside its sample's own stamps."""

    log_time_ns: int
    log_offset_ns: int


@dataclass(frozen=True, slots=True)
class Kind:
    """How one type of sample stands in a drive."""

    topic: Callable[[Any], str]
    message: MessageClass
    encode: Callable[[Any, Times], bytes]
    decode: Callable[[Any, int, int], Record]
    """From the decoded message, its ``raw_ns`` and its sequence number."""

    @property
    def schema(self) -> str:
        return str(self.message.DESCRIPTOR.full_name)


_FRAME_TIME = tuple(FrameTime.__dataclass_fields__)


def _frame(value: Any, _raw_ns: int, _sequence: int) -> EncodedFrame:
    return EncodedFrame(
        camera=value.frame_id.removeprefix("camera_"),
        id=value.id,
        stamp=stamp_from_proto(value.stamp),
        width=value.width,
        height=value.height,
        bit_depth=value.bit_depth,
        settings=settings_from_proto(value.settings),
        data=value.data,
    )


def _nmea_message(sentence: NmeaSentence, _times: Times) -> bytes:
    stamp = stamp_to_proto(sentence.stamp)
    return pb.NmeaSentence(stamp=stamp, data=sentence.data, problem=sentence.problem).SerializeToString()


def _pps_message(edge: PpsEdge, _times: Times) -> bytes:
    return pb.PpsEdge(stamp=stamp_to_proto(edge.stamp), sequence=edge.sequence).SerializeToString()


def _pair_message(pair: ClockPair, times: Times) -> bytes:
    return pb.ClockPair(
        raw_ns=pair.raw_ns,
        monotonic_ns=pair.monotonic_ns,
        realtime_ns=pair.realtime_ns,
        boottime_ns=pair.boottime_ns,
        bracket_ns=pair.bracket_ns,
        log_offset_ns=times.log_offset_ns,
        stepped=pair.stepped,
    ).SerializeToString()


def _pair(value: Any, _raw_ns: int, _sequence: int) -> ClockPair:
    stepped = getattr(value, "stepped", False)  # older drives do not say
    return ClockPair(
        value.raw_ns, value.monotonic_ns, value.realtime_ns, value.boottime_ns, value.bracket_ns, stepped
    )


def _utc_message(utc: UtcTime, _times: Times) -> bytes:
    return pb.UtcTime(
        raw_ns=utc.raw_ns,
        utc_ns=utc.utc_ns,
        sigma_ns=utc.sigma_ns,
        source=utc.source,
        half_width_ns=utc.half_width_ns,
    ).SerializeToString()


def _utc(value: Any, _raw_ns: int, _sequence: int) -> UtcTime:
    half_width_ns = value.half_width_ns if value.HasField("half_width_ns") else None
    return UtcTime(value.raw_ns, value.utc_ns, value.sigma_ns, value.source, half_width_ns)


def _frame_time_message(time: FrameTime, _times: Times) -> bytes:
    return pb.FrameTime(**{name: getattr(time, name) for name in _FRAME_TIME}).SerializeToString()


def _loss_message(loss: Loss, _times: Times) -> bytes:
    return pb.Loss(
        stream=loss.stream,
        first_id=loss.first_id,
        last_id=loss.last_id,
        count=loss.count,
        first_raw_ns=loss.first_raw_ns,
        last_raw_ns=loss.last_raw_ns,
        cause=loss.cause.value,
        detail=loss.detail,
    ).SerializeToString()


def _loss(value: Any, _raw_ns: int, _sequence: int) -> Loss:
    return Loss(
        stream=value.stream,
        first_id=value.first_id,
        last_id=value.last_id,
        first_raw_ns=value.first_raw_ns if value.HasField("first_raw_ns") else None,
        last_raw_ns=value.last_raw_ns if value.HasField("last_raw_ns") else None,
        cause=LossCause(value.cause),
        detail=value.detail,
    )


def _health_message(health: Health, _times: Times) -> bytes:
    return pb.Health(
        raw_ns=health.raw_ns,
        device=health.device,
        state=health.state.value,
        reason=health.reason,
        samples=health.samples,
        lost=health.lost,
    ).SerializeToString()


def _health(value: Any, _raw_ns: int, _sequence: int) -> Health:
    state = DeviceState(value.state)
    return Health(value.raw_ns, value.device, state, value.reason, value.samples, value.lost)


def _can_message(frame: CanMessage, _times: Times) -> bytes:
    return pb.CanMessage(
        stamp=stamp_to_proto(frame.stamp),
        bus=frame.bus,
        arbitration_id=frame.arbitration_id,
        data=frame.data,
        is_extended=frame.is_extended,
        is_remote=frame.is_remote,
        is_error=frame.is_error,
    ).SerializeToString()


def _can(value: Any, _raw_ns: int, _sequence: int) -> CanMessage:
    flags = (value.is_extended, value.is_remote, value.is_error)
    return CanMessage(stamp_from_proto(value.stamp), value.bus, value.arbitration_id, value.data, *flags)


def _at(topic: str) -> Callable[[Any], str]:
    return lambda _sample: topic


def _foxglove(convert: Callable[[Any, int], Any]) -> Callable[[Any, Times], bytes]:
    return lambda sample, times: cast(bytes, convert(sample, times.log_time_ns).SerializeToString())


def _unnumbered(convert: Callable[[Any, int], Record]) -> Callable[[Any, int, int], Record]:
    return lambda value, raw_ns, _sequence: convert(value, raw_ns)


KINDS: dict[type, Kind] = {
    EncodedFrame: Kind(lambda s: s.topic, pb.FelicsFrame, lambda s, _times: frame_to_bytes(s), _frame),
    Preview: Kind(
        lambda s: preview_topic(s.camera),
        CompressedImage,
        _foxglove(foxglove.preview_message),
        _unnumbered(foxglove.preview_sample),
    ),
    NmeaSentence: Kind(
        _at("/gnss/raw"),
        pb.NmeaSentence,
        _nmea_message,
        lambda v, _raw_ns, _sequence: NmeaSentence(stamp_from_proto(v.stamp), v.data, v.problem),
    ),
    Fix: Kind(
        _at("/gnss/fix"), LocationFix, _foxglove(foxglove.fix_message), _unnumbered(foxglove.fix_sample)
    ),
    PpsEdge: Kind(
        _at("/gnss/pps"),
        pb.PpsEdge,
        _pps_message,
        lambda v, _raw_ns, _sequence: PpsEdge(stamp_from_proto(v.stamp), v.sequence),
    ),
    ClockPair: Kind(_at("/clock/pairs"), pb.ClockPair, _pair_message, _pair),
    UtcTime: Kind(_at("/time/utc"), pb.UtcTime, _utc_message, _utc),
    FrameTime: Kind(
        lambda s: time_topic(s.camera),
        pb.FrameTime,
        _frame_time_message,
        lambda v, _raw_ns, _sequence: FrameTime(**{name: getattr(v, name) for name in _FRAME_TIME}),
    ),
    Loss: Kind(_at("/loss"), pb.Loss, _loss_message, _loss),
    Health: Kind(_at("/health"), pb.Health, _health_message, _health),
    LogLine: Kind(_at("/log"), Log, _foxglove(foxglove.log_message), _unnumbered(foxglove.log_sample)),
    Scan: Kind(_at("/lidar/scan"), LaserScan, _foxglove(foxglove.scan_message), foxglove.scan_sample),
    CanMessage: Kind(_at("/can/raw"), pb.CanMessage, _can_message, _can),
}
"""Sample type → how it stands in a drive."""

_BY_SCHEMA = {kind.schema: kind for kind in KINDS.values()}

SHARED_TOPICS = frozenset({"/health", "/log", "/loss"})
"""Topics on which several devices speak: their times need not follow one another."""


def raw_ns_of(record: Record) -> int | None:
    """The raw instant of a sample; None if nobody knows it, and for a `Loss`, which tells of others."""
    if isinstance(record, Loss):
        return None
    if isinstance(record, (ClockPair, UtcTime, FrameTime, Health, LogLine)):
        return record.raw_ns
    return record.stamp.raw_ns


def decode(schema: str, value: Any, *, raw_ns: int, sequence: int = 0) -> Record | None:
    """The sample that a decoded protobuf message stands for; None if there is no such sample.

    Previews, lidar scans and log lines come back with the raw time and without their other stamps:
    Foxglove's types have no room for them. Raises ValueError on words of a newer version.
    """
    kind = _BY_SCHEMA.get(schema)
    return kind.decode(value, raw_ns, sequence) if kind else None
