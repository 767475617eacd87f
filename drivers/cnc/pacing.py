"""How much may be written now, so that a real-time byte is on the wire within 2 ms.

Written bytes cannot be overtaken: what stands in the operating system's queue is the delay of a hold.
"""

from __future__ import annotations

import math
from collections import deque

AHEAD_S = 0.0019  # a `!` waits at most this long behind what is already written; its own byte takes the rest of 2 ms
RESERVE_S = (0.00025, 0.001)  # least and most that still stands when more is written: what a late timer may use up
RESERVE_UP_S, RESERVE_DOWN_S = 50e-6, 0.5e-6  # per wake: they balance where one wake in a hundred is later than the reserve
PACE = 0.997  # of the baud rate: what a line lags behind its model (clocks differ, adapters pause) is caught up with
BITS_PER_BYTE = 10  # start, 8 data, stop
LEAST_BYTES = 8  # at very low baud rates still more than one byte at a time
ANSWERS = 4  # status reports from which a lag is judged: the promptest of them
LAG_S = (0.0003, 0.005)  # least that is worth catching up with at once; most that is taken for a lag
SLOWEST = 0.95  # of the baud rate: no adapter's clock is farther off
SPEED_UP = 1e-4  # of the rate, per judgement without a lag: a rate that was learnt too low comes back
RATE_LAG_S = 0.001  # least lag that the rate is learnt from: answers on the way back delay a report by less
PACE_S = (1.0, 4.0)  # over which the pace of answered bytes is taken, least and most


class Pacer:
    """Follows the line by time, as some drivers (pty, USB) say their queue is empty whatever stands in it.

    What such a queue hides shows in the answers to status queries, which nothing but the line delays: when even the promptest of
    several comes later than it used to, bytes stand before the query that this model believes to be gone. Where waiting brings it back,
    the line is slower than its name and its rate is learnt; never below the pace of the bytes that were answered, as those have left.
    """

    def __init__(self, baud: int) -> None:
        self.bytes_per_s = self._most_per_s = PACE * baud / BITS_PER_BYTE
        self.ahead_bytes = max(LEAST_BYTES, int(self.bytes_per_s * AHEAD_S))
        self.reserve_s = sum(RESERVE_S) / 2
        self._standing: float = 0.0  # bytes not yet on the wire at time _at
        self._at = 0.0
        self.is_busy = False  # more than half of the line's time since the last but one query was used
        self._written = 0  # bytes since the last query
        self._counted_at = -math.inf
        self._asked_at: float | None = None  # when the query under way leaves, as far as is known
        self._answers_s: list[float] = []
        self._prompt_s = math.inf  # from a query's leaving to its answer, when nothing is hidden
        self._caught_up_s = 0.0  # lag that has just been waited for
        self._before_s = 0.0  # the last answer before that
        self._share = 0.0  # of the rate that was too much if waiting helps
        self._judged_at: float | None = None
        self._answered: deque[tuple[float, int]] = deque()  # when how many bytes had been answered in all

    def room(self, now: float) -> int:
        """Bytes that may be written now."""
        standing = self._standing - (now - self._at) * self.bytes_per_s
        self._standing = standing if standing > 0.0 else 0.0
        self._at = now
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
        self._written += count

    def dropped(self) -> None:
        """The output queue was discarded."""
        self._standing = 0.0

    def due_at(self) -> float:
        """When it is worth writing again: the reserve stands by then, or half of what may stand."""
        low, half = self.bytes_per_s * self.reserve_s, 0.5 * self.ahead_bytes
        return self._at + (self._standing - (low if low < half else half)) / self.bytes_per_s

    def woke(self, late_s: float) -> None:
        """A timer was late by late_s: the reserve is learnt from it, as large as this machine's timers need and no larger."""
        low, high = RESERVE_S
        reserve_s = self.reserve_s + (RESERVE_UP_S if late_s > self.reserve_s else -RESERVE_DOWN_S)
        self.reserve_s = low if reserve_s < low else high if reserve_s > high else reserve_s

    def asked(self, now: float) -> None:
        """A status query goes now, behind what stands."""
        self._advance(now)
        self.is_busy = self._written > 0.5 * self.bytes_per_s * (now - self._counted_at)
        self._written, self._counted_at = 0, now
        self._asked_at = now + self._standing / self.bytes_per_s

    def heard(self, at: float, answered: int = 0) -> None:
        """The first byte of its answer came.  answered : bytes of all lines that were answered so far"""
        if self._asked_at is None:
            return
        answer_s = at - self._asked_at
        self._asked_at = None
        pace = self._answered_per_s(at, answered)
        if self._caught_up_s and self._before_s - answer_s < 0.5 * self._caught_up_s:
            self._prompt_s += self._caught_up_s  # waiting did not help: it is the controller's own way to be late
        elif self._caught_up_s and pace:
            self.bytes_per_s = max(self.bytes_per_s * (1.0 - self._share), SLOWEST * self._most_per_s)
        self._caught_up_s = 0.0
        self.bytes_per_s = min(max(self.bytes_per_s, pace), self._most_per_s)
        self._answers_s.append(answer_s)
        if len(self._answers_s) >= ANSWERS:
            self._judge(min(self._answers_s), answer_s, at)
            self._answers_s.clear()

    def _judge(self, promptest: float, answer_s: float, at: float) -> None:
        """Whether the line lags behind its model, from the promptest of some answers and the last of them (s)."""
        before, self._judged_at = self._judged_at, at
        least, most = LAG_S
        lag_s = promptest - self._prompt_s
        if lag_s < least:
            self._prompt_s = min(self._prompt_s, promptest)
            self.bytes_per_s = min(self.bytes_per_s * (1.0 + SPEED_UP), self._most_per_s)
            return
        is_rate = before is not None and at > before and lag_s > RATE_LAG_S
        self._share = min(lag_s / (at - before), 1.0 - SLOWEST) if is_rate and before is not None else 0.0
        self._caught_up_s, self._before_s = min(lag_s, most), answer_s
        self._standing += self._caught_up_s * self.bytes_per_s

    def _answered_per_s(self, at: float, answered: int) -> float:
        """Pace of answered bytes over the last seconds, 0 if too few are known."""
        known, (least, most) = self._answered, PACE_S
        if known and (answered < known[-1][1] or at < known[-1][0]):
            known.clear()
        known.append((at, answered))
        while at - known[0][0] > most:
            known.popleft()
        span = at - known[0][0]
        return (answered - known[0][1]) / span if span >= least else 0.0

    def _advance(self, now: float) -> None:
        self._standing = max(0.0, self._standing - (now - self._at) * self.bytes_per_s)
        self._at = now
