"""The outgoing side of the serial line: real-time bytes at once, lines paced behind them."""

from __future__ import annotations

from drivers.cnc.pacing import Pacer
from drivers.interfaces import BytePort, Clock


class Wire:
    """Holds at most one line that is partly written, and real-time bytes that the operating system did not take."""

    def __init__(self, port: BytePort, baud: int, clock: Clock) -> None:
        self._port = port
        self._clock = clock
        self._pacer = Pacer(baud)
        self._urgent = b""
        self._line = b""

    @property
    def is_free(self) -> bool:
        """Whether the line before has left whole."""
        return not self._line

    def urge(self, byte: bytes) -> None:
        """Write a real-time byte ahead of everything that is not written yet. Raises LinkLost."""
        self._urgent += byte
        self._flush_urgent()

    def put(self, line: bytes) -> None:
        """The next line, newline included; only when is_free."""
        self._line = line

    def write(self) -> bool:
        """Write as much as the pacing lets; whether a line has just left whole and there is room for more. Raises LinkLost."""
        if self._urgent and not self._flush_urgent():
            return False
        if not self._line:
            return False
        room = self._pacer.room(self._clock.now(), self._port.queued())
        if room <= 0:
            return False
        count = self._port.write(self._line[:room])
        self._pacer.wrote(count)
        self._line = self._line[count:]
        return not self._line

    def drop(self) -> None:
        """Discard everything that is not on the wire yet. Raises LinkLost."""
        self._urgent = self._line = b""
        self._pacer.dropped()
        self._port.discard_output()

    def wait_s(self) -> float:
        """Seconds until it is worth writing again."""
        if self._urgent:
            return 0.0
        return self._pacer.wait_s(self._clock.now())

    def _flush_urgent(self) -> bool:
        count = self._port.write(self._urgent)
        self._pacer.wrote(count)
        self._urgent = self._urgent[count:]
        return not self._urgent
