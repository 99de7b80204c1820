"""``recorder.toml``: one section per room, typed, validated, frozen.

Every field has a default but the devices themselves, so the smallest useful file is three
lines. Unknown keys and bad values are refused with the key's path, the value and what would
be right.
"""

import json
import re
import tomllib
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from recorder.errors import ConfigError

CAMERA_NAMES = ("front", "tag")

Name = Annotated[str, Field(min_length=1, pattern=r"^[^\x00]*$")]
FilePath = Annotated[Path, Field(strict=False)]
"""Text in the file; everything else must have its type already."""


class Section(BaseModel):
    """A part of the configuration: frozen, nothing unknown in it."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, use_attribute_docstrings=True)


class CameraSection(Section):
    """One camera."""

    source: Name
    """``genicam://ADDRESS`` (empty address: the first one found), or a video file or image folder."""
    pixel_format: Literal["auto", "Mono8", "Mono10", "Mono10p", "Mono12", "Mono16"] = "auto"
    """As GenICam names it; auto takes the deepest that the camera offers, up to ten bits first."""
    width: Annotated[int, Field(ge=1, le=65535)] | None = None
    """Columns; the camera's largest if absent."""
    height: Annotated[int, Field(ge=1, le=65535)] | None = None
    """Rows; the camera's largest if absent."""
    rate_hz: Annotated[float, Field(ge=0.01, le=10_000)] | None = None
    """Frames a second; the camera's own if absent."""
    exposure_us: Annotated[float, Field(gt=0, le=1e7)] | None = None
    """The camera's own if absent."""
    gain: Annotated[float, Field(ge=0, le=1000)] | None = None
    """In the camera's own units."""
    packet_bytes: Annotated[int, Field(ge=576, le=9000)] | None = None
    """GigE Vision packet size; negotiated if absent."""
    stamp_event: Literal["exposure_start", "exposure_end", "transfer_end"] = "exposure_end"
    """What the camera's own stamp tells; the end of the exposure is the start of the readout."""
    transfer_us: Annotated[int, Field(ge=0, le=1_000_000)] = 0
    """From the end of the exposure to the earliest arrival of the frame here (readout, transfer); no clock
    can tell it, so given."""
    transfer_sigma_us: Annotated[int, Field(ge=0, le=1_000_000)] = 500
    """One standard deviation of ``transfer_us``."""
    stamp_wrap_s: Annotated[float, Field(gt=0.001, le=1e10)] | None = None
    """The camera's own counter begins anew after so long; absent if it does not within a drive."""
    times: FilePath | None = None
    """For a file source: a CSV with the times of its images, column ``time_ns`` or ``time_s``."""
    realtime: bool = True
    """For a file source: play at its own pace rather than as fast as it can be stored."""

    @property
    def is_file(self) -> bool:
        """Whether the source is a file rather than a camera."""
        return not self.source.startswith("genicam:")

    @model_validator(mode="after")
    def _every_key_does_something(self) -> "CameraSection":
        only_cameras = ("width", "height", "exposure_us", "gain", "packet_bytes", "stamp_wrap_s")
        set_in_vain = [key for key in only_cameras if self.is_file and getattr(self, key) is not None]
        stamps = ("stamp_event", "transfer_us", "transfer_sigma_us")
        set_in_vain += [key for key in stamps if self.is_file and key in self.model_fields_set]
        if self.is_file and self.pixel_format != "auto":
            set_in_vain.append("pixel_format")
        if not self.is_file and self.times is not None:
            set_in_vain.append("times")
        if set_in_vain:
            kind = "a file" if self.is_file else "a camera"
            raise ValueError(f"{', '.join(set_in_vain)} cannot be set for {kind} ({self.source})")
        return self


class GnssSection(Section):
    """The GNSS receiver."""

    source: Name
    """A serial device such as ``/dev/ttyUSB0``, ``gpsd://HOST:PORT``, or a recorded NMEA log."""
    baud: Literal["auto", 4800, 9600, 19200, 38400, 57600, 115200] = "auto"
    """Of the serial device; auto tries all, 4800 first: there a BU-353 leaves the factory."""
    configure: bool = True
    """Write to the serial device: out of SiRF binary, and only the sentences that serve."""
    pps: Name | None = None
    """The kernel's pulse per second, such as ``/dev/pps0``."""
    realtime: bool = True
    """For a log: play at its own pace."""


class DriversSection(Section):
    """Which devices there are."""

    camera: dict[str, CameraSection] = Field(default_factory=dict)
    """By name: front, tag."""
    gnss: GnssSection | None = None

    @field_validator("camera")
    @classmethod
    def _known_cameras(cls, value: dict[str, CameraSection]) -> dict[str, CameraSection]:
        for name in value:
            if name not in CAMERA_NAMES:
                raise ValueError(f"camera {name!r} is not one of {', '.join(CAMERA_NAMES)}")
        return value


class TimebaseSection(Section):
    """Clock pairs and GNSS time."""

    pair_seconds: Annotated[float, Field(gt=0, le=1)] = 0.5
    """How often the machine's clocks are compared, besides at once when the wall clock is set."""
    gnss_delay_ms: Annotated[int, Field(ge=0, le=5000)] = 600
    """From the instant that a burst of sentences speaks of to its first byte here; not observable
    without PPS, so given. 0.1 to 1.1 s have been seen."""
    gnss_delay_sigma_ms: Annotated[int, Field(ge=1, le=5000)] = 300
    """One standard deviation of ``gnss_delay_ms``."""
    not_before: Annotated[date, Field(strict=False)] = date(2025, 1, 1)
    """No receiver's date before it is believed: it is a rolled-over week count or a factory setting. The
    default is this program's age; 1970-01-01 believes every date, as for a log that is replayed."""

    @property
    def believing_every_date(self) -> "TimebaseSection":
        """The same for a log that is replayed."""
        return self.model_copy(update={"not_before": date(1970, 1, 1)})


class CodecSection(Section):
    """How frames are compressed."""

    model: Literal["felics", "felics-ls"] = "felics"
    """felics is the fastest; felics-ls is smaller, up to 12 bits (deeper frames get felics)."""
    k: Literal["trained", "context"] | Annotated[int, Field(ge=0, le=15)] = "trained"
    """Golomb-Rice parameter of felics: trained once a second (smallest), by context, or one number."""
    workers: Annotated[int, Field(ge=1, le=64)] = 2
    """Threads that compress."""


class StorageSection(Section):
    """Where drives go and how they are cut."""

    out: FilePath = Path("/var/lib/recorder/drives")
    """The folder that holds the drives."""
    segment_seconds: Annotated[float, Field(ge=1, le=3600)] = 60.0
    segment_bytes: Annotated[int, Field(ge=1 << 20, le=1 << 40)] = 4 << 30
    """A segment is closed at whichever comes first."""
    sync_seconds: Annotated[float, Field(gt=0, le=60)] = 0.5
    """How often what was written is forced to disk."""
    queue_bytes: Annotated[int, Field(ge=1 << 20, le=1 << 40)] = 512 << 20
    """Memory between devices and disk; a live device that outruns the disk by more loses frames, stated."""
    reserve_bytes: Annotated[int, Field(ge=0, le=1 << 40)] = 256 << 20
    """Free space that recording never eats."""


class RealtimeSection(Section):
    """What is computed while recording."""

    preview_hz: Annotated[float, Field(ge=0, le=10)] = 1.0
    """JPEG previews a second and camera; 0 switches them off."""
    preview_width: Annotated[int, Field(ge=64, le=4096)] = 640
    """Columns at most."""
    preview_quality: Annotated[int, Field(ge=1, le=100)] = 80


class ServiceSection(Section):
    """The running service."""

    socket: FilePath | None = None
    """Of ``recorder status``; ``$RECORDER_SOCKET`` or /run/recorder/status.sock if absent."""
    retry_seconds: Annotated[float, Field(gt=0, le=60)] = 0.5
    """First wait before a failed device is tried again; doubles up to ``retry_max_seconds``."""
    retry_max_seconds: Annotated[float, Field(gt=0, le=600)] = 5.0
    silent_seconds: Annotated[float, Field(gt=0, le=600)] = 3.0
    """A device that says nothing for so long is called silent."""


class Settings(Section):
    """The whole configuration."""

    drivers: DriversSection = Field(default_factory=DriversSection)
    timebase: TimebaseSection = Field(default_factory=TimebaseSection)
    codec: CodecSection = Field(default_factory=CodecSection)
    storage: StorageSection = Field(default_factory=StorageSection)
    realtime: RealtimeSection = Field(default_factory=RealtimeSection)
    service: ServiceSection = Field(default_factory=ServiceSection)

    @model_validator(mode="after")
    def _something_to_record(self) -> "Settings":
        if not self.drivers.camera and self.drivers.gnss is None:
            raise ValueError("no device: add [drivers.camera.front] or [drivers.gnss] with a source")
        return self

    def to_json(self) -> str:
        """The effective configuration, as every segment of a drive carries it."""
        return json.dumps(self.model_dump(mode="json"), indent=1, sort_keys=True)


def load(path: Path) -> Settings:
    """Read and check a configuration file. Raises `ConfigError` with one line on all that is wrong."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise ConfigError("no such file", where=str(path), todo="give the path of a recorder.toml") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot be read ({error})", where=str(path)) from error
    try:
        values = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ConfigError(f"not TOML: {error}", where=str(path)) from error
    return parse(values, where=str(path))


def parse(values: dict[str, Any], *, where: str) -> Settings:
    """Check values that stand for a file named ``where``. Raises `ConfigError`."""
    try:
        return Settings.model_validate(values)
    except ValidationError as error:
        lines: dict[str, str] = {}
        for one in error.errors():
            key, problem = _explain(dict(one))
            lines[key] = f"{lines[key]}, or {problem}" if key in lines else problem
        told = "; ".join(f"{key}: {problem}" if key else problem for key, problem in lines.items())
        raise ConfigError(told, where=where) from None


def _explain(error: dict[str, Any]) -> tuple[str, str]:
    """One pydantic error as the key with its value, and what would be right."""
    union_tag = re.compile(r"^(literal\[|constrained-|function-|int$|str$|float$)")
    path = [str(part) for part in error["loc"] if not union_tag.match(str(part))]
    key = ".".join(path)
    if error["type"] == "extra_forbidden":
        return key, f"unknown key, known here: {', '.join(_known(path[:-1]))}"
    if error["type"] == "missing":
        return key, "missing, it must be given"
    message = str(error["msg"]).removeprefix("Value error, ")
    message = message[:1].lower() + message[1:]
    if not path:
        return "", message
    shown = json.dumps(error["input"], default=str)
    return f"{key} = {shown if len(shown) < 60 else shown[:57] + '...'}", message


def _known(path: list[str]) -> list[str]:
    """The keys that the section at ``path`` may have."""
    section: Any = Settings
    for part in path:
        if section is DriversSection and part == "camera":
            return list(CAMERA_NAMES) if path[-1] == "camera" else list(CameraSection.model_fields)
        section = {"gnss": GnssSection}.get(part) or section.model_fields[part].annotation
    return list(section.model_fields)
