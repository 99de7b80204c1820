"""Noticing that the wall clock is set, in the moment that it is."""

import ctypes
import errno
import os
import select
import threading
import time
from contextlib import suppress
from typing import Protocol

_TFD_NONBLOCK_CLOEXEC = os.O_NONBLOCK | os.O_CLOEXEC
_TFD_TIMER_ABSTIME, _TFD_TIMER_CANCEL_ON_SET = 1, 2
_NEVER_S = 2**40
"""Of the wall clock, in 36 000 years."""


class _Itimerspec(ctypes.Structure):
    """``struct itimerspec`` on 64-bit Linux."""

    _fields_ = (
        ("interval_s", ctypes.c_int64),
        ("interval_ns", ctypes.c_int64),
        ("value_s", ctypes.c_int64),
        ("value_ns", ctypes.c_int64),
    )


class ClockWatch(Protocol):
    """Waits, and says whether the wall clock was set meanwhile."""

    def wait(self, timeout_s: float) -> bool:
        """True as soon as the wall clock has been set, False after ``timeout_s`` or `wake`."""

    def wake(self) -> None:
        """End a `wait` that is going on, and every later one at once; from any thread."""

    def close(self) -> None:
        """Let go of everything; nobody may be waiting."""


class WallClockWatch:
    """A timer of the kernel on the wall clock that never expires and is cancelled when that clock is
    set (``TFD_TIMER_CANCEL_ON_SET`` of ``timerfd_create(2)``; also a leap second and a resume cancel it).

    Raises OSError where the kernel has no such timer.
    """

    def __init__(self) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._timer = self._libc.timerfd_create(time.CLOCK_REALTIME, _TFD_NONBLOCK_CLOEXEC)
        if self._timer < 0:
            raise OSError(ctypes.get_errno(), "no timer on the wall clock")
        self._wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._poll = select.poll()
        self._poll.register(self._timer, select.POLLIN)
        self._poll.register(self._wake, select.POLLIN)
        try:
            self._arm()
        except OSError:
            self.close()
            raise

    def wait(self, timeout_s: float) -> bool:
        ready = self._poll.poll(max(0.0, timeout_s) * 1000)
        if not any(fd == self._timer for fd, _ in ready):
            return False
        try:
            os.read(self._timer, 8)
        except OSError as error:
            if error.errno != errno.ECANCELED:
                raise
        self._arm()
        return True

    def wake(self) -> None:
        os.eventfd_write(self._wake, 1)

    def close(self) -> None:
        for fd in (self._timer, self._wake):
            with suppress(OSError):
                os.close(fd)

    def _arm(self) -> None:
        when = _Itimerspec(value_s=_NEVER_S)
        flags = _TFD_TIMER_ABSTIME | _TFD_TIMER_CANCEL_ON_SET
        if self._libc.timerfd_settime(self._timer, flags, ctypes.byref(when), None) < 0:
            code = ctypes.get_errno()
            if code != errno.ECANCELED:  # set since it was armed last: armed again all the same
                raise OSError(code, "the timer on the wall clock cannot be armed")


class NoWatch:
    """Only waits: for a system without such a timer, where the next pair tells of a step."""

    def __init__(self) -> None:
        self._woken = threading.Event()

    def wait(self, timeout_s: float) -> bool:
        self._woken.wait(max(0.0, timeout_s))
        return False

    def wake(self) -> None:
        self._woken.set()

    def close(self) -> None:
        pass


def clock_watch() -> ClockWatch:
    """The kernel's, or none where it has none."""
    try:
        return WallClockWatch()
    except (OSError, AttributeError):
        return NoWatch()
