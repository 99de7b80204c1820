"""From the configuration to the drivers it names."""

import stat
from collections.abc import Sequence
from pathlib import Path

from recorder.clock import Clock
from recorder.config import CameraSection, GnssSection, Settings
from recorder.drivers.base import Driver
from recorder.drivers.file_camera import FileCamera
from recorder.drivers.genicam import GenicamCamera
from recorder.drivers.gnss import GnssReceiver
from recorder.drivers.gpsd import GpsdClient
from recorder.drivers.merged import Merged
from recorder.drivers.nmea_log import NmeaLog
from recorder.drivers.pps import PpsSource

GPSD = "gpsd://"


def build_drivers(settings: Settings, *, clock: Clock) -> Sequence[Driver]:
    """One driver a device. Files that are not paced are merged into one with a common origin, so
    that a fast replay interleaves them as they happened; paced ones start when they are asked."""
    origin_raw_ns = clock.raw_ns()
    paced: list[Driver] = []
    fast: list[Driver] = []
    for name, camera in settings.drivers.camera.items():
        driver = _camera(name, camera, None if camera.realtime else origin_raw_ns, clock)
        (paced if driver.live or camera.realtime else fast).append(driver)
    gnss = settings.drivers.gnss
    if gnss is not None:
        driver = _gnss(gnss, None if gnss.realtime else origin_raw_ns, clock)
        (paced if driver.live or gnss.realtime else fast).append(driver)
        if gnss.pps is not None:
            paced.append(PpsSource(gnss.pps, clock=clock))
    return [*paced, *([Merged(fast)] if len(fast) > 1 else fast)]


def _camera(name: str, settings: CameraSection, origin_raw_ns: int | None, clock: Clock) -> Driver:
    if settings.is_file:
        return FileCamera(name, settings, origin_raw_ns=origin_raw_ns, clock=clock)
    return GenicamCamera(name, settings, clock=clock)


def _gnss(settings: GnssSection, origin_raw_ns: int | None, clock: Clock) -> Driver:
    if settings.source.startswith(GPSD):
        return GpsdClient(settings, clock=clock)
    path = Path(settings.source.removeprefix("serial://"))
    if is_serial(settings.source):
        return GnssReceiver(settings.model_copy(update={"source": str(path)}), clock=clock)
    return NmeaLog(path, origin_raw_ns=origin_raw_ns, realtime=settings.realtime, clock=clock)


def is_receiver(source: str) -> bool:
    """A GNSS receiver rather than a file: on a serial line or behind gpsd."""
    return source.startswith(GPSD) or is_serial(source)


def is_serial(source: str) -> bool:
    """A serial device rather than a file: named so, a character device, or a name under /dev that is
    not there just now."""
    if source.startswith("serial://"):
        return True
    try:
        return stat.S_ISCHR(Path(source).stat().st_mode)
    except OSError:
        return source.startswith("/dev/")
