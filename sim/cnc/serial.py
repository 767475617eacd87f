"""The CNC's end of its serial line: bytes between pseudo-terminal and firmware, at once or at the pace of the baud rate."""

from __future__ import annotations

from pathlib import Path

from sim.cnc.firmware import Firmware
from sim.cnc.plug import Plug
from sim.pseudo_terminal import PseudoTerminal

BITS_PER_BYTE = 10  # 8N1


class CncSerial:
    """With `bytes_per_s` the line carries so many bytes a second (wire time) each way and the rest waits in the host's queue.

    The terminal is there while the `plug` is in; another name of the port stands beside `path`.
    """

    def __init__(self, firmware: Firmware, plug: Plug, path: Path, bytes_per_s: float | None) -> None:
        self._firmware, self._plug, self._path = firmware, plug, path
        self._bytes_per_s = bytes_per_s
        self._credit = 0.0
        self._answers = bytearray()
        self._pulls = plug.pulls
        self.terminal: PseudoTerminal | None = self._open()

    def _open(self) -> PseudoTerminal:
        path = self._path.with_name(self._plug.name) if self._plug.name else self._path
        return PseudoTerminal(path, None if self._bytes_per_s else self._receive)

    def tend(self) -> None:
        """Follow the plug: out, the terminal is gone with all that was under way; in, it is there again."""
        if self._plug.is_out or self._plug.pulls != self._pulls:
            self._pulls = self._plug.pulls
            self.close()
            self._answers.clear()
            self._firmware.transmit()
        if self.terminal is None and not self._plug.is_out:
            self.terminal = self._open()

    def _receive(self) -> None:
        if self.terminal is not None:
            self._firmware.receive(self.terminal.read())
            self.send()

    def send(self) -> None:
        """Hand over what the firmware has said; called after every step of the world."""
        said = self._firmware.transmit()
        if self._bytes_per_s is None:
            if said and self.terminal is not None:
                self.terminal.write(said)
        else:
            self._answers += said

    def pace(self, wire_dt_s: float) -> None:
        """Let the wire's time go by; a line without a pace has nothing to do."""
        if self._bytes_per_s is None or self.terminal is None:
            return
        self._credit += self._bytes_per_s * wire_dt_s
        most = int(self._credit)
        self._credit -= most
        if most:
            data = self.terminal.read(most)
            if data:
                self._firmware.receive(data)
            self._answers += self._firmware.transmit()
            if self._answers:
                self.terminal.write(bytes(self._answers[:most]))
                del self._answers[:most]

    def close(self) -> None:
        """Remove the terminal. Harmless twice."""
        if self.terminal is not None:
            self.terminal.close()
            self.terminal = None
