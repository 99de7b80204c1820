"""Small drives for the tests of the storage room."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recorder.codec import encode
from recorder.config import StorageSection
from recorder.samples import CameraSettings, EncodedFrame, Record, Stamp
from recorder.storage import DriveHead, DriveWriter

START_RAW_NS = 5_000_000_000
OFFSET_NS = 1_795_224_700_000_000_000
UTC_NS = 1_795_224_780_000_000_000
PERIOD_NS = 16_717_000

HEAD = DriveHead(
    config_json='{"storage": {"out": "somewhere"}}',
    log_offset_ns=OFFSET_NS,
    start_raw_ns=START_RAW_NS,
    utc_ns=UTC_NS,
    versions={"recorder": "0.1.0", "kernel": "6.1"},
    devices={"front": {"model": "A", "serial": "1"}},
)


def settings(out: Path, **changes: Any) -> StorageSection:
    return StorageSection(out=out, **{"reserve_bytes": 0} | changes)


def raw_ns(frame_id: int) -> int:
    return START_RAW_NS + frame_id * PERIOD_NS


def pixels(frame_id: int, camera: str = "front", bit_depth: int = 10) -> NDArray[np.uint16]:
    """12 x 16, the same each time for the same frame."""
    random = np.random.default_rng([frame_id, len(camera), bit_depth])
    return random.integers(0, 1 << bit_depth, (12, 16), dtype=np.uint16)


def frame(frame_id: int, camera: str = "front", bit_depth: int = 10, **stamps: int) -> EncodedFrame:
    image = pixels(frame_id, camera, bit_depth)
    time = raw_ns(frame_id)
    return EncodedFrame(
        camera=camera,
        id=frame_id,
        stamp=Stamp(**{"raw_ns": time, "utc_ns": time + UTC_NS, "utc_sigma_ns": 1000} | stamps),
        width=image.shape[1],
        height=image.shape[0],
        bit_depth=bit_depth,
        settings=CameraSettings("Mono10p", exposure_us=1500.5, gain=2.0),
        data=encode(image, bit_depth=bit_depth),
    )


def make_drive(out: Path, records: Iterable[Record], *, sync_every: int = 4, **changes: Any) -> Path:
    """A closed drive of these records."""
    with DriveWriter(settings(out, **changes), HEAD) as writer:
        for number, record in enumerate(records, 1):
            writer.write(record)
            if number % sync_every == 0:
                writer.sync()
    return writer.path


def frames(count: int, **options: Any) -> list[EncodedFrame]:
    return [frame(number, **options) for number in range(count)]
