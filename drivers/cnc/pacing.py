"""How much may be written now, so that a real-time byte is on the wire within 2 ms.

Written bytes cannot be overtaken: what stands in the operating system's queue is the delay of a hold.
"""

from __future__ import annotations

AHEAD_S = 0.002  # a `!` waits at most this long behind what is already written
REFILL = 0.5  # part of that which still stands when more is written: timers of the event loop are rounded up to 1 ms
BITS_PER_BYTE = 10  # start, 8 data, stop
LEAST_BYTES = 8  # at very low baud rates still more than one byte at a time


class Pacer:
    """Follows the line by time, as some drivers (pty, USB) say their queue is empty whatever stands in it."""

    def __init__(self, baud: int) -> None:
        self.bytes_per_s = baud / BITS_PER_BYTE
        self.ahead_bytes = max(LEAST_BYTES, int(self.bytes_per_s * AHEAD_S))
        self._standing = 0.0  # bytes not yet on the wire at time _at
        self._at = 0.0

    def room(self, now: float, queued: int) -> int:
        """Bytes that may be written now. queued: what the operating system says it holds."""
        self._advance(now)
        self._standing = max(self._standing, queued)
        return int(self.ahead_bytes - self._standing)

    def wrote(self, count: int) -> None:
        """`count` bytes were written just now."""
        self._standing += count

    def dropped(self) -> None:
        """The output queue was discarded."""
        self._standing = 0.0

    def wait_s(self, now: float) -> float:
        """Seconds until it is worth writing again."""
        self._advance(now)
        return max(0.0, (self._standing - self.ahead_bytes * REFILL) / self.bytes_per_s)

    def _advance(self, now: float) -> None:
        self._standing = max(0.0, self._standing - (now - self._at) * self.bytes_per_s)
        self._at = now
