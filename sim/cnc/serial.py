"""The CNC's end of its serial line: bytes between pseudo-terminal and firmware, at once or at the pace of the baud rate."""

from __future__ import annotations

from pathlib import Path

from sim.cnc.firmware import Firmware
from sim.pseudo_terminal import PseudoTerminal

BITS_PER_BYTE = 10  # 8N1


class CncSerial:
    """With `bytes_per_s` the line carries so many bytes a second (wire time) each way and the rest waits in the host's queue."""

    def __init__(self, firmware: Firmware, path: Path, bytes_per_s: float | None) -> None:
        self._firmware = firmware
        self._bytes_per_s = bytes_per_s
        self._credit = 0.0
        self._answers = bytearray()
        self.terminal = PseudoTerminal(path, None if bytes_per_s else self._receive)

    def _receive(self) -> None:
        self._firmware.receive(self.terminal.read())
        self.send()

    def send(self) -> None:
        """Hand over what the firmware has said; called after every step of the world."""
        said = self._firmware.transmit()
        if self._bytes_per_s is None:
            if said:
                self.terminal.write(said)
        else:
            self._answers += said

    def pace(self, wire_dt_s: float) -> None:
        """Let the wire's time go by; a line without a pace has nothing to do."""
        if self._bytes_per_s is None:
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
        """Remove the terminal."""
        self.terminal.close()
