"""A Modbus server written from the standard alone, over TCP and over a pty (RTU), with knobs for what real devices do wrong.

Frames: Modbus Application Protocol 1.1b3; Modbus over serial line 1.02 (RTU, CRC-16).
"""

from __future__ import annotations

import asyncio
import os
import pty
import struct
import tty
from collections import defaultdict
from dataclasses import dataclass, field


def crc16(data: bytes) -> bytes:
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = (value >> 1) ^ 0xA001 if value & 1 else value >> 1
    return struct.pack("<H", value)


@dataclass
class Registers:
    """Tables of one device id; every address exists and is 0 unless it stands in `missing`."""

    words: dict[str, dict[int, int]] = field(default_factory=lambda: defaultdict(lambda: defaultdict(int)))
    missing: set[tuple[str, int]] = field(default_factory=set)
    copies: dict[tuple[str, int], tuple[str, int]] = field(default_factory=dict)  # written place -> place where it shows
    stuck: set[tuple[str, int]] = field(default_factory=set)  # places that take a write and keep their value
    exception: int = 0
    is_mute: bool = False
    short_by: int = 0  # registers that an answer lacks
    late_s: float = 0.0
    late_once: bool = False
    lose_writes: int = 0  # requests to write that vanish without an answer
    requests: list[tuple[int, int, int]] = field(default_factory=list)  # function, address, count or value
    log: list[tuple[str, int, int]] = field(default_factory=list)  # table, address, value as written

    def handle(self, pdu: bytes) -> bytes | None:
        function, address, number = struct.unpack(">BHH", pdu[:5])
        self.requests.append((function, address, number))
        if self.is_mute:
            return None
        if function in (5, 6, 15, 16) and self.lose_writes:
            self.lose_writes -= 1
            return None
        if self.exception:
            return bytes([function | 0x80, self.exception])
        if function in (1, 2, 3, 4):
            return self._read(function, {1: "coil", 2: "discrete", 3: "holding", 4: "input"}[function], address, number)
        if function in (5, 6):
            self._store("coil" if function == 5 else "holding", address, int(number == 0xFF00) if function == 5 else number)
            return pdu[:5]
        if function == 16:
            for k, word in enumerate(struct.unpack(f">{number}H", pdu[6 : 6 + 2 * number])):
                self._store("holding", address + k, word)
            return pdu[:5]
        return bytes([function | 0x80, 1])

    def _read(self, function: int, table: str, address: int, count: int) -> bytes:
        if any((table, address + k) in self.missing for k in range(count)):
            return bytes([function | 0x80, 2])
        values = [self.words[table][address + k] for k in range(count - self.short_by)]
        if function in (1, 2):
            packed = bytearray((len(values) + 7) // 8)
            for k, bit in enumerate(values):
                packed[k // 8] |= bit << k % 8
            return bytes([function, len(packed)]) + bytes(packed)
        return bytes([function, 2 * len(values)]) + struct.pack(f">{len(values)}H", *values)

    def _store(self, table: str, address: int, value: int) -> None:
        self.log.append((table, address, value))
        if (table, address) in self.stuck:
            return
        self.words[table][address] = value
        if (table, address) in self.copies:
            shown, at = self.copies[table, address]
            self.words[shown][at] = value

    def delay_s(self) -> float:
        late, self.late_s = self.late_s, 0.0 if self.late_once else self.late_s
        return late


class RawModbus:
    """Devices by id, reachable at `port` (TCP) or `path` (RTU)."""

    def __init__(self, *ids: int) -> None:
        self.devices = {number: Registers() for number in ids}
        self.port = 0
        self.path = ""
        self._server: asyncio.Server | None = None
        self._writers: set[asyncio.StreamWriter] = set()
        self._conversations: set[asyncio.Task[None]] = set()
        self._fds: tuple[int, int] | None = None
        self._frame = bytearray()
        self._later: set[asyncio.TimerHandle] = set()

    async def listen(self, port: int = 0) -> None:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", port)
        self.port = self._server.sockets[0].getsockname()[1]

    def open_line(self) -> None:
        master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        self._fds = (master, slave)
        self.path = os.ttyname(slave)
        asyncio.get_running_loop().add_reader(master, self._hear)

    async def close(self) -> None:
        for timer in self._later:
            timer.cancel()
        if self._server is not None:
            self._server.close()
            for writer in list(self._writers):
                writer.close()
            await asyncio.gather(*self._conversations)
            await self._server.wait_closed()
            self._server = None
        self.close_line()

    def close_line(self) -> None:
        if self._fds is not None:
            asyncio.get_running_loop().remove_reader(self._fds[0])
            for fd in self._fds:
                os.close(fd)
            self._fds = None

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._conversations.add(task)
        self._writers.add(writer)
        try:
            while True:
                tid, _, length, unit = struct.unpack(">HHHB", await reader.readexactly(7))
                pdu = await reader.readexactly(length - 1)
                device = self.devices.get(unit)
                answer = device.handle(pdu) if device else None
                if device is None or answer is None:
                    continue
                self._after(device.delay_s(), writer.write, struct.pack(">HHHB", tid, 0, len(answer) + 1, unit) + answer)
        except (asyncio.IncompleteReadError, ConnectionError):
            pass
        finally:
            self._conversations.discard(task)
            self._writers.discard(writer)
            writer.close()

    def _hear(self) -> None:
        assert self._fds is not None
        try:
            self._frame += os.read(self._fds[0], 4096)
        except OSError:
            return
        while (size := self._size()) and len(self._frame) >= size:
            frame, self._frame = bytes(self._frame[:size]), self._frame[size:]
            device = self.devices.get(frame[0])
            if device is None or crc16(frame[:-2]) != frame[-2:]:
                continue
            answer = device.handle(frame[1:-2])
            if answer is not None:
                body = bytes([frame[0]]) + answer
                self._after(device.delay_s(), self._say, body + crc16(body))

    def _size(self) -> int:
        if len(self._frame) < 8:
            return 0
        return 8 if self._frame[1] <= 6 else 9 + self._frame[6]

    def _say(self, data: bytes) -> None:
        if self._fds is not None:
            os.write(self._fds[0], data)

    def _after(self, delay_s: float, call: object, data: bytes) -> None:
        assert callable(call)
        if delay_s:
            self._later.add(asyncio.get_running_loop().call_later(delay_s, call, data))
        else:
            call(data)
