"""The outgoing side of the serial line: real-time bytes at once, lines paced behind them."""

from __future__ import annotations

from drivers.cnc.pacing import Pacer
from drivers.interfaces import BytePort, Clock

RETRY_S = 0.0005  # for real-time bytes that the operating system refused


class Wire:
    """Puts bytes on the port no faster than the line takes them, and keeps real-time bytes that the operating system refused."""

    def __init__(self, port: BytePort, baud: int, clock: Clock) -> None:
        self.pacer = Pacer(baud)
        self._port = port
        self._clock = clock
        self.urgent = b""  # real-time bytes that wait because the operating system refused them

    def urge(self, byte: bytes) -> None:
        """Write a real-time byte ahead of everything that is not written yet. Raises LinkLost."""
        self.urgent += byte
        self.flush()

    def room(self, now: float) -> int:
        """Bytes that may be written now (the clock's time, s). Raises LinkLost."""
        if self.urgent and not self.flush():
            return 0
        room = self.pacer.room(now)
        if room > 0 and (queued := self._port.queued()) > 0:
            self.pacer.stands(queued)
            room = min(room, self.pacer.ahead_bytes - queued)
        return room

    def write(self, data: bytes) -> int:
        """Write at most `room()` bytes; the number that was taken. Raises LinkLost."""
        count = self._port.write(data)
        if count:
            self.pacer.wrote(count)
        else:
            self.pacer.refused()
        return count

    def drop(self) -> None:
        """Discard everything that is not on the wire yet. Raises LinkLost."""
        self.urgent = b""
        self.pacer.dropped()
        self._port.discard_output()

    def due_at(self) -> float:
        """When it is worth writing again (s, the clock's time)."""
        return self._clock.now() + RETRY_S if self.urgent else self.pacer.due_at()

    def flush(self) -> bool:
        """Write the real-time bytes that wait; whether none waits any more. Raises LinkLost."""
        count = self._port.write(self.urgent)
        self.pacer.wrote(count)
        self.urgent = self.urgent[count:]
        return not self.urgent
