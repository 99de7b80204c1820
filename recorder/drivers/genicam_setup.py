"""The settings of a GenICam camera: what is asked for is checked against what it offers, then set."""

from typing import Any

from recorder.config import CameraSection
from recorder.drivers.aravis import aravis, translated
from recorder.drivers.pixel_formats import BY_NAME, PREFERENCE
from recorder.errors import DeviceUnsuitable
from recorder.samples import CameraSettings


def configure(camera: Any, wanted: CameraSection, where: str) -> CameraSettings:
    """Set the camera up for free running and return the settings in force.

    What is absent from ``wanted`` stays as the camera has it, except the pixel format and the
    size, which become the best and the largest. The black level is not touched.

    Raises:
        DeviceUnsuitable: a value is out of the camera's range, or it has no such setting.
        DeviceLost, DeviceBusy, DeviceError: it fails meanwhile.
    """
    with translated(where):
        # Aravis writes what is out of range unless told otherwise; ours is checked before, this is the net.
        camera.set_range_check_policy(aravis().RangeCheckPolicy.ENABLE)
        setup = _Setup(camera, where)
        pixel_format = setup.pixel_format(wanted.pixel_format)
        setup.size(wanted.width, wanted.height)
        setup.free_running()
        setup.timing(wanted.rate_hz, wanted.exposure_us)
        if wanted.gain is not None:
            setup.gain(wanted.gain)
        if camera.is_gv_device():
            setup.packet_size(wanted.packet_bytes)
        return _in_force(camera, pixel_format)


def identity(camera: Any, where: str) -> dict[str, str]:
    """Vendor, model, serial number and firmware, as far as the camera tells."""
    with translated(where):
        told = {
            "vendor": camera.get_vendor_name(),
            "model": camera.get_model_name(),
            "serial": camera.get_device_serial_number(),
        }
        for name in ("DeviceFirmwareVersion", "DeviceVersion"):
            if camera.is_feature_available(name):
                told["firmware"] = camera.get_string(name)
                break
    return {key: str(value) for key, value in told.items() if value}


class _Setup:
    """The order of operations, one setting a method."""

    def __init__(self, camera: Any, where: str) -> None:
        self._camera, self._where = camera, where

    def pixel_format(self, wanted: str) -> str:
        offered = list(self._camera.dup_available_pixel_formats_as_strings())
        names = [one.name for one in PREFERENCE] if wanted == "auto" else [wanted]
        chosen = next((name for name in names if name in offered), None)
        if chosen is None:
            others = [name for name in offered if name in BY_NAME]
            raise self._unsuitable(
                f"offers {', '.join(offered) or 'no pixel format'}, not {' or '.join(names)}",
                f"set pixel_format to {' or '.join(others)}" if others else "use another camera",
            )
        self._camera.set_pixel_format_from_string(chosen)
        return chosen

    def size(self, width: int | None, height: int | None) -> None:
        camera = self._camera
        if camera.is_region_offset_available():  # an offset left over would narrow the range
            for name in ("OffsetX", "OffsetY"):
                camera.set_integer(name, camera.get_integer_bounds(name)[0])
        size = []
        for name, value in (("Width", width), ("Height", height)):
            least, largest = camera.get_integer_bounds(name)
            step = max(1, camera.get_integer_increment(name))
            if value is not None:
                self._within(name.lower(), value, (least, largest), "pixels")
                if (value - least) % step:
                    raise self._unsuitable(
                        f"{name.lower()} {value} is not {least} plus a multiple of {step} pixels"
                    )
            size.append(largest if value is None else value)
        camera.set_region(-1, -1, *size)

    def free_running(self) -> None:
        if self._camera.is_feature_available("TriggerMode"):
            self._camera.clear_triggers()
        self._camera.set_acquisition_mode(aravis().AcquisitionMode.CONTINUOUS)

    def timing(self, rate_hz: float | None, exposure_us: float | None) -> None:
        # Either may limit the other: the rate must make way for an exposure that does not fit yet.
        try:
            self._exposure(exposure_us)
        except DeviceUnsuitable:
            self._rate(rate_hz)
            self._exposure(exposure_us)
        else:
            self._rate(rate_hz)

    def gain(self, gain: float) -> None:
        if not self._camera.is_gain_available():
            raise self._unsuitable("has no gain to set")
        if self._camera.is_gain_auto_available():
            self._camera.set_gain_auto(aravis().Auto.OFF)
        self._within("gain", gain, self._camera.get_gain_bounds())
        self._camera.set_gain(gain)

    def packet_size(self, packet_bytes: int | None) -> None:
        if packet_bytes is None:
            self._camera.gv_auto_packet_size()
            return
        fixed = aravis().GvPacketSizeAdjustment.NEVER
        self._camera.gv_set_packet_size_adjustment(fixed)
        self._camera.gv_set_packet_size(packet_bytes)

    def _rate(self, rate_hz: float | None) -> None:
        if rate_hz is None:
            return
        if not self._camera.is_frame_rate_available():
            raise self._unsuitable("has no frame rate to set")
        self._within("rate", rate_hz, self._camera.get_frame_rate_bounds(), "Hz")
        self._camera.set_frame_rate(rate_hz)

    def _exposure(self, exposure_us: float | None) -> None:
        if exposure_us is None:
            return
        if not self._camera.is_exposure_time_available():
            raise self._unsuitable("has no exposure time to set")
        if self._camera.is_exposure_auto_available():
            self._camera.set_exposure_time_auto(aravis().Auto.OFF)
        self._within("exposure", exposure_us, self._camera.get_exposure_time_bounds(), "us")
        self._camera.set_exposure_time(exposure_us)

    def _within(self, what: str, value: float, bounds: tuple[float, float], unit: str = "") -> None:
        least, largest = bounds
        if not least <= value <= largest:
            told = f"{what} {value:.10g} is out of the camera's range, {least:.10g} to {largest:.10g} {unit}"
            raise self._unsuitable(told.rstrip())

    def _unsuitable(self, what: str, todo: str = "correct the configuration") -> DeviceUnsuitable:
        return DeviceUnsuitable(what, where=self._where, todo=todo)


def _in_force(camera: Any, pixel_format: str) -> CameraSettings:
    """As read back. A value that the camera itself keeps changing is None: no frame's is known."""
    off = aravis().Auto.OFF
    fixed_exposure = not camera.is_exposure_auto_available() or camera.get_exposure_time_auto() == off
    fixed_gain = not camera.is_gain_auto_available() or camera.get_gain_auto() == off
    return CameraSettings(
        pixel_format=pixel_format,
        exposure_us=camera.get_exposure_time()
        if fixed_exposure and camera.is_exposure_time_available()
        else None,
        gain=camera.get_gain() if fixed_gain and camera.is_gain_available() else None,
        black_level=camera.get_black_level() if camera.is_black_level_available() else None,
        rate_hz=camera.get_frame_rate() if camera.is_frame_rate_available() else None,
    )
