"""What is said to a SiRF receiver such as the BU-353: NMEA input sentences and binary messages.

After the SiRF NMEA reference manual and the SiRF binary protocol manual. All fields are required.
"""

from collections.abc import Mapping
from types import MappingProxyType

from recorder.drivers.nmea import checksum

MESSAGES = MappingProxyType({"GGA": 0, "GLL": 1, "GSA": 2, "GSV": 3, "RMC": 4, "VTG": 5, "MSS": 6, "ZDA": 8})
"""A sentence's number in ``$PSRF103``, and its place in the binary message 129."""
SERVING = ("ZDA", "GGA", "GSA", "RMC")
"""The sentences that serve us; fewer of the others, less to wait for (report 3.2.6.2)."""
_SWITCH_TO_NMEA = 129
_PLACES = 10
"""Sentences in message 129; two of the places are spare."""


def command(body: str) -> bytes:
    """``$body*hh`` with its line end."""
    return f"${body}*{checksum(body.encode('ascii')):02X}\r\n".encode("ascii")


def set_interval(kind: str, seconds: int) -> bytes:
    """``$PSRF103``: say a sentence every so many seconds, with a checksum; 0 is never."""
    return command(f"PSRF103,{MESSAGES[kind]:02d},00,{seconds:02d},01")


def set_serial(*, nmea: bool, baud: int) -> bytes:
    """``$PSRF100``: NMEA or SiRF binary at ``baud``, 8N1. The receiver starts its port anew."""
    return command(f"PSRF100,{int(nmea)},{baud},8,1,0")


def only_serving() -> bytes:
    """The commands that switch on what serves, every second, and everything else off."""
    return b"".join(set_interval(kind, int(kind in SERVING)) for kind in MESSAGES)


def switch_to_nmea(baud: int, seconds: Mapping[str, int]) -> bytes:
    """Binary message 129: from now on NMEA at ``baud`` (at most 65535), sentences at their intervals."""
    intervals = [0] * _PLACES
    for kind, interval in seconds.items():
        intervals[MESSAGES[kind]] = interval
    pairs = b"".join(bytes((interval, 1)) for interval in intervals)
    keep_debug = 2
    return frame(bytes((_SWITCH_TO_NMEA, keep_debug)) + pairs + baud.to_bytes(2, "big"))


def frame(payload: bytes) -> bytes:
    """``A0 A2``, length, payload, its sum in 15 bits, ``B0 B3``."""
    check = (sum(payload) & 0x7FFF).to_bytes(2, "big")
    return b"\xa0\xa2" + len(payload).to_bytes(2, "big") + payload + check + b"\xb0\xb3"
