"""A program on its way to the CNC: what may go next, the four line counts, and how long what has gone will still take."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

from drivers.cnc.events import LineCounts, Status

ALLOWED = bytes(code for code in range(ord(" "), ord("~")) if chr(code) not in "!?")
"""What may stand in a line: not control characters, `!`, `?`, `~` and everything beyond ASCII, which are real-time bytes to the firmware."""
WORDS = re.compile(r"([GMFP])(-?\d*\.?\d+)")
NUMBER = re.compile(r"N(\d+)")
NUMBERS = re.compile(r"^N(\d+)", re.MULTILINE)
BLOCK_LINES = 32  # read and checked at once: a fraction of a millisecond
TIMED_LINES = 4096  # more than any planner and receive buffer hold; older lines have been executed
IDLE_REPORTS = 5  # Idle so often in a row is standstill even if the planner never says that it is empty


@dataclass(frozen=True)
class Pauses:
    """How long lines without motion may take, as the cell file has it (s)."""

    tool_change_s: float = 0.0
    spindle_s: float = 0.0


class ProgramStream:
    """Lines from index `first` on; a Sequence is read where it is needed, an Iterable once: memory stays constant.

    times_s : predicted end of each line, s from the start of the program, same index as lines (optional).
    pauses : of lines without motion
    """

    def __init__(
        self, lines: Sequence[str] | Iterable[str], first: int, line_max: int, times_s: Sequence[float] | None = None,
        pauses: Pauses = Pauses(),
    ) -> None:  # fmt: skip
        self.total = len(lines) if isinstance(lines, Sequence) else None
        self.first = first
        self.released = first
        self.taken = first  # lines that have begun to go out
        self.sent = first
        self.executing = 0
        self.executed = first
        self.halted = ""  # why nothing more goes
        self._source = _from(lines, first)
        self._line_max = line_max
        self._times_s = times_s
        self._ahead: deque[str] = deque()  # read from the source, not taken yet
        self._plain_max = 0  # longest of the lines read, if none of them needs a look of its own
        self._held: deque[str] = deque()  # lines executed.. sent, as far back as TIMED_LINES
        self._pauses = pauses
        self._mode = InverseTime(pauses)  # before the first of those
        self._told: tuple[int, int, float] = (first, first, 0.0)  # executed, sent and the time by words between them
        self._idle_reports = 0

    @property
    def is_ended(self) -> bool:
        """Whether every line that exists has been sent."""
        return self.total is not None and self.sent >= self.total

    @property
    def is_sent(self) -> bool:
        """Whether every released line has been sent."""
        return self.is_ended or self.sent >= self.released

    def peek(self) -> str | None:
        """The next line if it is released; None otherwise. The same one until it is taken."""
        if self.taken >= self.released:
            return None
        if not self._ahead:
            self._read()
        return self._ahead[0] if self._ahead else None

    def take(self) -> None:
        """The line that `peek` showed begins to go out."""
        self._ahead.popleft()
        self.taken += 1

    def objection(self, line: str, window_bytes: int) -> str:
        """Why the next line cannot be sent ("" if it can). window_bytes: what may stand unanswered at the controller."""
        if 0 < self._plain_max < window_bytes:
            return ""
        if len(line) > self._line_max or len(line) >= window_bytes:
            return f"line has {len(line)} characters, the controller takes {min(self._line_max, window_bytes - 1)}"
        if not line.isascii() or line.encode().translate(None, ALLOWED):
            return "line holds a character that the controller would carry out at once or not understand"
        if line.startswith("$"):
            return "a $ command cannot be streamed"
        if line.startswith("N") and (match := NUMBER.match(line)) and int(match[1]) != self.taken + 1:
            return f"line {self.taken + 1} of the program carries N{match[1]}"
        return ""

    def went(self, line: str) -> None:
        """The line has left whole."""
        if self.taken == self.sent:
            self.take()
        self.sent += 1
        self._held.append(line)
        self._idle_reports = 0
        if len(self._held) > TIMED_LINES:
            self._drop()

    def follow(self, status: Status, unanswered: int, empty_planner: int | None) -> None:
        """Take executing and executed from a status report. empty_planner: free blocks that an idle planner shows.

        A machine that stands after a reset, an alarm or a refused line has not executed what it was sent: only `Ln:` counts then.
        """
        if status.line is not None and not status.is_idle and max(self.executing, self.executed, 1) <= status.line <= self.sent:
            self.executing = status.line
            self._done(status.line - 1)
        if not status.is_idle or unanswered or self.halted:
            self._idle_reports = 0
            return
        self._idle_reports += 1
        is_empty = status.planner_free is not None and empty_planner is not None and status.planner_free >= empty_planner
        if is_empty or self._idle_reports >= (2 if status.planner_free is None else IDLE_REPORTS):
            self._done(self.sent)
            self.executing = 0

    def counts(self, acknowledged: int) -> LineCounts:
        """The four counts."""
        return LineCounts(self.sent, max(acknowledged, self.first), self.executing, self.executed)

    def remaining_s(self) -> float:
        """Predicted time of what has been sent and not executed; moves without G93 or prediction count as none."""
        planned = 0.0
        if self._times_s is not None and self.sent > self.executed:
            before = self._times_s[self.executed - 1] if self.executed > 0 else 0.0
            planned = float(self._times_s[self.sent - 1]) - float(before)
        executed, sent, by_words = self._told
        if (executed, sent) != (self.executed, self.sent):
            mode = InverseTime(self._pauses, self._mode.is_on)
            by_words = sum(mode.seconds(line) for line in self._held)
            self._told = (self.executed, self.sent, by_words)
        return max(planned, by_words)

    def _done(self, upto: int) -> None:
        self.executed = max(self.executed, upto)
        while len(self._held) > self.sent - self.executed:
            self._drop()

    def _drop(self) -> None:
        line = self._held.popleft()
        if "G9" in line:
            self._mode.seconds(line)

    def _read(self) -> None:
        """Read the next block of lines and look at all of them at once; what is odd in it is looked at line by line later."""
        block = list(islice(self._source, BLOCK_LINES))
        if not block:
            self.total = self.taken
            return
        self._ahead.extend(block)
        text, first = "\n".join(block), self.taken
        longest = max(map(len, block))
        is_plain = longest <= self._line_max and text.isascii() and text.encode().translate(None, ALLOWED) == b"\n" * (len(block) - 1)
        numbers = [str(n) for n in range(first + 1, first + 1 + len(block))]
        self._plain_max = longest if is_plain and NUMBERS.findall(text) == numbers else 0


class InverseTime:
    """Time of lines by their words: G93 with F, dwell, tool change, spindle."""

    def __init__(self, pauses: Pauses, is_on: bool = False) -> None:
        self._pauses = pauses
        self.is_on = is_on  # G93 holds

    def seconds(self, line: str) -> float:
        """Of the next line, s."""
        feed = pause = 0.0
        seconds = 0.0
        is_dwell = False
        for letter, number in WORDS.findall(line):
            value = float(number)
            if letter == "F":
                feed = value
            elif letter == "P":
                pause = value
            elif letter == "G":
                self.is_on = value == 93 or (self.is_on and value != 94)
                is_dwell = is_dwell or value == 4
            elif value == 6:
                seconds += self._pauses.tool_change_s
            elif value in (3, 4, 5):
                seconds += self._pauses.spindle_s
        if is_dwell:
            return seconds + pause
        return seconds + (60.0 / feed if self.is_on and feed > 0 else 0.0)


def _from(lines: Sequence[str] | Iterable[str], first: int) -> Iterator[str]:
    if isinstance(lines, Sequence):
        return (lines[k] for k in range(first, len(lines)))
    return iter(lines)
