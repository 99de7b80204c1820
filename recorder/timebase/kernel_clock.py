"""Whether the kernel's wall clock is being kept by somebody (NTP, PTP, gpsd and chrony)."""

import ctypes

_STA_UNSYNC = 0x0040
_TIME_ERROR = 5


class _Timex(ctypes.Structure):
    """``struct timex`` of ``adjtimex(2)`` on 64-bit Linux; only what is read has a name."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("freq", ctypes.c_long),
        ("maxerror", ctypes.c_long),
        ("esterror", ctypes.c_long),
        ("status", ctypes.c_int),
        ("_rest", ctypes.c_byte * 256),
    )


def wall_clock_error_ns() -> int | None:
    """Largest error of CLOCK_REALTIME as the kernel states it, or None if nobody keeps it.

    Reads only: no mode bit is set, so no privilege is needed and nothing is changed.
    """
    timex = _Timex()
    state = ctypes.CDLL(None).adjtimex(ctypes.byref(timex))
    if state < 0 or state == _TIME_ERROR or timex.status & _STA_UNSYNC:
        return None
    return int(timex.maxerror) * 1000
