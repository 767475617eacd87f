"""The grbl line protocol without a wire: bytes in, events out; who is owed an answer, and how much may still be sent.

An answer (`ok`, `error:n`) belongs to the oldest unanswered line; nothing else frees one. Real-time bytes never count.
Sources: grbl 1.1 documentation ("Interface", character counting), grblHAL core (error latch).
"""

from __future__ import annotations

import math
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
SPINDLE_STOP = b"\x9e"  # in a hold only: stops a spindle that turns, lets go one that it stopped
FEED_100, FEED_UP_10, FEED_DOWN_10, FEED_UP_1, FEED_DOWN_1 = b"\x90", b"\x91", b"\x92", b"\x93", b"\x94"

LINE_BYTES_MAX = 4096  # no firmware sends a longer line; what is longer is noise
SURPLUS_BYTES = 8  # in the controller's buffer beyond what is unanswered; no line of a program is shorter
GARBLED_KEPT = 60  # characters of damaged text kept for the operator
BANNER = re.compile(r"(?i)^grbl(hal)? ?\d|^grblhal")
CODE = re.compile(r"^(error|ALARM):(\d{1,3})$")


SETTINGS_LOST = "error:7"
"""grbl 1.1 says so by itself before its banner when its EEPROM is blank or damaged (report_status_message in settings_init)."""


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
    """State of the line protocol. `window_bytes` is what may stand unanswered, newlines included.

    byte_s : time that a byte takes on the line, s (0: none is known)
    """

    def __init__(self, letters: tuple[str, ...], window_bytes: int = 0, byte_s: float = 0.0) -> None:
        self.window_bytes = window_bytes
        self.reader = StatusReader(letters)
        self.unanswered_bytes = 0
        self.acknowledged = 0  # N-word up to which every line was accepted
        self.is_latched = False  # a line of the stream was refused: nothing more may be sent before `clear`
        self.reset_expected = False
        self.asked_at = -math.inf  # when status was asked for last
        self.rx_idle: int | None = None  # bytes that the controller says are free when its buffer is empty
        self.report_came_at = 0.0  # the first byte of the last status report
        self.banner = ""
        self.garbled = ""
        self._partial = b""
        self._partial_at = 0.0  # when its first byte came
        self._byte_s = byte_s
        self._is_surplus_told = False
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

    @property
    def unanswered_texts(self) -> list[str]:
        """The lines that wait for their answer, oldest first."""
        return [sent.text for sent in self._sent]

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
        self._is_surplus_told = False
        self.garbled = ""
        return forgotten

    def receive(self, data: bytes, now: float) -> list[CncEvent]:
        """Take bytes as they come, any number at a time; the events of all lines that are complete."""
        events: list[CncEvent] = []
        if data == b"ok\r\n" and not self._partial:
            self._accept(events)
            return events
        began = self._partial_at if self._partial else now
        lines = (self._partial + data).split(b"\n")
        self._partial = lines.pop()
        self._partial_at = began if not lines else now
        if len(self._partial) > LINE_BYTES_MAX:
            lines.append(self._partial)
            self._partial = b""
        behind = sum(map(len, lines)) + len(lines) + len(self._partial)  # bytes from the line's first one on
        for line in lines:
            if line == b"ok\r" or line == b"ok":
                self._accept(events)
            elif text := line.rstrip(b"\r"):
                self.report_came_at = began if text[0] == 0x3C else self.report_came_at
                self._other(text.decode("ascii", "replace"), self._formed_at(now, began, behind), events)
            behind -= len(line) + 1
            began = now
        return events

    def _formed_at(self, now: float, began: float, behind: int) -> float:
        """When the controller began to send a line: `behind` bytes before now by the baud rate, no later than its first byte came.

        A line without baud rate (USB, a pty) brings them at once: what was asked for was not formed before it was asked.
        """
        return min(now, max(min(self.asked_at, began), min(began, now - behind * self._byte_s)))

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
        elif line == SETTINGS_LOST and not self.banner and not self._whole:
            events.append(Message("the CNC's settings could not be read when it was switched on: the firmware's own hold (error 7)"))
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
            status = self.reader.read(line, now)
        except MalformedReport:
            self._damaged(line, events)
            return
        events.append(StatusReport(status, self.unanswered))
        if status.rx_free is not None and self.rx_idle is not None and not self._is_surplus_told:
            surplus = self.rx_idle - status.rx_free - self.unanswered_bytes
            if surplus >= SURPLUS_BYTES:
                self._is_surplus_told = True
                events.append(ProtocolFault(f"the CNC holds {surplus} bytes more than it should (an answer was doubled)"))

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
