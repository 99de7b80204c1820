"""Every recorded NMEA log, by nearly a hundred receivers, against what gpsd makes of it (``.chk``)."""

import json
import re
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import pytest

from recorder.drivers.nmea import DAY_NS, SECOND_NS, FixAssembler, SentenceSplitter
from recorder.drivers.nmea_log import NmeaLog
from recorder.errors import SourceError
from recorder.samples import Fix, NmeaSentence

TOLERANCE_DEG = 1e-7
WEEKS_1024_NS = 7168 * DAY_NS

WELL_BEHAVED = {
    "sirfstarv-nmea": 59,
    "bt-q818": 10,
    "cat-ms352": 40,
    "com-1289": 14,
    "et-332": 19,
    "furuno_gl_ga": 16,
    "gpslim236": 20,
    "iTrek": 35,
    "meinberg-gps164": 70,
    "mt3339": 30,
    "navika-100-fix": 20,
    "nmea-rtk": 122,
    "quectelLC79D-1": 29,
    "telit-pls83-w": 10,
    "ublox-f9p-hpnmea": 9,
}
"""Logs of which gpsd speaks at every valid fix, and how many those are."""

DIFFERENT = {
    # gpsd reports the RMC, which has a digit less than the GGA that we take the position from.
    "ac12": "position of RMC, not GGA",
    "tcp-test": "position of RMC, not GGA",
    "udp-test": "position of RMC, not GGA",
    # gpsd was run with a later build date and takes 2015 for a week rollover; so 1024 weeks apart.
    "neo-m8n": "date shifted by gpsd",
}
"""Logs where both speak of the same second and rightly say different things."""

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


@dataclass(frozen=True)
class Agreement:
    valid: int
    """Our valid fixes."""
    both: int
    """Those of an instant at which gpsd has a position."""
    same: int
    """Those of them at the same place."""


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


def test_positions_and_times_agree_with_gpsd(logs: Path) -> None:
    told = {
        path.stem: compare(path)
        for path in sorted(logs.glob("*.log"))
        if path.stem not in NOT_NMEA and path.with_suffix(".log.chk").exists()
    }
    valid, both, same = (sum(getattr(one, key) for one in told.values()) for key in ("valid", "both", "same"))
    print(
        f"{len(told)} logs: {valid} valid fixes, gpsd has {both} of these instants, {same} at the same place"
    )
    apart = {name for name, one in told.items() if one.same < one.both}
    assert apart <= DIFFERENT.keys()
    assert {name: told[name] for name in WELL_BEHAVED} == {
        name: Agreement(count, count, count) for name, count in WELL_BEHAVED.items()
    }
    assert same >= 1170
    assert both >= 0.93 * valid  # gpsd waits for the first whole cycle, or takes GLL's time


def test_a_log_that_gpsd_dates_1024_weeks_later_agrees_but_for_that(logs: Path) -> None:
    told = compare(logs / "neo-m8n.log", shift_ns=WEEKS_1024_NS)
    assert told == Agreement(23, 22, 22)


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


def compare(path: Path, *, shift_ns: int = 0) -> Agreement:
    places = gpsd_places(path.with_suffix(".log.chk"))
    ours = {
        sample.stamp.gps_ns + shift_ns: sample
        for sample in replay(path)
        if isinstance(sample, Fix) and sample.valid and sample.stamp.gps_ns is not None
    }
    both = [fix for time_ns, fix in ours.items() if time_ns in places]
    same = [
        fix for time_ns, fix in ours.items() if any(near(fix, place) for place in places.get(time_ns, []))
    ]
    return Agreement(len(ours), len(both), len(same))


def near(fix: Fix, place: tuple[float, float]) -> bool:
    assert fix.latitude_deg is not None
    assert fix.longitude_deg is not None
    return (
        abs(fix.latitude_deg - place[0]) < TOLERANCE_DEG and abs(fix.longitude_deg - place[1]) < TOLERANCE_DEG
    )


def gpsd_places(path: Path) -> dict[int, list[tuple[float, float]]]:
    """By time, Unix-like: the positions of gpsd's reports that tell one."""
    places: dict[int, list[tuple[float, float]]] = {}
    for line in path.read_bytes().splitlines():
        report = json.loads(line) if line.startswith(b'{"class":"TPV"') else {}
        if "time" in report and "lat" in report:
            match = re.fullmatch(r"(.*)\.(\d+)Z", report["time"])
            assert match is not None
            seconds = int(datetime.fromisoformat(match[1] + "+00:00").timestamp())
            time_ns = seconds * SECOND_NS + int(match[2].ljust(9, "0"))
            places.setdefault(time_ns, []).append((report["lat"], report["lon"]))
    return places
