"""How much may be written now, so that a real-time byte is on the wire within 2 ms.

Written bytes cannot be overtaken: what stands in the operating system's queue is the delay of a hold.
"""

from __future__ import annotations

AHEAD_S = 0.0019  # a `!` waits at most this long behind what is already written; its own byte takes the rest of 2 ms
RESERVE_S = (0.00025, 0.001)  # least and most that still stands when more is written: what a late timer may use up
RESERVE_UP_S, RESERVE_DOWN_S = 50e-6, 0.5e-6  # per wake: they balance where one wake in a hundred is later than the reserve
BITS_PER_BYTE = 10  # start, 8 data, stop
LEAST_BYTES = 8  # at very low baud rates still more than one byte at a time


class Pacer:
    """Follows the line by time, as some drivers (pty, USB) say their queue is empty whatever stands in it."""

    def __init__(self, baud: int) -> None:
        self.bytes_per_s = baud / BITS_PER_BYTE
        self.ahead_bytes = max(LEAST_BYTES, int(self.bytes_per_s * AHEAD_S))
        self.reserve_s = sum(RESERVE_S) / 2
        self._standing = 0.0  # bytes not yet on the wire at time _at
        self._at = 0.0

    def room(self, now: float, queued: int) -> int:
        """Bytes that may be written now. queued: what the operating system says it holds."""
        self._advance(now)
        if queued > self._standing:
            self._standing = queued
        return int(self.ahead_bytes - self._standing)

    def wrote(self, count: int) -> None:
        """`count` bytes were written just now."""
        self._standing += count

    def dropped(self) -> None:
        """The output queue was discarded."""
        self._standing = 0.0

    def wait_s(self, now: float) -> float:
        """Seconds until it is worth writing again: the reserve stands by then, or half of what may stand."""
        self._advance(now)
        low = min(self.bytes_per_s * self.reserve_s, 0.5 * self.ahead_bytes)
        return max(0.0, (self._standing - low) / self.bytes_per_s)

    def woke(self, late_s: float) -> None:
        """A timer was late by late_s: the reserve is learnt from it, as large as this machine's timers need and no larger."""
        low, high = RESERVE_S
        if late_s > self.reserve_s:
            self.reserve_s = min(high, self.reserve_s + RESERVE_UP_S)
        else:
            self.reserve_s = max(low, self.reserve_s - RESERVE_DOWN_S)

    def _advance(self, now: float) -> None:
        self._standing = max(0.0, self._standing - (now - self._at) * self.bytes_per_s)
        self._at = now
