"""What stands at the head of every segment, so that it can be read alone.

Each is an MCAP metadata record with its own checksum, since MCAP gives those none and a segment
that a power cut ended has no other.
"""

import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import metadata

from recorder.samples import ClockPair

FORMAT_VERSION = 1
"""Of a drive. A reader refuses what is newer than itself."""

DRIVE, CONFIG, VERSIONS, DEVICES, END = (
    "recorder.drive",
    "recorder.config",
    "recorder.versions",
    "recorder.devices",
    "recorder.end",
)
CHECKSUM_KEY = ".crc32"
CLOCK_PAIRS = "clock_pairs.json"
CLOCK_PAIRS_MAX = 256


def _software() -> str:
    try:
        return f"recorder {metadata.version('recorder')}"
    except metadata.PackageNotFoundError:
        return "recorder"


SOFTWARE = _software()


@dataclass(frozen=True, slots=True)
class DriveHead:
    """What is known of a drive when it begins."""

    config_json: str
    """The effective configuration."""
    log_offset_ns: int
    """log_time - raw_ns, the same for the whole drive."""
    start_raw_ns: int
    utc_ns: int | None = None
    """UTC at the start, if a source is trusted by then; it gives the folder its name."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Software, kernel and driver versions by name."""
    devices: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """Model, serial number and the like of each device by its name."""


def drive_record(head: DriveHead, *, drive: str, segment: int | str) -> dict[str, str]:
    return sealed(
        DRIVE,
        {
            "format": str(FORMAT_VERSION),
            "drive": drive,
            "segment": str(segment),
            "log_offset_ns": str(head.log_offset_ns),
            "start_raw_ns": str(head.start_raw_ns),
            "software": SOFTWARE,
        },
    )


def config_record(head: DriveHead) -> dict[str, str]:
    return sealed(CONFIG, {"json": head.config_json})


def devices_record(devices: Mapping[str, Mapping[str, str]]) -> dict[str, str]:
    """One key for each device, its value a JSON object."""
    values = {name: json.dumps(dict(what), sort_keys=True) for name, what in devices.items()}
    return sealed(DEVICES, values)


def end_record(reason: str, messages: Mapping[str, int]) -> dict[str, str]:
    """``messages``: of the whole drive so far, by topic."""
    return sealed(END, {"reason": reason, "messages": json.dumps(dict(messages), sort_keys=True)})


def sealed(name: str, values: Mapping[str, str]) -> dict[str, str]:
    """``values`` and the checksum of the record that bears them under ``name``."""
    return {**values, CHECKSUM_KEY: _checksum(name, values)}


def is_sound(name: str, values: Mapping[str, str]) -> bool:
    """Whether a metadata record says what was written."""
    return values.get(CHECKSUM_KEY) == _checksum(name, unsealed(values))


def unsealed(values: Mapping[str, str]) -> dict[str, str]:
    return {key: value for key, value in values.items() if key != CHECKSUM_KEY}


def _checksum(name: str, values: Mapping[str, str]) -> str:
    return f"{zlib.crc32(json.dumps([name, dict(values)], sort_keys=True).encode()):08x}"


class ClockPairHistory:
    """The clock pairs of a drive so far, thinned out evenly as they become many."""

    def __init__(self) -> None:
        self._pairs: list[ClockPair] = []
        self._last: ClockPair | None = None
        self._stride = 1
        self._count = 0

    def add(self, pair: ClockPair) -> None:
        """Keep every pair at first, then every second, every fourth …"""
        if self._count % self._stride == 0:
            self._pairs.append(pair)
            if len(self._pairs) == CLOCK_PAIRS_MAX:
                self._pairs = self._pairs[::2]
                self._stride *= 2
        self._count += 1
        self._last = pair

    def pairs(self) -> list[ClockPair]:
        """At most `CLOCK_PAIRS_MAX`, the first and the latest among them."""
        if self._last is None or self._pairs[-1] is self._last:
            return list(self._pairs)
        return [*self._pairs, self._last]

    def to_json(self, log_offset_ns: int) -> bytes:
        names = ("raw_ns", "monotonic_ns", "realtime_ns", "boottime_ns", "bracket_ns")
        pairs = [{name: getattr(pair, name) for name in names} for pair in self.pairs()]
        return json.dumps({"log_offset_ns": log_offset_ns, "pairs": pairs}).encode()
