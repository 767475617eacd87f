"""The beat of the safety tick: a timerfd on CLOCK_MONOTONIC in the event loop, missed beats counted, jitter measured."""

from __future__ import annotations

import asyncio
import ctypes
import os
import struct
import sys
from collections.abc import Callable

import numpy as np

CLOCK_MONOTONIC = 1
TFD_NONBLOCK = 0o4000
TFD_CLOEXEC = 0o2000000
FIFO_PRIORITY = 40  # above every ordinary process, below the kernel's own threads
HELPER_PRIORITY = 1  # of threads that the tick may have to wait for
WINDOW = 3000  # beats over which jitter is stated: 30 s at 100 Hz


class _Timespec(ctypes.Structure):
    _fields_ = (("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long))


class _Itimerspec(ctypes.Structure):
    _fields_ = (("it_interval", _Timespec), ("it_value", _Timespec))


def open_timer(period_s: float) -> int:
    """A file descriptor that becomes readable every period_s. Raises OSError."""
    if sys.version_info >= (3, 13):
        timer = os.timerfd_create(CLOCK_MONOTONIC, flags=os.TFD_NONBLOCK | os.TFD_CLOEXEC)
        os.timerfd_settime(timer, initial=period_s, interval=period_s)
        return timer
    libc = ctypes.CDLL(None, use_errno=True)
    fd = int(libc.timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC))
    if fd < 0:
        raise OSError(ctypes.get_errno(), "timerfd_create")
    seconds, rest = divmod(round(period_s * 1e9), 1_000_000_000)
    spec = _Itimerspec(_Timespec(seconds, rest), _Timespec(seconds, rest))
    if libc.timerfd_settime(fd, 0, ctypes.byref(spec), None) < 0:
        os.close(fd)
        raise OSError(ctypes.get_errno(), "timerfd_settime")
    return fd


def be_urgent(priority: int = FIFO_PRIORITY) -> str:
    """Ask for SCHED_FIFO for this thread alone, not for threads and processes that it starts; the name of the scheduler that holds."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError as error:
        return f"SCHED_OTHER (SCHED_FIFO refused: {error.strerror})"
    return f"SCHED_FIFO {priority}"


class Beat:
    """Counts beats, missed ones and the deviation of their spacing from the period."""

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self.count = 0
        self.missed = 0
        self.scheduler = ""
        self._spacing_s = np.full(WINDOW, period_s)  # of the last beats, a ring
        self._last_at: float | None = None

    def struck(self, at: float, expirations: int = 1) -> None:
        """A beat at monotonic time `at` (s); more than one expiration means that beats were missed."""
        self.missed += max(expirations - 1, 0)
        if self._last_at is not None:
            self._spacing_s[self.count % WINDOW] = at - self._last_at
        self.count += 1
        self._last_at = at

    @property
    def jitter_p99_ms(self) -> float:
        """99th percentile of |spacing - period| over the last beats (ms)."""
        known = self._spacing_s[: max(min(self.count, WINDOW), 1)]
        return float(np.percentile(np.abs(known - self.period_s), 99) * 1e3)

    @property
    def longest_ms(self) -> float:
        """Longest time between two of the last beats (ms)."""
        return float(self._spacing_s.max() * 1e3)


class Ticker:
    """Calls `tick` on every expiration of a timer, from the running event loop."""

    def __init__(self, beat: Beat, now: Callable[[], float], tick: Callable[[], None]) -> None:
        self.beat = beat
        self._now = now
        self._tick = tick
        self._fd = open_timer(beat.period_s)
        asyncio.get_running_loop().add_reader(self._fd, self._on_timer)

    def _on_timer(self) -> None:
        try:
            expirations = struct.unpack("Q", os.read(self._fd, 8))[0]
        except BlockingIOError:
            return
        self.beat.struck(self._now(), expirations)
        self._tick()

    def close(self) -> None:
        """Stop beating. Harmless twice."""
        if self._fd >= 0:
            asyncio.get_running_loop().remove_reader(self._fd)
            os.close(self._fd)
            self._fd = -1
