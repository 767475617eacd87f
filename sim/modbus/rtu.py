"""Modbus RTU on a pseudo-terminal: frames out of bytes by length, checksum and silence; several devices on one line."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable
from pathlib import Path

from sim.modbus.pdu import answer
from sim.modbus.registers import RegisterBank
from sim.modbus.wire import Wire
from sim.pseudo_terminal import PseudoTerminal

SILENCE_S = 0.05  # a frame that has stopped this long is dropped; far above 3.5 characters, for the scheduler's sake
BROADCAST = 0
BITS_PER_CHARACTER = 11


def crc16(data: bytes) -> int:
    """CRC-16/MODBUS (Modbus over Serial Line 1.02, 6.2.2)."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 if crc & 1 else crc >> 1
    return crc


def frame(device_id: int, pdu: bytes) -> bytes:
    """Address, request or answer, checksum (low byte first)."""
    body = bytes([device_id]) + pdu
    return body + struct.pack("<H", crc16(body))


class RtuReceiver:
    """Bytes of requests to frames. `feed` gets the time, because silence separates frames."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._last_s = 0.0
        self.bad_frames = 0

    def feed(self, data: bytes, now_s: float) -> list[tuple[int, bytes]]:
        """Device id and request of each whole frame; a frame with a wrong checksum is dropped with all that follows it."""
        if now_s - self._last_s > SILENCE_S:
            self._bytes.clear()
        self._last_s = now_s
        self._bytes += data
        found = []
        while len(self._bytes) >= 4:
            size = self._size()
            if size is None or len(self._bytes) < size:
                break
            whole = bytes(self._bytes[:size])
            del self._bytes[:size]
            if struct.unpack("<H", whole[-2:])[0] != crc16(whole[:-2]):
                self.bad_frames += 1
                self._bytes.clear()
                break
            found.append((whole[0], whole[1:-2]))
        return found

    def _size(self) -> int | None:
        """Length of the request that the buffer begins with; None while that is not known."""
        code = self._bytes[1]
        if code in (15, 16):
            return 9 + self._bytes[6] if len(self._bytes) > 6 else None
        if 1 <= code <= 6:
            return 8
        return len(self._bytes)


class RtuLine:
    """One line with its devices. Only a running event loop is needed; `close` gives the terminal back."""

    def __init__(
        self,
        path: Path,
        devices: dict[int, tuple[RegisterBank, Wire]],
        clock: Callable[[], float],
        character_s: float = 0.0,
    ) -> None:
        self.devices = devices
        self._clock = clock
        self._character_s = character_s
        self._receiver = RtuReceiver()
        self._answers: set[asyncio.TimerHandle] = set()
        self._path = path
        self.terminal: PseudoTerminal | None = PseudoTerminal(path, self._receive)

    def tend(self) -> None:
        """Take the port away while one of the devices is gone, and bring it back."""
        is_gone = any(wire.is_gone for _, wire in self.devices.values())
        if is_gone:
            self.close()
        elif self.terminal is None:
            self.terminal = PseudoTerminal(self._path, self._receive)

    def _write(self, data: bytes) -> None:
        if self.terminal is not None:
            self.terminal.write(data)

    def _receive(self) -> None:
        data = self.terminal.read() if self.terminal is not None else b""
        for device_id, request in self._receiver.feed(data, self._clock()):
            if device_id == BROADCAST:
                for bank, wire in self.devices.values():
                    answer(request, bank, wire)
            elif device_id in self.devices:
                self._answer(device_id, request)

    def _answer(self, device_id: int, request: bytes) -> None:
        bank, wire = self.devices[device_id]
        if wire.is_silent:
            return
        reply = frame(device_id, answer(request, bank, wire))
        delay_s = wire.take_delay_s() + self._character_s * (len(request) + 3 + len(reply))
        if delay_s <= 0.0:
            self._write(reply)
            return

        def send() -> None:
            self._answers.discard(handle)
            self._write(reply)

        handle = asyncio.get_running_loop().call_later(delay_s, send)
        self._answers.add(handle)

    def close(self) -> None:
        """Drop answers on their way and remove the terminal. Harmless twice."""
        for handle in self._answers:
            handle.cancel()
        self._answers.clear()
        if self.terminal is not None:
            self.terminal.close()
            self.terminal = None
