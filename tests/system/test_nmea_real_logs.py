"""Every recorded log, of nearly a hundred receivers, against what gpsd makes of it (``.chk``).

They are played through a pseudo-terminal into the driver, as fast as it takes them.
"""

import json
import os
import pty
import termios
import threading
import tty
from collections import Counter
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import pytest

from recorder.config import GnssSection
from recorder.drivers.gnss import GnssReceiver
from recorder.drivers.nmea import DAY_NS, SECOND_NS, FixAssembler, SentenceSplitter
from recorder.drivers.nmea_log import NmeaLog
from recorder.errors import DeviceLost, DeviceUnsuitable, SourceError
from recorder.samples import Fix, LogLine, NmeaSentence, Sample
from recorder.simulation.sirf_receiver import Instant, SirfReceiver

TOLERANCE_DEG = 1e-7
WEEKS_1024_NS = 7168 * DAY_NS

LEARNS = "gpsd leaves out one second while it learns which sentence ends the receiver's burst"
ENDS = "the log ends before gpsd takes the last burst for ended"
OF_RMC = "gpsd reports the RMC, which has a digit less than the GGA that we take the position from"
GLL = "a time that only GLL tells, which we do not read"
DIFFERENCES: dict[str, tuple[dict[str, int], str]] = {
    **dict.fromkeys(
        (
            "beidou-bd", "beidou-gb", "blumax-gps009", "bn-9015", "geos-1m", "gp-320fw-2019-03-28",
            "gp-320fw-2019-04-06-overflow", "haicom-305N", "motorola-t805", "mtk-3301", "myguide-3100",
            "rgm3800", "tn204", "tr737A+",
        ),
        ({"only ours": 1}, LEARNS),
    ),
    **dict.fromkeys(
        (
            "ch-4701", "foretrex-201", "gps-360", "isync", "pharos-360", "st-teseo-liv3f", "ublox-lea-4h",
            "ublox-lea-4s", "ublox-lea-5h", "venus634lp",
        ),
        ({"only ours": 1}, ENDS),
    ),
    "bt451": ({"only ours": 2}, f"{LEARNS}; {ENDS}"),
    "ac12": ({"place": 7}, OF_RMC),
    "tcp-test": ({"place": 1}, OF_RMC),
    "udp-test": ({"place": 1}, OF_RMC),
    "eXplorist210": ({"only gpsd": 3}, GLL),
    "magellan315": ({"only gpsd": 1}, GLL + ": to the millisecond, the others to the hundredth"),
    "triton400": ({"only gpsd": 1}, GLL + ": the GGA and the RMC of this second are cut off"),
    "garmin48": (
        {"only ours": 6, "only gpsd": 7},
        "its GLL tells a second more than its RMC and GGA, and gpsd goes by the GLL",
    ),
    "neo-m8n": (
        {"only ours": 23, "only gpsd": 22},
        "gpsd was run with a later build date and takes 2015 for a week rollover: 1024 weeks apart",
    ),
}  # fmt: skip
"""Where gpsd and we do not say the same: instants of which only one has a fix, other places, other
states (there is none of these). Of all logs that are not named here every fix agrees."""

NOT_NMEA = {
    "bu303-climbing", "bu303-moving", "bu303-stillfix", "bu303b-nofix",  # SiRF binary
    "sirfstarv", "ublox-sirf1",  # SiRF binary
    "u-blox-m8t-time", "ublox-8-time",  # UBX
    "hp58534a", "skytraq-err",  # no sentence has a checksum: none can be told from a damaged one
}  # fmt: skip
"""Logs without a single sound sentence."""


@pytest.fixture
def logs(shared_data: Path) -> Path:
    folder = shared_data / "nmea"
    if not folder.is_dir():
        pytest.skip(f"real NMEA logs are not there: {folder}")
    return folder


def test_every_log_is_kept_byte_for_byte_and_none_raises(logs: Path) -> None:
    paths = sorted(logs.rglob("*.log"))
    assert len(paths) > 100
    for path in paths:
        data = path.read_bytes()
        for step in (len(data) or 1, 16):
            splitter, assembler = SentenceSplitter(), FixAssembler()
            starts = range(0, len(data), step)
            pieces = [piece for at in starts for piece in splitter.feed(data[at : at + step], at)]
            pieces += splitter.flush()
            assert b"".join(piece.data for piece in pieces) == data, path.name
            for piece in pieces:
                assembler.add(piece)


def test_every_log_is_replayed_in_order_or_refused_by_name(logs: Path) -> None:
    refused = set()
    for path in sorted(logs.glob("*.log")):
        try:
            arrivals = [one.stamp.raw_ns or 0 for one in replay(path) if isinstance(one, NmeaSentence)]
        except SourceError:
            refused.add(path.stem)
            continue
        assert arrivals == sorted(arrivals), path.name
        assert arrivals[-1] < 3600 * SECOND_NS, path.name
    assert refused == NOT_NMEA


def test_through_a_pty_no_byte_is_lost_and_every_fix_agrees_with_gpsd_but_for_what_is_explained(
    logs: Path,
) -> None:
    found: dict[str, dict[str, int]] = {}
    both = 0
    for path in sorted(logs.glob("*.log")):
        if path.stem in NOT_NMEA:
            continue
        told = list(through_pty(path.read_bytes()))
        assert joined(told) == path.read_bytes(), path.name
        if path.with_suffix(".log.chk").exists():
            ours = {fix.stamp.gps_ns: fix for fix in told if isinstance(fix, Fix) and fix.stamp.gps_ns}
            theirs = gpsd_reports(path.with_suffix(".log.chk"))
            both += len(ours.keys() & theirs.keys())
            if differences := compare(ours, theirs):
                found[path.stem] = dict(differences)
    assert found == {name: counts for name, (counts, _) in DIFFERENCES.items()}
    assert both >= 1300, "of so many instants both speak"


def test_a_log_that_gpsd_dates_1024_weeks_later_agrees_but_for_that(logs: Path) -> None:
    ours = {
        fix.stamp.gps_ns + WEEKS_1024_NS: fix
        for fix in replay(logs / "neo-m8n.log")
        if isinstance(fix, Fix) and fix.stamp.gps_ns is not None
    }
    theirs = gpsd_reports(logs / "neo-m8n.log.chk")
    assert compare(ours, theirs) == {"only ours": 1}  # the first: gpsd learns
    assert len(ours.keys() & theirs.keys()) == 22


@pytest.mark.parametrize("folder", ["pynmeagps"])
def test_vendors_logs_come_through_a_pty_byte_for_byte(logs: Path, folder: str) -> None:
    for path in sorted((logs / folder).glob("*.log")):
        assert joined(list(through_pty(path.read_bytes()))) == path.read_bytes(), path.name


SIRF = ["bu303-climbing", "bu303-moving", "bu303-stillfix", "bu303b-nofix", "sirfstarv", "ublox-sirf1"]


@pytest.mark.parametrize("name", SIRF)
@pytest.mark.parametrize("part", [0, 1, 2])
def test_recorded_sirf_binary_is_recognised_from_any_place_on(logs: Path, name: str, part: int) -> None:
    data = (logs / f"{name}.log").read_bytes()
    told: list[Sample] = []
    with pytest.raises(DeviceUnsuitable, match="speaks SiRF binary, not NMEA"):
        told.extend(through_pty(data[len(data) * part // 3 + 7 * part :]))
    assert joined(told) in data, "what was heard before is handed out"


@pytest.mark.parametrize("name", ["u-blox-m8t-time", "ublox-8-time"])
def test_recorded_ubx_is_refused_by_name(logs: Path, name: str) -> None:
    data = (logs / f"{name}.log").read_bytes()
    with pytest.raises(DeviceUnsuitable, match="speaks UBX, not NMEA; switch it to NMEA"):
        list(through_pty(data, wait=True))


@pytest.mark.parametrize("name", ["hp58534a", "skytraq-err"])
def test_lines_without_checksums_are_recorded_and_told_of(logs: Path, name: str) -> None:
    data = (logs / f"{name}.log").read_bytes()
    told = list(through_pty(data))
    assert joined(told) == data
    assert not [one for one in told if isinstance(one, Fix)]
    assert any("no sound checksums" in one.message for one in told if isinstance(one, LogLine))


@pytest.mark.parametrize("name", ["bu303-climbing", "bu303-moving", "bu303-stillfix", "bu303b-nofix"])
def test_a_receiver_that_says_what_was_recorded_is_switched_to_nmea(logs: Path, name: str) -> None:
    """It obeys message 129; until then it says the log, again and again, at 57600 baud."""
    data = (logs / f"{name}.log").read_bytes()
    instants = (Instant(1_790_000_000 * SECOND_NS + n * SECOND_NS, 46.95, 7.48) for n in range(10_000))
    with _Recorded(data, instants) as twin:
        driver = GnssReceiver(GnssSection(source=str(twin.path)))
        driver.open()
        said: list[str] = []
        for sample in driver.samples():
            if isinstance(sample, LogLine):
                said.append(sample.message)
            if isinstance(sample, Fix) and sample.valid:
                break
        driver.close()
    assert said[0] == "speaks SiRF binary at 57600 baud, is told to speak NMEA"
    assert said[1] == "speaks NMEA at 57600 baud, switched from SiRF binary"


class _Recorded(SirfReceiver):
    """Says a recorded log while it is in binary."""

    def __init__(self, data: bytes, instants: Iterator[Instant]) -> None:
        super().__init__(instants, baud=57600, binary=True)
        self._data = data

    def _bursts_of(self, instants: Iterator[Instant | None]) -> Iterator[list[bytes]]:
        for burst in super()._bursts_of(instants):
            yield [self._data] if self.binary else list(burst)


@pytest.mark.parametrize(
    "name",
    ["GPSmap-76S", "eXplorist110", "garmin-geko201", "holux-gm-210", "skytraq", "tn200", "ublox-lea-5q"],
)
def test_receivers_without_a_fix_are_not_believed(logs: Path, name: str) -> None:
    """No fix (V, N, 0) and simulators (S, 8): gpsd reports no position either."""
    assert not any(sample.valid for sample in replay(logs / f"{name}.log") if isinstance(sample, Fix))


def replay(path: Path) -> list[NmeaSentence | Fix | None]:
    driver = NmeaLog(path, origin_raw_ns=0, realtime=False)
    driver.open()
    try:
        return list(driver.samples())
    finally:
        driver.close()


def through_pty(data: bytes, *, wait: bool = False) -> Iterator[Sample]:
    """What the driver yields of a receiver that says this and is then unplugged. With ``wait`` the
    driver may first find out what it speaks."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    settings = GnssSection(source=os.ttyname(slave), baud=115200, configure=False)
    driver = GnssReceiver(settings)
    driver.open()
    said = threading.Event()

    def say() -> None:
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[os.write(master, rest[:512]) :]
        except OSError:  # refused meanwhile
            return
        said.set()

    thread = threading.Thread(target=say)
    thread.start()
    ends = {master, slave}
    silences = 0
    try:
        for sample in driver.samples():
            if sample is not None:
                yield sample
            elif said.is_set():
                silences += 1
                if silences > (30 if wait else 1):
                    for end in ends:
                        os.close(end)
                    ends = set()
    except DeviceLost:
        return
    finally:
        driver.close()
        while thread.is_alive():  # refused: nobody reads any more
            termios.tcflush(slave, termios.TCIFLUSH)
            thread.join(0.01)
        for end in ends:
            os.close(end)


def joined(told: list[Sample]) -> bytes:
    return b"".join(one.data for one in told if isinstance(one, NmeaSentence))


Report = dict[str, object]


def compare(ours: dict[int, Fix], theirs: dict[int, list[Report]]) -> Counter[str]:
    """How many instants differ, and in what."""
    found: Counter[str] = Counter()
    for time_ns, fix in ours.items():
        reports = theirs.get(time_ns)
        if reports is None:
            found["only ours"] += fix.valid
        elif fix.valid != any(report["mode"] in (2, 3) for report in reports):
            found["state"] += 1
        elif fix.valid and not any(near(fix, report) for report in reports if "lat" in report):
            found["place"] += any("lat" in report for report in reports)
    found["only gpsd"] = len(theirs.keys() - ours.keys())
    return +found


def near(fix: Fix, report: Report) -> bool:
    latitude, longitude = report["lat"], report["lon"]
    assert isinstance(latitude, float)
    assert isinstance(longitude, float)
    assert fix.latitude_deg is not None
    assert fix.longitude_deg is not None
    return (
        abs(fix.latitude_deg - latitude) < TOLERANCE_DEG
        and abs(fix.longitude_deg - longitude) < TOLERANCE_DEG
    )


def gpsd_reports(path: Path) -> dict[int, list[Report]]:
    """By time, Unix-like: gpsd's reports that tell one."""
    reports: dict[int, list[Report]] = {}
    for line in path.read_bytes().splitlines():
        report = json.loads(line) if line.startswith(b'{"class":"TPV"') else {}
        if "time" in report:
            whole, _, rest = report["time"].removesuffix("Z").partition(".")
            seconds = int(datetime.fromisoformat(whole + "+00:00").timestamp())
            reports.setdefault(seconds * SECOND_NS + int(rest.ljust(9, "0")), []).append(report)
    return reports
