"""One Modbus device by its register map: what is wanted, what was read, and whether both agree."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

from config.device import Device
from drivers.errors import DriverError
from drivers.interfaces import Clock, ModbusLink


@dataclass(frozen=True, slots=True)
class Reading:
    """A value in the register's unit, and the clock time before the request that brought it was sent."""

    value: float
    at: float


class DeviceClient:
    """A device on a Modbus link; `cycle` never raises a DriverError but keeps it in `last_error`."""

    readings: dict[str, Reading]
    desired: dict[str, float]
    wake: asyncio.Event
    connected: bool
    last_error: DriverError | None
    faults: list[str]

    def __init__(self, device: Device, device_id: int, link: ModbusLink, clock: Clock) -> None: ...

    def set(self, name: str, value: float) -> None:
        """Want `value` (register's unit) from the next cycle on; bounds checked now. Raises RangeError_."""

    def safe(self) -> None:
        """Want every writable register at its safe value."""

    def pulse(self, name: str) -> None:
        """Set a bit for one write, then clear it (fault reset)."""

    def value(self, name: str) -> float:
        """Last reading (NaN if never read)."""
        raise NotImplementedError

    def age(self, name: str) -> float:
        """Seconds since the reading (inf if never)."""
        raise NotImplementedError

    def is_stale(self, name: str) -> bool:
        """Whether the reading is older than the register's stale limit."""
        raise NotImplementedError

    async def cycle(self) -> None:
        """Connect if need be, write what changed and the heartbeat (safe direction first), read all, verify read-backs."""
