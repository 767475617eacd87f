"""A timer that goes off once, to the microsecond: a timerfd, as an event loop's own timers are rounded up to milliseconds."""

from __future__ import annotations

import ctypes
import os
import sys

CLOCK_MONOTONIC = 1
TFD_NONBLOCK = 0o4000
TFD_CLOEXEC = 0o2000000
LEAST_S = 1e-6  # zero would disarm it


class _Timespec(ctypes.Structure):
    _fields_ = (("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long))


class _Itimerspec(ctypes.Structure):
    _fields_ = (("it_interval", _Timespec), ("it_value", _Timespec))


class OneShot:
    """`fd` becomes readable `seconds` after `set` and stays so until it is set anew. Raises OSError when there is none to be had."""

    def __init__(self) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._spec = _Itimerspec()
        self._pointer = ctypes.byref(self._spec)
        if sys.version_info >= (3, 13):
            self.fd = os.timerfd_create(CLOCK_MONOTONIC, flags=os.TFD_NONBLOCK | os.TFD_CLOEXEC)
            return
        self.fd = int(self._libc.timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC))
        if self.fd < 0:
            raise OSError(ctypes.get_errno(), "timerfd_create")

    def set(self, seconds: float) -> None:
        """Go off after `seconds` from now, instead of whenever it would have."""
        seconds = max(seconds, LEAST_S)
        whole = int(seconds)
        self._spec.it_value.tv_sec = whole
        self._spec.it_value.tv_nsec = int((seconds - whole) * 1e9)
        self._libc.timerfd_settime(self.fd, 0, self._pointer, None)

    def close(self) -> None:
        """Give the descriptor back. Harmless twice."""
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1
