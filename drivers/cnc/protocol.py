"""The grbl line protocol without a wire: bytes in, events out; who is owed an answer, and how much may still be sent.

An answer (`ok`, `error:n`) belongs to the oldest unanswered line; nothing else frees one. Real-time bytes never count.
Sources: grbl 1.1 documentation ("Interface", character counting), grblHAL core (error latch).
"""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass, field

from drivers.cnc.codes import explain_alarm, explain_error
from drivers.cnc.events import (
    AlarmRaised,
    CncEvent,
    LineAccepted,
    LineRejected,
    Message,
    ProtocolFault,
    StatusReport,
    Welcome,
)
from drivers.cnc.status import MalformedReport, StatusReader

STATUS, HOLD, RESUME, RESET = b"?", b"!", b"~", b"\x18"
JOG_CANCEL, FULL_STATUS = b"\x85", b"\x87"  # FULL_STATUS: grblHAL only, other firmwares start a macro on it
FEED_100, FEED_UP_10, FEED_DOWN_10, FEED_UP_1, FEED_DOWN_1 = b"\x90", b"\x91", b"\x92", b"\x93", b"\x94"

LINE_BYTES_MAX = 4096  # no firmware sends a longer line; what is longer is noise
GARBLED_KEPT = 60  # characters of damaged text kept for the operator
BANNER = re.compile(r"(?i)^grbl(hal)? ?\d|^grblhal")
CODE = re.compile(r"^(error|ALARM):(\d{1,3})$")


@dataclass(slots=True)
class Answer:
    """What a command outside the stream brings: feedback lines, then done; code 0 is `ok`, otherwise the error number."""

    lines: list[str] = field(default_factory=list)
    done: bool = False
    code: int = 0
    is_lost: bool = False


@dataclass(slots=True)
class Sent:
    """A line that waits for its answer. n is the N-word, 0 for a command."""

    n: int
    text: str
    size: int
    answer: Answer | None


class GrblProtocol:
    """State of the line protocol. `window_bytes` is what may stand unanswered, newlines included."""

    def __init__(self, letters: tuple[str, ...], window_bytes: int = 0) -> None:
        self.window_bytes = window_bytes
        self.reader = StatusReader(letters)
        self.unanswered_bytes = 0
        self.acknowledged = 0  # N-word up to which every line was accepted
        self.is_latched = False  # a line of the stream was refused: nothing more may be sent before `clear`
        self.reset_expected = False
        self.banner = ""
        self.garbled = ""
        self._partial = b""
        self._sent: deque[Sent] = deque()
        self._whole = 0  # how many of _sent have left with their newline

    @property
    def unanswered(self) -> int:
        """Number of lines that wait for their answer."""
        return len(self._sent)

    @property
    def oldest(self) -> Sent | None:
        """The line that the next answer belongs to."""
        return self._sent[0] if self._sent else None

    def has_room(self, size: int) -> bool:
        """Whether a line of `size` bytes, newline included, fits the controller's buffer now."""
        return self.unanswered_bytes + size <= self.window_bytes

    def begin(self, n: int, text: str, size: int, answer: Answer | None = None) -> None:
        """A line starts to go out. n: its N-word, 0 for a command with its `answer`."""
        self._sent.append(Sent(n, text, size, answer))
        self.unanswered_bytes += size

    def finish(self) -> None:
        """The newline of the line that began last has gone out."""
        self._whole += 1

    def clear(self) -> int:
        """Forget lines in flight and the latch (the controller was reset); how many were forgotten."""
        forgotten = len(self._sent)
        for sent in self._sent:
            if sent.answer is not None:
                sent.answer.is_lost = True
        self._sent.clear()
        self._whole = 0
        self.unanswered_bytes = 0
        self.is_latched = False
        self.garbled = ""
        return forgotten

    def receive(self, data: bytes, now: float) -> list[CncEvent]:
        """Take bytes as they come, any number at a time; the events of all lines that are complete."""
        events: list[CncEvent] = []
        lines = (self._partial + data).split(b"\n")
        self._partial = lines.pop()
        if len(self._partial) > LINE_BYTES_MAX:
            lines.append(self._partial)
            self._partial = b""
        for line in lines:
            line = line.rstrip(b"\r")
            if line == b"ok":
                self._accept(events)
            elif line:
                self._other(line.decode("ascii", "replace"), now, events)
        return events

    def _accept(self, events: list[CncEvent]) -> None:
        sent = self._answered(events, "ok")
        if sent is None:
            return
        if sent.answer is not None:
            sent.answer.done = True
        elif not self.is_latched:
            self.acknowledged = sent.n
            events.append(LineAccepted(sent.n))

    def _refuse(self, code: int, events: list[CncEvent]) -> None:
        sent = self._answered(events, f"error:{code}")
        if sent is None:
            return
        if sent.answer is not None:
            sent.answer.code = code
            sent.answer.done = True
        elif not self.is_latched:
            self.is_latched = True
            cause, remedy = explain_error(code)
            events.append(LineRejected(sent.n, code, cause, sent.text, remedy))

    def _answered(self, events: list[CncEvent], what: str) -> Sent | None:
        if self._whole == 0:
            events.append(ProtocolFault(f"the CNC answered {what!r} to nothing (an answer was doubled, or another program is on the line)"))
            return None
        self._whole -= 1
        sent = self._sent.popleft()
        self.unanswered_bytes -= sent.size
        return sent

    def _other(self, line: str, now: float, events: list[CncEvent]) -> None:
        code = CODE.match(line)
        if line[0] == "<":
            self._report(line, now, events)
        elif code is not None and code[1] == "error":
            self._refuse(int(code[2]), events)
        elif code is not None:
            events.append(AlarmRaised(int(code[2]), *explain_alarm(int(code[2]))))
        elif (line[0] == "[" and line[-1] == "]") or (line[0] == "$" and "=" in line):
            self._feedback(line, events)
        elif line[0] == ">":
            events.append(Message(f"start-up line {line[1:]}"))
        elif BANNER.match(line):
            self._welcome(line, events)
        else:
            self._damaged(line, events)

    def _report(self, line: str, now: float, events: list[CncEvent]) -> None:
        try:
            events.append(StatusReport(self.reader.read(line, now), self.unanswered))
        except MalformedReport:
            self._damaged(line, events)

    def _feedback(self, line: str, events: list[CncEvent]) -> None:
        oldest = self.oldest
        if line.startswith("[MSG:"):
            events.append(Message(line[5:-1]))
        elif oldest is not None and oldest.answer is not None:
            oldest.answer.lines.append(line)

    def _welcome(self, line: str, events: list[CncEvent]) -> None:
        expected, self.reset_expected = self.reset_expected, False
        self.banner = line
        self.reader.forget()
        events.append(Welcome(line, expected, self.clear()))

    def _damaged(self, line: str, events: list[CncEvent]) -> None:
        self.garbled = line[:GARBLED_KEPT]
        events.append(ProtocolFault(f"damaged text from the CNC: {self.garbled!r}", garbled=True))
