"""A timer that goes off once, to the microsecond: a timerfd, as an event loop's own timers are rounded up to milliseconds."""

from __future__ import annotations

import ctypes
import os

CLOCK_MONOTONIC = 1
TFD_NONBLOCK = 0o4000
TFD_CLOEXEC = 0o2000000
TFD_TIMER_ABSTIME = 1
NS = 1_000_000_000
LEAST_S = 1e-9  # zero would disarm it


class _Timespec(ctypes.Structure):
    _fields_ = (("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long))


class _Itimerspec(ctypes.Structure):
    _fields_ = (("it_interval", _Timespec), ("it_value", _Timespec))


class OneShot:
    """`fd` becomes readable at the monotonic time that is `set` and stays so until it is set anew.

    Raises OSError when there is none to be had.
    """

    def __init__(self) -> None:
        library = ctypes.CDLL(None, use_errno=True)
        self.fd = int(library.timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC))
        if self.fd < 0:
            raise OSError(ctypes.get_errno(), "timerfd_create")
        self._settime = ctypes.CDLL(None).timerfd_settime
        self._settime.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
        self._spec = _Itimerspec()
        self._value = self._spec.it_value
        self._address = ctypes.addressof(self._spec)

    def set(self, at: float) -> None:
        """Go off at `at` (s, CLOCK_MONOTONIC; now, if that is past) instead of whenever it would have."""
        self._value.tv_sec, self._value.tv_nsec = divmod(int(max(at, LEAST_S) * NS), NS)
        self._settime(self.fd, TFD_TIMER_ABSTIME, self._address, None)

    def close(self) -> None:
        """Give the descriptor back. Harmless twice."""
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1
