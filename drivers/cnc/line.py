"""The CNC's line: the protocol joined to a port and a clock; streams a program, passes commands, tells what happens."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

from config.cell import Cnc
from drivers.cnc import protocol as grbl
from drivers.cnc.events import (
    AlarmRaised,
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
from drivers.cnc.overdue import AnswerWatch, pauses_of
from drivers.cnc.pacing import BITS_PER_BYTE
from drivers.cnc.program_stream import ProgramStream
from drivers.cnc.protocol import Answer, GrblProtocol
from drivers.cnc.sender import Sender
from drivers.cnc.wire import Wire
from drivers.errors import CommandRefused, DriverError, LinkLost, RangeError_
from drivers.interfaces import BytePort, Clock

QUERY_PERIOD_MIN_S = {"grbl": 0.1, "grblhal": 0.05}  # on 8 bits motion is disturbed by more than 10 reports a second (grbl 1.1, Interface)
REPORT_BYTES = 100  # of a long status report
REPORT_SHARE = 0.5  # of a slow line that reports may take on the way back: the rest is for answers
NEXT_ANSWER_S = 0.02  # a query waits at most this long for the next answer, so that its report does not keep one waiting
TIGHT_S = 0.04  # a window that the line fills within this needs every answer at once
LATE_READ_S = 0.003  # answers that nothing hangs on are left in the port so long: less often awake
HEADROOM = 3  # writes of the most that may stand: so much has to be free at the controller meanwhile
STEP_S = 0.002  # how often an awaited command looks at the line
OVERRIDE_PERCENT = (10, 200)


class CncLine:
    """One serial line to one CNC.

    Nothing here waits. The owner calls `pump` when `fileno` is readable and at every tick, `write` after `due_in_s`
    (LineWatch does both on an event loop); awaited commands pump by themselves and keep the events for the next `pump`.
    """

    def __init__(self, port: BytePort, facts: Cnc, letters: tuple[str, ...], clock: Clock) -> None:
        self.facts = facts
        self.letters = letters
        self.clock = clock
        self.status: Status | None = None
        self.identity: Identity | None = None
        self.protocol = GrblProtocol(letters, facts.line_length_max, BITS_PER_BYTE / facts.baud)
        self.alarm: AlarmRaised | None = None  # the last one since the last command
        self.is_timed = False  # a timer calls `write` when it is due: what is read before brings no write of its own
        self._port = port
        self._wire = Wire(port, facts.baud, clock)
        self._sender = Sender(self._wire, self.protocol)
        self._answers = AnswerWatch(self.protocol, facts, clock.now())
        self._program: ProgramStream | None = None
        self._events: list[CncEvent] = []
        self._has_news = False  # among them are others than LineAccepted
        self._lost = ""
        self._query_s = max(QUERY_PERIOD_MIN_S[facts.firmware], facts.status_period_s, REPORT_BYTES * BITS_PER_BYTE / facts.baud / REPORT_SHARE)
        self._asked_at = -math.inf  # last status query
        self._read_at = -math.inf  # the port was looked at last
        self._tight_bytes = TIGHT_S * facts.baud / BITS_PER_BYTE

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
        if self.protocol.unanswered or not self._sender.is_empty:
            return False
        return program is None or (program.is_sent and program.executed >= program.sent)

    @property
    def has_news(self) -> bool:
        """Whether `pump` would tell more than that lines were accepted: another event, or that no line waits any more."""
        return self._has_news or (bool(self._events) and not self.protocol.unanswered)

    def fileno(self) -> int | None:
        """Descriptor to watch for readability."""
        return self._port.fileno()

    def pump(self) -> list[CncEvent]:
        """Read, parse, check time-outs, write what fits; the events since the last call. A lost line is a PortLost event."""
        self.step()
        events, self._events = self._events, []
        self._has_news = False
        return events

    def due_in_s(self) -> float:
        """Seconds until `write` has something to do, if nothing is read before."""
        return max(0.0, self.due_at() - self.clock.now())

    def due_at(self) -> float:
        """The same as a time of the clock."""
        return self.outlook()[0]

    def outlook(self) -> tuple[float, bool]:
        """(due_at, whether what comes may wait until then in the port: no report is under way, and room is left for more writes)."""
        if self._lost:
            return self.clock.now() + self.facts.status_period_s, False
        sender, wire, protocol = self._sender, self._wire, self.protocol
        free = sender.free()
        may_write, is_urgent = sender.may_write(free), bool(wire.urgent)
        at = self._query_at()
        if not (may_write or is_urgent):
            return at, False
        has_headroom = may_write and not is_urgent and free >= HEADROOM * wire.pacer.ahead_bytes and not sender.has_command
        return min(at, wire.due_at()), has_headroom and protocol.asked_at < protocol.report_came_at

    def serve(self, due_at: float, *, reads: bool) -> None:
        """`write` when the timer for `due_at` goes off. reads : what comes is not watched for: it is read here, now and then."""
        now = self.clock.now()
        self._wire.pacer.woke(now - due_at)
        self._write(now)
        if reads and now - self._read_at >= LATE_READ_S and not self._lost:
            self._read()

    def step(self) -> None:
        """As pump, but the events stay for the next pump."""
        if self._lost:
            return
        now = self._read()
        if (overdue := self._answers.look(now, self._program)) is not None:
            self._tell(overdue)
            if overdue.n:
                self._stop_stream(f"no answer to line {overdue.n}")
        if not self.is_timed or self.clock.now() >= self.due_at():
            self.write()

    def write(self, late_s: float | None = None) -> None:
        """Ask for status if it is time to, and write what fits. late_s: how late the timer was that brought this about."""
        if late_s is not None:
            self._wire.pacer.woke(late_s)
        self._write(self.clock.now())

    def _read(self) -> float:
        """Take what has come; the clock's time then, s."""
        now = self.clock.now()
        try:
            data = self._port.read()
            self._read_at = now = self.clock.now()
            if data:
                for event in self.protocol.receive(data, now):
                    self._take(event, now)
                self.query_status()
        except LinkLost as error:
            self._lose(error)
        return now

    def _write(self, now: float) -> None:
        if self._lost:
            return
        try:
            if now >= self._query_at():
                self.query_status()
            elif self._wire.urgent:
                self._wire.flush()
            self._sender.write(now)
        except LinkLost as error:
            self._lose(error)
        if self._sender.objection and self._program is not None and not self._program.halted:
            self._object(self._program, self._sender.objection)

    def load(self, lines: Sequence[str] | Iterable[str], first: int = 0, times_s: Sequence[float] | None = None) -> None:
        """A program to stream from line index `first` (line i carries N(i+1)); nothing goes before `release`.

        times_s : predicted end of each line in s, by index; extends the answer time-out. An Iterable starts at `first`.
        Raises CommandRefused when another program is under way or the controller has not been identified.
        """
        if self.identity is None:
            raise CommandRefused("the CNC has not been identified", "connect first")
        if self.protocol.unanswered or self.protocol.is_latched or not (self.is_halted or self.is_drained):
            raise CommandRefused("the CNC still has lines of another program", "let it end, or abort and reset it")
        self._program = ProgramStream(lines, first, self.facts.line_length_max, times_s, pauses_of(self.facts))
        self._sender.load(self._program)
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
            self._sender.load(None)

    def _query_at(self) -> float:
        """When status is asked for if no answer comes before: a report on a busy line keeps the answers behind it waiting."""
        at = self._asked_at + self._query_s
        is_tight = 0 < self.protocol.window_bytes < self._tight_bytes and self._wire.pacer.is_busy
        return at + NEXT_ANSWER_S if is_tight and self.protocol.unanswered else at

    def query_status(self) -> bool:
        """`?`, at most ten times a second; whether it was sent. Raises LinkLost."""
        now = self.clock.now()
        if now - self._asked_at < self._query_s:
            return False
        self._asked_at = self.protocol.asked_at = now
        self._wire.pacer.asked(now)
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
        self._sender.abandon()
        self.protocol.reset_expected = True
        self._answers.reset_asked(self.clock.now())
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
        return self._sender.enqueue(text)

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
            self._sender.abandon()
            self._tell(PortLost(error.message))

    def _halt(self, because: str) -> None:
        if self._program is not None and not self._program.halted:
            self._program.halted = because

    def _stop_stream(self, because: str) -> None:
        """Send nothing more of the program and hold: a firmware that drops a bad line goes on with the next one."""
        if self._program is not None and not self._program.halted:
            self._halt(because)
            self.hold()

    def _tell(self, event: CncEvent) -> None:
        self._events.append(event)
        self._has_news = True

    def _take(self, event: CncEvent, now: float) -> None:
        if type(event) is LineAccepted:
            self._events.append(event)
            self._answers.progress(now)
            return
        self._tell(event)
        match event:
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
                self._sender.abandon()
                self._halt("the controller has reset")
                self._answers.was_reset()
            case _:
                pass

    def _follow(self, status: Status, unanswered: int) -> None:
        self.status = status
        self._wire.pacer.heard(self.protocol.report_came_at, self._sender.answered_bytes)
        planner_blocks = self.identity.planner_blocks if self.identity else None
        self._answers.report(status, planner_blocks)
        if self._program is not None:
            self._program.follow(status, unanswered, planner_blocks)

    def _object(self, program: ProgramStream, why: str) -> None:
        """The program's next line cannot be sent."""
        text = program.peek() or ""
        self._tell(LineRejected(program.taken + 1, 0, why, text, "abort the job and post the program again for this cell"))
        self._stop_stream(why)


def could_be_error(text: str) -> bool:
    """Whether damaged text may have been `error:n`: on grbl 1.1 that line would be missing from the motion."""
    return text[:1] not in "<[$" and "|" not in text and (":" in text or "rr" in text)
