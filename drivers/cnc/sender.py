"""What goes out next: commands first, then lines of the program, several in one write, as far as wire and controller have room."""

from __future__ import annotations

from collections import deque

from drivers.cnc.program_stream import ProgramStream
from drivers.cnc.protocol import Answer, GrblProtocol
from drivers.cnc.wire import Wire


class Sender:
    """Feeds the wire. `load` exchanges the program while nothing of it is under way.

    Bytes are counted, not lines: the beginning of a line goes as soon as the controller's buffer takes it, its rest later.
    """

    def __init__(self, wire: Wire, protocol: GrblProtocol) -> None:
        self.program: ProgramStream | None = None
        self.objection = ""  # why the program's next line cannot be sent
        self._wire = wire
        self._protocol = protocol
        self._commands: deque[tuple[str, Answer]] = deque()
        self._rest = b""  # of lines that have begun: what the operating system has not taken yet
        self._begun = 0  # bytes of all lines that have begun
        self._ends: deque[tuple[int, str | None]] = deque()  # of each of those: where it ends in _begun, its text if of the program

    @property
    def is_empty(self) -> bool:
        """Whether no command waits and every line that has begun has left whole."""
        return not (self._commands or self._ends)

    @property
    def has_command(self) -> bool:
        """Whether a command waits."""
        return bool(self._commands)

    def may_write(self, free: int) -> bool:
        """Whether something waits for the wire alone: neither for an answer nor for a release. free: as of `free`"""
        if free <= 0:
            return False
        if self._rest:
            return True
        return self._protocol.has_room(len(self._commands[0][0]) + 1) if self._commands else self._has_line()

    @property
    def answered_bytes(self) -> int:
        """Bytes of all lines that have begun, less those that wait for their answer."""
        return self._begun - self._protocol.unanswered_bytes

    def load(self, program: ProgramStream | None) -> None:
        """The program to send lines of from now on."""
        self.program = program
        self.objection = ""

    def enqueue(self, text: str) -> Answer:
        """A command outside the program; it goes behind the line that is being written."""
        answer = Answer()
        self._commands.append((text, answer))
        return answer

    def abandon(self) -> None:
        """Forget what has not been written."""
        for _, answer in self._commands:
            answer.is_lost = True
        self._commands.clear()
        self._ends.clear()
        self._begun -= len(self._rest)
        self._rest = b""

    def write(self, now: float) -> None:
        """Write as much as there is room for, here and at the controller. now: the clock's time, s. Raises LinkLost."""
        free = self.free()
        if free <= 0 or not (self._rest or self._commands or self.program is not None):
            return
        room = min(self._wire.room(now), free)
        if room <= 0:
            return
        while len(self._rest) < room and self._begin():
            pass
        if self._rest:
            self._rest = rest = self._rest[self._wire.write(self._rest[:room]) :]
            if self._ends and self._ends[0][0] <= self._begun - len(rest):
                self._finish()

    def free(self) -> int:
        """Bytes that the controller takes beyond those written."""
        return self._protocol.window_bytes - self._protocol.unanswered_bytes + len(self._rest)

    def _has_line(self) -> bool:
        program = self.program
        return program is not None and not program.halted and not self.objection and program.peek() is not None

    def _begin(self) -> bool:
        """Begin the next command or line; whether there was one."""
        of_program = None
        if self._commands:
            text, answer = self._commands[0]
            data = text.encode("ascii") + b"\n"
            if not self._protocol.has_room(len(data)):
                return False
            self._commands.popleft()
            self._protocol.begin(0, text, len(data), answer)
        else:
            program = self.program
            if program is None or program.halted or self.objection or (line := program.peek()) is None:
                return False
            text = line
            self.objection = program.objection(text, self._protocol.window_bytes)
            if self.objection:
                return False
            data = text.encode("ascii") + b"\n"
            program.take()
            self._protocol.begin(program.taken, text, len(data))
            of_program = text
        self._rest += data
        self._begun += len(data)
        self._ends.append((self._begun, of_program))
        return True

    def _finish(self) -> None:
        """Tell protocol and program of every line that has left whole."""
        gone = self._begun - len(self._rest)
        while self._ends and self._ends[0][0] <= gone:
            text = self._ends.popleft()[1]
            self._protocol.finish()
            if text is not None and self.program is not None:
                self.program.went(text)
