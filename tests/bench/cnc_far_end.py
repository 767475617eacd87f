"""A controller at the far end of a serial line, by its own clock: bytes arrive at the true baud rate, a full buffer loses them, answers come late.

It shares nothing with the drivers nor with the simulated cell: a line clock, a receive ring, a planner that empties, answers by pattern.
"""

from __future__ import annotations

import random
import re
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

REAL_TIME = re.compile(rb"[?!~\x18\x80-\xff]")
NUMBER = re.compile(rb"N(\d+)")
BANNER = b"\r\nGrbl 1.1h ['$' for help]\r\n"
OK = b"ok\r\n"
BLOCKS = 15
FIVE_AXES = b"0.000,0.000,0.000,0.000,0.000"


@dataclass(frozen=True)
class Answers:
    """How answers come: `delay_s` after the line was parsed, plus up to `jitter_s` at random, `bunch` at once or after bunch_s."""

    name: str
    delay_s: float = 0.0
    jitter_s: float = 0.0
    bunch: int = 1
    bunch_s: float = 0.004


@dataclass
class Counts:
    """What the far end saw: lines of the program whole and in order, and everything else.

    least_planned : fewest blocks in the planner when a line came, from the BLOCKS-th of a pass on; dry : lines of a pass that found none
    """

    lines: int = 0
    lost: int = 0
    doubled: int = 0
    changed: int = 0
    overflowed: int = 0
    bytes: int = 0
    first_at: float = 0.0
    last_at: float = 0.0
    least_planned: int = BLOCKS
    dry: int = 0
    urgent: list[tuple[int, float]] = field(default_factory=list)


class FarEnd:
    """rx : bytes of the ring. byte_s : s per byte on the line, 0 for none. expect : the program's line of an index, newline excluded.

    block_s : how long the machine moves on the line of an index, s   goes_on : whether that line goes on with the pass of the one before
    """

    def __init__(
        self, rx: int, byte_s: float, answers: Answers, expect: Callable[[int], bytes], block_s: Callable[[int], float],
        goes_on: Callable[[int], bool],
    ) -> None:  # fmt: skip
        self.counts = Counts()
        self._rx, self._byte_s, self._answers, self._expect, self._block_s = rx, byte_s, answers, expect, block_s
        self._goes_on = goes_on
        self._in_pass = 0  # lines of the pass so far
        self._coming: deque[tuple[float, bytes]] = deque()  # first byte's arrival, bytes
        self._line_free = 0.0
        self._ring = bytearray()
        self._planner: deque[float] = deque()  # when each block ends
        self._bunch: list[float] = []
        self._out: deque[tuple[float, bytes]] = deque()
        self._out_free = 0.0
        self._random = random.Random(1)

    def arrive(self, data: bytes, now: float) -> None:
        """Bytes were written at `now`: each takes its time on the line behind those before it."""
        start = max(now, self._line_free)
        if self._coming and self._byte_s == 0.0:
            self._coming.append((now, data))
        else:
            self._coming.append((start + self._byte_s, data))
        self._line_free = start + len(data) * self._byte_s

    def step(self, now: float) -> None:
        """Take what has arrived by now, parse, plan, answer."""
        while self._coming and self._coming[0][0] <= now:
            first_at, data = self._coming.popleft()
            count = len(data) if self._byte_s == 0.0 else min(len(data), int((now - first_at) / self._byte_s + 1e-6) + 1)
            if count < len(data):
                self._coming.appendleft((first_at + count * self._byte_s, data[count:]))
            self._take(data[:count], first_at)
            if count < len(data):
                break
        self._parse(now)
        if self._bunch and (len(self._bunch) >= self._answers.bunch or now - self._bunch[0] >= self._answers.bunch_s):
            delay = self._answers.delay_s + self._random.random() * self._answers.jitter_s
            self._say(OK * len(self._bunch), now + delay)
            self._bunch.clear()

    def next_at(self, now: float) -> float:
        """When lines will arrive or be parsed or answered here; infinity if nothing will."""
        times = []
        if self._coming:
            first_at, data = self._coming[0]
            end = data.find(b"\n")
            times.append(first_at + (end if end >= 0 else len(data) - 1) * self._byte_s)
        if self._bunch:
            times.append(self._bunch[0] + self._answers.bunch_s)
        if self._planner and b"\n" in self._ring:
            times.append(self._planner[0])
        return max(min(times, default=float("inf")), now)

    def answer_at(self) -> float:
        """When bytes of an answer reach the host next; infinity if none is on its way."""
        return self._out[0][0] if self._out else float("inf")

    def transmit(self, now: float) -> bytes:
        """Bytes that have reached the host by now."""
        out = b""
        while self._out and self._out[0][0] <= now:
            out += self._out.popleft()[1]
        return out

    def _take(self, data: bytes, first_at: float) -> None:
        place = 0
        for found in REAL_TIME.finditer(data):
            self._urgent(found[0][0], first_at + found.start() * self._byte_s)
            self._store(data[place : found.start()], first_at)
            place = found.end()
        self._store(data[place:], first_at)
        counts = self.counts
        counts.bytes += len(data)
        counts.first_at = counts.first_at or first_at - self._byte_s
        counts.last_at = first_at + (len(data) - 1) * self._byte_s

    def _store(self, data: bytes, at: float) -> None:
        room = self._rx - len(self._ring)
        self._ring += data[:room]
        self.counts.overflowed += max(0, len(data) - room)

    def _urgent(self, byte: int, at: float) -> None:
        if byte == 0x3F:
            free, state = BLOCKS - len(self._planner), b"Run" if self._planner else b"Idle"
            self._say(b"<%s|MPos:%s|Bf:%d,%d|FS:600,0>\r\n" % (state, FIVE_AXES, free, self._rx - 1 - len(self._ring)), at)
        elif byte == 0x18:
            self._ring.clear()
            self._planner.clear()
            self._say(BANNER, at)
        else:
            self.counts.urgent.append((byte, at))

    def _parse(self, now: float) -> None:
        planner = self._planner
        while True:
            while planner and planner[0] <= now:
                planner.popleft()
            if len(planner) >= BLOCKS or (end := self._ring.find(b"\n")) < 0:
                return
            line = bytes(self._ring[:end])
            del self._ring[: end + 1]
            if line == b"$I":
                self._say(b"[VER:1.1h.20190825:]\r\n[OPT:V,%d,%d]\r\n" % (BLOCKS, self._rx) + OK, now)
            elif line.startswith(b"N"):
                self._plan(line, now)
            else:
                self._say(OK, now)

    def _plan(self, line: bytes, now: float) -> None:
        counts, planner = self.counts, self._planner
        due = counts.lines + counts.lost + counts.changed
        if line == self._expect(due):
            counts.lines += 1
        else:
            self._classify(line, due)
        self._in_pass = self._in_pass + 1 if self._goes_on(due) else 0
        counts.dry += self._in_pass > 0 and not planner
        if self._in_pass > BLOCKS:
            counts.least_planned = min(counts.least_planned, len(planner))
        planner.append((planner[-1] if planner else now) + self._block_s(due))
        self._bunch.append(now)

    def _classify(self, line: bytes, due: int) -> None:
        number = NUMBER.match(line)
        n = int(number[1]) - 1 if number else -1
        if number and n > due and line == self._expect(n):
            self.counts.lost += n - due
            self.counts.lines += 1
        elif number and 0 <= n < due and line == self._expect(n):
            self.counts.doubled += 1
        else:
            self.counts.changed += 1

    def _say(self, data: bytes, at: float) -> None:
        self._out_free = max(at, self._out_free) + len(data) * self._byte_s
        self._out.append((self._out_free, data))
