"""What is written comes back bit for bit, by our reader and by the reference reader."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader

from recorder.samples import (
    CanMessage,
    ClockPair,
    DeviceState,
    Fix,
    Health,
    LogLine,
    Loss,
    LossCause,
    NmeaSentence,
    PpsEdge,
    Preview,
    Record,
    Scan,
    Stamp,
    UtcTime,
)
from recorder.storage import DriveWriter, inspect, open_drive, verify
from tests.unit.drive_maker import (
    HEAD,
    OFFSET_NS,
    UTC_NS,
    frame,
    frames,
    make_drive,
    pixels,
    raw_ns,
    settings,
)

FIX = Fix(
    stamp=Stamp(raw_ns=raw_ns(1), gps_ns=7, gps_raw_ns=raw_ns(1), utc_ns=UTC_NS, utc_sigma_ns=5),
    valid=True,
    mode="A/A/1",
    satellites=9,
    hdop=0.9,
    latitude_deg=50.1,
    longitude_deg=8.6,
    altitude_m=112.25,
    speed_m_s=27.7,
    course_deg=93.1,
    dimensions=3,
    leap_second=True,
)
NO_FIX = Fix(Stamp(raw_ns=raw_ns(2), gps_raw_ns=raw_ns(2)), valid=False, mode="V/N/0", problem="status V")
SCAN = Scan(
    Stamp(raw_ns=raw_ns(1)),
    17,
    -0.5,
    0.25,
    np.array([1.5, np.nan, 3.0], np.float32),
    np.array([5, 0, 9], np.uint16),
)
SMALL: list[Record] = [
    Preview("front", Stamp(raw_ns=raw_ns(1)), b"\xff\xd8jpeg"),
    NmeaSentence(Stamp(raw_ns=raw_ns(1), realtime_ns=3), b"$GPRMC,\xff*00\r\n", "checksum"),
    FIX,
    NO_FIX,
    ClockPair(raw_ns(1), 2, 3, 4, 5),
    UtcTime(raw_ns(1), UTC_NS, 300, "gnss", 588),
    Loss("/gnss/raw", 5, 9, None, raw_ns(2), LossCause.DEVICE, "unplugged"),
    Health(raw_ns(1), "front", DeviceState.SILENT, "no packet", 17, 2),
    LogLine(raw_ns(1), "warning", "front", "no packet"),
    CanMessage(Stamp(raw_ns=raw_ns(1), realtime_ns=8), "can0", 0x123, b"\x01\x02", is_extended=True),
    PpsEdge(Stamp(raw_ns=raw_ns(1), realtime_ns=UTC_NS), 41),
]


def test_frames_come_back_bit_for_bit(tmp_path: Path) -> None:
    recorded = frames(30)
    with open_drive(make_drive(tmp_path, recorded)) as drive:
        assert drive.problems == []
        for before, after in zip(recorded, drive.frames("front"), strict=True):
            assert after.data == before.data
            assert after.pixels.dtype == np.uint16
            assert np.array_equal(after.pixels, pixels(before.id))
            assert (after.camera, after.id, after.stamp) == ("front", before.id, before.stamp)
            assert (after.settings, after.bit_depth) == (before.settings, 10)
            assert (after.width, after.height) == (16, 12)


@pytest.mark.parametrize("record", SMALL, ids=lambda record: type(record).__name__)
def test_every_sample_comes_back(tmp_path: Path, record: Record) -> None:
    path = make_drive(tmp_path, [frame(0), frame(1), frame(2), record])
    with open_drive(path) as drive:
        topic = next(name for name in drive.topics if name != "/camera/front/image")
        (message,) = drive.messages(topic)
        assert message.sample == record
        assert message.log_time_ns == message.publish_time_ns == message.raw_ns + OFFSET_NS
        assert message.raw_ns == raw_ns(2 if record in (NO_FIX, SMALL[6]) else 1)
        assert verify(drive).ok


def test_a_scan_comes_back(tmp_path: Path) -> None:
    with open_drive(make_drive(tmp_path, [SCAN])) as drive:
        (message,) = drive.messages("/lidar/scan")
        scan = message.sample
        assert isinstance(scan, Scan)
        assert (scan.id, scan.angle_start_rad, scan.angle_step_rad) == (17, -0.5, 0.25)
        assert np.array_equal(scan.range_m, SCAN.range_m, equal_nan=True)
        assert np.array_equal(scan.amplitude, SCAN.amplitude)


def test_the_head_comes_back(tmp_path: Path) -> None:
    with DriveWriter(settings(tmp_path), HEAD) as writer:
        writer.write(frame(0))
        writer.set_devices({"front": {"serial": "2"}, "gnss": {}})
    assert writer.path == tmp_path / "0001-20261121T013300Z"
    with open_drive(writer.path) as drive:
        assert drive.config == {"storage": {"out": "somewhere"}}
        assert drive.versions == HEAD.versions
        assert drive.devices == {"front": {"serial": "2"}, "gnss": {}}
        assert (drive.log_offset_ns, drive.start_raw_ns) == (OFFSET_NS, HEAD.start_raw_ns)
        assert verify(drive).ok


def _classes(schema: Any) -> Any:
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


def test_a_drive_from_before_intervals_were_stated_gives_that_of_its_sigma(tmp_path: Path) -> None:
    path = make_drive(tmp_path, [UtcTime(raw_ns(1), UTC_NS, 300, "gnss")])
    with open_drive(path) as drive:
        (message,) = drive.messages("/time/utc")
    assert not message.value.HasField("half_width_ns")
    assert isinstance(message.sample, UtcTime)
    assert message.sample.half_width_ns is None
    assert message.sample.interval_ns == (UTC_NS - 588, UTC_NS + 588)


def test_the_reference_reader_reads_every_message(tmp_path: Path) -> None:
    path = make_drive(tmp_path, [*frames(5), *frames(5, camera="tag"), *SMALL, SCAN])
    found: Counter[tuple[str, str]] = Counter()
    with (path / "0000.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("protobuf", "protobuf")
            value = _classes(schema).FromString(message.data)
            found[channel.topic, schema.name] += 1
            if channel.topic == "/gnss/fix" and value.metadata[0].value == "false":
                assert np.isnan(value.latitude)
            if channel.topic == "/camera/tag/image":
                assert value.id == message.sequence
                assert value.data == frame(value.id, "tag").data
        names = [record.name for record in reader.iter_metadata()]
        (attachment,) = reader.iter_attachments()
    assert found == {
        ("/camera/front/image", "recorder.FelicsFrame"): 5,
        ("/camera/tag/image", "recorder.FelicsFrame"): 5,
        ("/camera/front/preview", "foxglove.CompressedImage"): 1,
        ("/gnss/raw", "recorder.NmeaSentence"): 1,
        ("/gnss/fix", "foxglove.LocationFix"): 2,
        ("/gnss/pps", "recorder.PpsEdge"): 1,
        ("/clock/pairs", "recorder.ClockPair"): 1,
        ("/time/utc", "recorder.UtcTime"): 1,
        ("/loss", "recorder.Loss"): 1,
        ("/health", "recorder.Health"): 1,
        ("/log", "foxglove.Log"): 1,
        ("/lidar/scan", "foxglove.LaserScan"): 1,
        ("/can/raw", "recorder.CanMessage"): 1,
    }
    wanted = [f"recorder.{name}" for name in ("drive", "config", "versions", "devices", "end")]
    assert names == wanted
    assert attachment.name == "clock_pairs.json"


def test_what_inspect_tells(tmp_path: Path) -> None:
    path = make_drive(tmp_path, [*frames(61), *SMALL])
    with open_drive(path) as drive:
        told = inspect(drive).to_dict()
    image = told["topics"]["/camera/front/image"]
    assert image["messages"] == 61
    assert image["rate_hz"] == pytest.approx(1e9 / 16_717_000)
    assert (image["gaps"], image["lost"], image["schema"]) == (0, 0, "recorder.FelicsFrame")
    assert image["bytes"] > sum(len(frame(number).data) for number in range(61))
    assert told["topics"]["/gnss/fix"]["gaps"] == 0
    assert told["losses"] == {"device": 5}
    assert told["duration_s"] == pytest.approx(60 * 0.016717)
    assert told["first_time"]["utc_ns"] == UTC_NS + raw_ns(0) - raw_ns(1)
    assert told["first_time"]["utc_sigma_ns"] == 300
    assert told["segments"] == [
        {"name": "0000.mcap", "bytes": (path / "0000.mcap").stat().st_size, "closed": True}
    ]
    assert told["ratios"]["front"] > 0
    assert told["problems"] == []
