"""How much may be written now, so that a real-time byte is on the wire within 2 ms.

Written bytes cannot be overtaken: what stands in the operating system's queue is the delay of a hold.
"""

from __future__ import annotations

import math

AHEAD_S = 0.0019  # a `!` waits at most this long behind what is already written; its own byte takes the rest of 2 ms
RESERVE_S = (0.00025, 0.001)  # least and most that still stands when more is written: what a late timer may use up
RESERVE_UP_S, RESERVE_DOWN_S = 50e-6, 0.5e-6  # per wake: they balance where one wake in a hundred is later than the reserve
PACE = 0.997  # of the baud rate: what a line lags behind its model (clocks differ, adapters pause) is caught up with
BITS_PER_BYTE = 10  # start, 8 data, stop
LEAST_BYTES = 8  # at very low baud rates still more than one byte at a time
ANSWERS = 4  # status reports from which a lag is judged: the promptest of them
LAG_S = (0.0003, 0.005)  # least that is worth catching up with at once; most that is taken for a lag


class Pacer:
    """Follows the line by time, as some drivers (pty, USB) say their queue is empty whatever stands in it.

    What such a queue hides shows in the answers to status queries, which nothing but the line delays: when even the promptest of
    several comes later than it used to, bytes stand before the query that this model believes to be gone.
    """

    def __init__(self, baud: int) -> None:
        self.bytes_per_s = PACE * baud / BITS_PER_BYTE
        self.ahead_bytes = max(LEAST_BYTES, int(self.bytes_per_s * AHEAD_S))
        self.reserve_s = sum(RESERVE_S) / 2
        self._standing: float = 0.0  # bytes not yet on the wire at time _at
        self._at = 0.0
        self._asked_at: float | None = None  # when the query under way leaves, as far as is known
        self._answers_s: list[float] = []
        self._prompt_s = math.inf  # from a query's leaving to its answer, when nothing is hidden
        self._caught_up_s = 0.0  # lag that has just been waited for
        self._before_s = 0.0  # the last answer before that

    def room(self, now: float) -> int:
        """Bytes that may be written now."""
        self._advance(now)
        return int(self.ahead_bytes - self._standing)

    def stands(self, count: int) -> None:
        """The operating system says that it holds `count` bytes."""
        self._standing = max(self._standing, count)

    def refused(self) -> None:
        """The operating system took nothing: its queue is full."""
        self._standing = self.ahead_bytes

    def wrote(self, count: int) -> None:
        """`count` bytes were written just now."""
        self._standing += count

    def dropped(self) -> None:
        """The output queue was discarded."""
        self._standing = 0.0

    def due_at(self) -> float:
        """When it is worth writing again: the reserve stands by then, or half of what may stand."""
        low = min(self.bytes_per_s * self.reserve_s, 0.5 * self.ahead_bytes)
        return self._at + (self._standing - low) / self.bytes_per_s

    def woke(self, late_s: float) -> None:
        """A timer was late by late_s: the reserve is learnt from it, as large as this machine's timers need and no larger."""
        low, high = RESERVE_S
        if late_s > self.reserve_s:
            self.reserve_s = min(high, self.reserve_s + RESERVE_UP_S)
        else:
            self.reserve_s = max(low, self.reserve_s - RESERVE_DOWN_S)

    def asked(self, now: float) -> None:
        """A status query goes now, behind what stands."""
        self._advance(now)
        self._asked_at = now + self._standing / self.bytes_per_s

    def heard(self, at: float) -> None:
        """The first byte of its answer came."""
        if self._asked_at is None:
            return
        answer_s = at - self._asked_at
        self._asked_at = None
        if self._caught_up_s and self._before_s - answer_s < 0.5 * self._caught_up_s:
            self._prompt_s += self._caught_up_s  # waiting did not help: it is the controller's own way to be late
        self._caught_up_s = 0.0
        self._answers_s.append(answer_s)
        if len(self._answers_s) < ANSWERS:
            return
        promptest = min(self._answers_s)
        self._answers_s.clear()
        least, most = LAG_S
        lag_s = promptest - self._prompt_s
        if lag_s < least:
            self._prompt_s = min(self._prompt_s, promptest)
            return
        self._caught_up_s, self._before_s = min(lag_s, most), answer_s
        self._standing += self._caught_up_s * self.bytes_per_s

    def _advance(self, now: float) -> None:
        self._standing = max(0.0, self._standing - (now - self._at) * self.bytes_per_s)
        self._at = now
