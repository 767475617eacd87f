"""What stands between tests and hardware: a Modbus line and a serial port that refuse whatever could lead to light, or to motion."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field

from config.device import Device, Register, Table
from drivers.interfaces import BytePort, ModbusLink
from drivers.modbus.registers import encode

ALWAYS = frozenset({"heartbeat", "fault_reset"})
"""Registers that make no light and move nothing."""

MOTION = frozenset({"head_deploy"})
HARMLESS = frozenset({"shield_gas_setpoint"})
"""Set-points that may leave their safe value where writing is permitted."""

REALTIME = re.compile(rb"[?!~\x18\x80-\xff]")
LIGHT_WORDS = re.compile(r"M0*(3|4|62|64|67|68)(?!\d)|S0*[1-9]")
MOTION_WORDS = re.compile(r"G0*[0-3](?!\d)|G0*(28|30|38)|\$J|\$H|M0*6(?!\d)")
LAST_WORD = re.compile(r"[A-Z][^A-Z]*$")
AXIS_WORDS = re.compile(r"(?<![A-Z$])[XYZABCUVW]-?[\d.]")


class GuardError(AssertionError):
    """Something asked for what must not be asked on a bench. It was not sent."""


@dataclass(frozen=True)
class Written:
    """A write that was let through. values : as on the wire"""

    role: str
    register: str
    values: tuple[int, ...]


@dataclass
class GuardedLink:
    """A Modbus line for one device of it. Raises GuardError before anything goes out that is no safe value.

    register : writable ones by place; what stands in no map is refused as well
    """

    line: ModbusLink
    role: str
    device: Device
    may_write: bool = False
    may_move: bool = False
    written: list[Written] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Of the line."""
        return self.line.name

    @property
    def connected(self) -> bool:
        """Whether the line is open."""
        return self.line.connected

    async def connect(self) -> None:
        """Open the line."""
        await self.line.connect()

    async def close(self) -> None:
        """Close the line."""
        await self.line.close()

    async def read(self, device_id: int, table: Table, address: int, count: int) -> list[int]:
        """Reading is free."""
        return await self.line.read(device_id, table, address, count)

    async def write(
        self, device_id: int, table: Table, address: int, values: list[int], sending: Callable[[], None] | None = None
    ) -> None:
        """Write what is permitted. Raises GuardError, and what the line raises."""
        k = 0
        while k < len(values):
            name, register = self._register(table, address + k)
            words = values[k : k + register.count]
            if not self._is_permitted(name, register, words):
                self._refuse(f"{self.role}.{name} = {words}")
            self.written.append(Written(self.role, name, tuple(words)))
            k += register.count
        await self.line.write(device_id, table, address, values, sending)

    def _register(self, table: Table, address: int) -> tuple[str, Register]:
        for name, register in self.device.registers.items():
            if register.writable and register.table == table and register.address == address:
                return name, register
        self._refuse(f"{self.role}: {table} {address}, which is no set-point of its map")
        raise AssertionError

    def _is_permitted(self, name: str, register: Register, words: list[int]) -> bool:
        if name in ALWAYS:
            return True
        if register.safe is not None and words == encode(register, register.safe):
            return True
        return (name in HARMLESS and self.may_write) or (name in MOTION and self.may_move)

    def _refuse(self, what: str) -> None:
        self.refused.append(what)
        raise GuardError(f"refused to write {what} on a bench")


class GuardedPort:
    """A CNC's serial port. Lines that open a gate, set a power or start a spindle are refused, and those that move unless that is permitted."""

    def __init__(self, port: BytePort, *, may_move: bool) -> None:
        self._port, self._may_move = port, may_move
        self.name = port.name
        self._line = ""
        self.refused: list[str] = []

    def read(self) -> bytes:
        """Reading is free."""
        return self._port.read()

    def write(self, data: bytes) -> int:
        """Hand bytes on; a line is looked at as it grows, so that its end never leaves when it is refused. Raises GuardError."""
        lines = (self._line + REALTIME.sub(b"", data).decode("ascii", "replace").upper()).split("\n")
        for line in [*lines[:-1], LAST_WORD.sub("", lines[-1])]:  # a last word may be longer than what came of it
            if self.is_refused(line):
                self.refused.append(line)
                raise GuardError(f"refused to send {line!r} on a bench")
        taken = self._port.write(data)
        self._line = (self._line + REALTIME.sub(b"", data[:taken]).decode("ascii", "replace").upper()).split("\n")[-1]
        return taken

    def is_refused(self, line: str) -> bool:
        """Whether a line, or its beginning, asks for light, or for motion that is not permitted."""
        bare = re.sub(r"\([^)]*\)|;.*", "", line)
        if LIGHT_WORDS.search(re.sub(r"\s", "", bare)) is not None:
            return True
        return not self._may_move and (MOTION_WORDS.search(bare) is not None or AXIS_WORDS.search(bare) is not None)

    def queued(self) -> int:
        """Bytes that wait in the operating system."""
        return self._port.queued()

    def discard_output(self) -> None:
        """Drop what waits; the line that was begun is gone with it."""
        self._port.discard_output()
        self._line = ""

    def close(self) -> None:
        """Give the port back."""
        self._port.close()

    def fileno(self) -> int | None:
        """Of the port."""
        return self._port.fileno()
