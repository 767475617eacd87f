"""What drivers ask of the world: a clock, a port that takes and gives bytes without waiting, a Modbus line."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from config.device import Table


class Clock(Protocol):
    """Time, handed in."""

    def now(self) -> float:
        """Seconds since an arbitrary start; never goes back."""

    async def sleep(self, seconds: float) -> None:
        """Return after `seconds`."""


class BytePort(Protocol):
    """A serial line. Nothing here ever waits; every method raises LinkLost when the line is gone."""

    name: str

    def read(self) -> bytes:
        """All bytes that have come in; empty if there are none."""

    def write(self, data: bytes) -> int:
        """Hand bytes to the operating system; the number that it took (0 when its queue is full)."""

    def queued(self) -> int:
        """Bytes that the operating system holds and the line has not yet taken."""

    def discard_output(self) -> None:
        """Drop what the operating system still holds."""

    def close(self) -> None:
        """Give the line back. Twice is harmless."""

    def fileno(self) -> int | None:
        """Descriptor that becomes readable when bytes come in; None for a line without one."""


class ModbusLink(Protocol):
    """One Modbus line: a TCP connection, or a serial line that several devices share. One request at a time."""

    name: str

    @property
    def connected(self) -> bool:
        """Whether the line is open."""

    async def connect(self) -> None:
        """Open the line; harmless when open. Raises PortAbsent, PortBusy or PortDenied."""

    async def read(self, device_id: int, table: Table, address: int, count: int) -> list[int]:
        """`count` values (16-bit words, or bits as 0/1) from `address`.

        Raises LinkLost, DeviceSilent, DeviceFault (Modbus exception) or WrongAnswer (count or function differ).
        """

    async def write(
        self, device_id: int, table: Table, address: int, values: list[int], sending: Callable[[], None] | None = None
    ) -> None:
        """Write 16-bit words (holding) or bits (coil) from `address`. sending : called as the request goes out. Raises as `read`."""

    async def close(self) -> None:
        """Close the line after the request in flight has ended. Twice is harmless."""
