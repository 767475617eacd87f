"""The CNC's line: the protocol joined to a port and a clock; streams a program, passes commands, tells what happens."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

from config.cell import Cnc
from drivers.cnc import protocol as grbl
from drivers.cnc.events import (
    AlarmRaised,
    AnswerOverdue,
    CncEvent,
    Identity,
    LineAccepted,
    LineCounts,
    LineRejected,
    PortLost,
    ProtocolFault,
    Status,
    StatusReport,
    Welcome,
)
from drivers.cnc.program_stream import ProgramStream
from drivers.cnc.protocol import Answer, GrblProtocol
from drivers.cnc.status import MOVING, PAUSING
from drivers.cnc.wire import Wire
from drivers.errors import CommandRefused, DriverError, LinkLost, RangeError_
from drivers.interfaces import BytePort, Clock

QUERY_PERIOD_MIN_S = 0.1  # firmwares answer status at most 10 times a second without disturbing motion
STEP_S = 0.002  # how often an awaited command looks at the line
STATUS_FRESH_S = 1.0  # an older report says nothing about why answers are missing
RESET_S = 3.0  # for the banner after a soft reset; boards that load their program again take about two
OVERRIDE_PERCENT = (10, 200)


class CncLine:
    """One serial line to one CNC.

    Nothing here waits. The owner calls `pump` when `fileno` is readable, after `due_in_s`, and at every tick; awaited
    commands pump by themselves and keep the events for the next `pump`.
    """

    def __init__(self, port: BytePort, facts: Cnc, letters: tuple[str, ...], clock: Clock) -> None:
        self.facts = facts
        self.letters = letters
        self.clock = clock
        self.status: Status | None = None
        self.identity: Identity | None = None
        self.protocol = GrblProtocol(letters, facts.line_length_max)
        self._port = port
        self._wire = Wire(port, facts.baud, clock)
        self._program: ProgramStream | None = None
        self._commands: list[tuple[str, Answer]] = []
        self._events: list[CncEvent] = []
        self._going: tuple[str, Answer | None] | None = None  # the line that is being written
        self._lost = ""
        self._asked_at = -math.inf  # last status query
        self._progress_at = clock.now()  # last sign that answers may still be on their way
        self._is_overdue = False
        self._reset_at = 0.0
        self.alarm: AlarmRaised | None = None  # the last one since the last command

    @property
    def is_connected(self) -> bool:
        """Whether the port is open and has not been lost."""
        return not self._lost

    @property
    def is_halted(self) -> str:
        """Why the loaded program has stopped being sent ("" while it is not)."""
        return self._program.halted if self._program else ""

    @property
    def counts(self) -> LineCounts:
        """The four line counts of the loaded program."""
        return self._program.counts(self.protocol.acknowledged) if self._program else LineCounts(0, 0, 0, 0)

    @property
    def is_drained(self) -> bool:
        """Whether every released line has been executed and the machine is idle."""
        program = self._program
        if self._going is not None or self._commands or self.protocol.unanswered:
            return False
        return program is None or (program.is_sent and program.executed >= program.sent)

    def fileno(self) -> int | None:
        """Descriptor to watch for readability."""
        return self._port.fileno()

    def pump(self) -> list[CncEvent]:
        """Read, parse, check time-outs, write what fits; the events since the last call. A lost line is a PortLost event."""
        self.step()
        events, self._events = self._events, []
        return events

    def due_in_s(self) -> float:
        """Seconds until `pump` has something to write, if nothing is read before."""
        if self._lost:
            return self.facts.status_period_s
        to_query = max(0.0, self._asked_at + max(QUERY_PERIOD_MIN_S, self.facts.status_period_s) - self.clock.now())
        return to_query if self._going is None else min(to_query, self._wire.wait_s())

    def step(self) -> None:
        """As pump, but the events stay for the next pump."""
        if self._lost:
            return
        try:
            data = self._port.read()
            if data:
                for event in self.protocol.receive(data, self.clock.now()):
                    self._take(event)
            self._watch()
            self.query_status()
            self._write()
        except LinkLost as error:
            self._lose(error)

    def load(self, lines: Sequence[str] | Iterable[str], first: int = 0, times_s: Sequence[float] | None = None) -> None:
        """A program to stream from line index `first` (line i carries N(i+1)); nothing goes before `release`.

        times_s : predicted end of each line in s, by index; extends the answer time-out. An Iterable starts at `first`.
        Raises CommandRefused when another program is under way or the controller has not been identified.
        """
        if self.identity is None:
            raise CommandRefused("the CNC has not been identified", "connect first")
        if self.protocol.unanswered or self.protocol.is_latched or not (self.is_halted or self.is_drained):
            raise CommandRefused("the CNC still has lines of another program", "let it end, or abort and reset it")
        self._program = ProgramStream(lines, first, self.facts.line_length_max, times_s)
        self.protocol.acknowledged = first

    def release(self, upto: int) -> None:
        """Let lines with index < upto go. Raises CommandRefused when no program is loaded."""
        if self._program is None:
            raise CommandRefused("no program is loaded", "load one first")
        self._program.released = max(self._program.released, upto)

    def unload(self) -> None:
        """Forget the program; lines in flight keep their answers."""
        if self._program is not None:
            self._program.halted = "unloaded"
            self._program = None

    def query_status(self) -> bool:
        """`?`, at most ten times a second; whether it was sent. Raises LinkLost."""
        now = self.clock.now()
        if now - self._asked_at < max(QUERY_PERIOD_MIN_S, self.facts.status_period_s):
            return False
        self._asked_at = now
        self.urge(grbl.STATUS)
        return True

    def hold(self) -> None:
        """`!`: slow down and stand. Raises LinkLost."""
        self.urge(grbl.HOLD)

    def resume(self) -> None:
        """`~`: go on. Raises LinkLost."""
        self.urge(grbl.RESUME)

    def jog_cancel(self) -> None:
        """End a jog. grblHAL flushes its receive buffer too. Raises LinkLost."""
        self.urge(grbl.JOG_CANCEL)

    def reset(self) -> None:
        """Soft reset: what is not on the wire is dropped, nothing more of the program goes. In motion it costs the position.

        Raises LinkLost. A Welcome event tells that it was carried out.
        """
        self._halt("reset")
        self._check_port()
        try:
            self._wire.drop()
        except LinkLost as error:
            self._lose(error)
            raise
        self._abandon()
        self.protocol.reset_expected = True
        self._reset_at = self.clock.now()
        self.urge(grbl.RESET)

    def feed_override(self, percent: int) -> None:
        """Feed override to `percent` of the programmed feed. Raises RangeError_ outside 10..200, LinkLost."""
        low, high = OVERRIDE_PERCENT
        if not low <= percent <= high:
            raise RangeError_(f"CNC: feed override {percent} % asked, limits are {low} to {high} %", "ask for less")
        tens, ones = divmod(abs(percent - 100), 10)
        ten, one = (grbl.FEED_UP_10, grbl.FEED_UP_1) if percent > 100 else (grbl.FEED_DOWN_10, grbl.FEED_DOWN_1)
        self.urge(grbl.FEED_100 + ten * tens + one * ones)

    def urge(self, byte: bytes) -> None:
        """Put real-time bytes on the wire now. Raises LinkLost."""
        self._check_port()
        try:
            self._wire.urge(byte)
        except LinkLost as error:
            self._lose(error)
            raise

    def enqueue(self, text: str) -> Answer:
        """Queue a command behind nothing: it goes with the next step. Raises LinkLost, RangeError_."""
        self._check_port()
        if len(text) > self.facts.line_length_max or "\n" in text or not text.isascii():
            raise RangeError_(f"CNC: {text[:40]!r} is no single line of up to {self.facts.line_length_max} characters", "shorten it")
        answer = Answer()
        self._commands.append((text, answer))
        return answer

    async def wait_until(self, is_met: Callable[[], bool], timeout_s: float) -> bool:
        """Pump until `is_met` (True) or the time is over (False). Raises LinkLost."""
        deadline = self.clock.now() + timeout_s
        while not is_met():
            if self.clock.now() >= deadline:
                return False
            self.step()
            self._check_port()
            if not is_met():
                await self.clock.sleep(STEP_S)
        return True

    def close(self) -> None:
        """Give the port back; nothing more is sent."""
        self._lost = self._lost or f"serial port {self._port.name} was closed"
        self._port.close()

    def _check_port(self) -> None:
        if self._lost:
            raise LinkLost(self._lost, "plug the CNC's cable in again and reset")

    def _lose(self, error: DriverError) -> None:
        if not self._lost:
            self._lost = error.message
            self._halt("link lost")
            self._abandon()
            self._events.append(PortLost(error.message))

    def _halt(self, because: str) -> None:
        if self._program is not None and not self._program.halted:
            self._program.halted = because

    def _abandon(self) -> None:
        """Forget what has not been written."""
        for _, answer in self._commands:
            answer.is_lost = True
        self._commands.clear()
        self._going = None

    def _stop_stream(self, because: str) -> None:
        """Send nothing more of the program and hold: a firmware that drops a bad line goes on with the next one."""
        if self._program is not None and not self._program.halted:
            self._halt(because)
            self.hold()

    def _take(self, event: CncEvent) -> None:
        self._events.append(event)
        match event:
            case LineAccepted():
                self._progress_at = self.clock.now()
            case StatusReport(status, unanswered):
                self._follow(status, unanswered)
            case LineRejected(n, code):
                self._stop_stream(f"line {n} was refused (error {code})")
            case AlarmRaised(code):
                self.alarm = event
                self._halt(f"alarm {code}")
            case ProtocolFault(text, garbled):
                if not garbled or could_be_error(self.protocol.garbled):
                    self._stop_stream(text)
            case Welcome():
                self._wire.drop()
                self._abandon()
                self._halt("the controller has reset")
                self._is_overdue = False
            case _:
                pass

    def _follow(self, status: Status, unanswered: int) -> None:
        before, self.status = self.status, status
        if status.state in PAUSING or before is None or (status.state in MOVING and (status.machine != before.machine or status.line != before.line)):
            self._progress_at = status.at
        if self._program is not None:
            empty = self.identity.planner_blocks if self.identity else None
            self._program.follow(status, unanswered, empty)

    def _watch(self) -> None:
        """Tell once when the answer to the oldest line is overdue."""
        now = self.clock.now()
        if self.protocol.reset_expected and now - self._reset_at > RESET_S:
            self.protocol.reset_expected = False
            self._events.append(AnswerOverdue(0, "reset", now - self._reset_at, self.protocol.garbled))
        oldest = self.protocol.oldest
        if oldest is None or oldest.answer is not None:
            self._progress_at = now
            self._is_overdue = False
            return
        waited = now - self._progress_at
        if self._is_overdue or waited <= self.facts.answer_timeout_s:
            return
        status = self.status
        if status is not None and status.state in PAUSING and now - status.at < STATUS_FRESH_S:
            return
        if waited > self.facts.answer_timeout_s + self._allowance_s():
            self._is_overdue = True
            self._events.append(AnswerOverdue(oldest.n, oldest.text, waited, self.protocol.garbled))
            self._stop_stream(f"no answer to line {oldest.n}")

    def _allowance_s(self) -> float:
        """Predicted time of the moves that the controller still holds, at the present overrides."""
        if self._program is None:
            return 0.0
        feed, rapid, _ = self.status.overrides if self.status else (100, 100, 100)
        return self._program.remaining_s() * 100.0 / max(1, min(feed, rapid, 100))

    def _write(self) -> None:
        while self._going is not None or self._next():
            if not self._wire.write():
                return
            assert self._going is not None
            (text, answer), self._going = self._going, None
            self.protocol.finish()
            if answer is None and self._program is not None:
                self._program.went(text)

    def _next(self) -> bool:
        """Begin the next command or line if the controller has room for it."""
        program = self._program
        answer: Answer | None = None
        if self._commands:
            n, (text, answer) = 0, self._commands[0]
        elif program is not None and not program.halted and (line := program.peek()) is not None:
            n, text = program.sent + 1, line
            objection = program.objection(text, self.protocol.window_bytes)
            if objection:
                self._events.append(LineRejected(n, 0, objection, text, "abort the job and post the program again for this cell"))
                self._stop_stream(objection)
                return False
        else:
            return False
        data = text.encode("ascii") + b"\n"
        if not self.protocol.has_room(len(data)):
            return False
        if answer is not None:
            del self._commands[0]
        self.protocol.begin(n, text, len(data), answer)
        self._wire.put(data)
        self._going = (text, answer)
        return True


def could_be_error(text: str) -> bool:
    """Whether damaged text may have been `error:n`: on grbl 1.1 that line would be missing from the motion."""
    return text[:1] not in "<[$" and "|" not in text and (":" in text or "rr" in text)
