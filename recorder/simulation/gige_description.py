"""The GenICam description of the GigE Vision twin: Aravis' own, edited when the twin starts.

Aravis brings along a description of its fake camera, which is not ours to ship. Its memory is
64 KiB that any client may read and write, so a feature is no more than an entry in the description.
"""

import re
import struct
from collections.abc import Iterator
from typing import Any

from recorder.errors import DeviceError
from recorder.simulation.gige_pixels import PIXEL_FORMAT_CODES

_SPARE = 0x1000
"""Registers from here on are unused by Aravis."""

_FLOATS = {
    "ExposureTime": (5000.0, 9.0, 16656.0, "us"),
    "Gain": (1.0, 1.0, 4.0, ""),
    "BlackLevel": (8.0, 0.0, 255.0, "DN"),
    "DeviceTemperature": (41.5, -40.0, 120.0, "C"),
}
"""Start value, least, largest, unit. The ranges are those of a 60 Hz windscreen camera."""


def describe(aravis: Any, formats: list[str]) -> str:
    """The GenICam description that Aravis brings along, edited. It is not ours to ship."""
    xml = str(aravis.FakeCamera.new("description").get_genicam_xml()[0])
    entries = "".join(_entry(name, PIXEL_FORMAT_CODES[name]) for name in formats)
    floats = "".join(_float(name, _SPARE + 8 * index) for index, name in enumerate(_FLOATS))
    modes = "".join(
        _enumeration(name, 0x1100 + 4 * index, entry)
        for index, (name, entry) in enumerate(
            {"ExposureAuto": ("Off", "Once", "Continuous"), "ExposureMode": ("Timed",)}.items()
        )
    )
    extra = "ExposureTime", "ExposureAuto", "ExposureMode", "AcquisitionFrameRate"
    for old, new in (
        (r'(<Enumeration Name="PixelFormat".*?)<EnumEntry.*?(<pValue>)', rf"\1{entries}\2"),
        (r"<pFeature>ExposureTimeAbs</pFeature>", "".join(f"<pFeature>{name}</pFeature>" for name in extra)),
        (r"<pFeature>GainRaw</pFeature>", "<pFeature>Gain</pFeature><pFeature>BlackLevel</pFeature>"),
        (
            r'<Float Name="AcquisitionFrameRate">',
            '<Float Name="AcquisitionFrameRate" NameSpace="Standard"><Min>0.1</Min><Max>200</Max>',
        ),
        (r"</RegisterDescription>\s*$", f"{floats}{modes}\n</RegisterDescription>\n"),
    ):
        xml, changed = re.subn(old, new, xml, count=1, flags=re.DOTALL)
        if not changed:
            raise DeviceError(f"this Aravis describes its camera otherwise: no {old}")
    return xml


def _entry(name: str, value: int) -> str:
    return f'<EnumEntry Name="{name}" NameSpace="Standard"><Value>{value}</Value></EnumEntry>'


def _float(name: str, address: int) -> str:
    _, least, largest, unit = _FLOATS[name]
    return f"""
<Float Name="{name}" NameSpace="Standard"><pValue>{name}Register</pValue>
<Min>{least}</Min><Max>{largest}</Max><Unit>{unit}</Unit></Float>
<FloatReg Name="{name}Register" NameSpace="Custom"><Address>{address:#x}</Address><Length>8</Length>
<AccessMode>RW</AccessMode><pPort>Device</pPort><Endianess>BigEndian</Endianess></FloatReg>"""


def _enumeration(name: str, address: int, entries: tuple[str, ...]) -> str:
    choices = "".join(_entry(entry, value) for value, entry in enumerate(entries))
    return f"""
<Enumeration Name="{name}" NameSpace="Standard">{choices}<pValue>{name}Register</pValue></Enumeration>
<IntReg Name="{name}Register" NameSpace="Custom"><Address>{address:#x}</Address><Length>4</Length>
<AccessMode>RW</AccessMode><pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>"""


def start_values() -> Iterator[tuple[int, int]]:
    """Register and value of the features that `describe` adds and that do not start at 0."""
    for index, (start, *_) in enumerate(_FLOATS.values()):
        for half, value in enumerate(struct.unpack(">II", struct.pack(">d", start))):
            yield _SPARE + 8 * index + 4 * half, value
