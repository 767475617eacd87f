"""What is wanted of one device: set-points within their bounds, the safe ones, and pulses."""

from __future__ import annotations

import asyncio

from config.device import Device
from drivers.errors import RangeError_
from drivers.interfaces import Clock
from drivers.modbus.registers import check_range
from drivers.modbus.turn import Turn
from drivers.modbus.written import HEARTBEAT, Written


class Wanted(Written):
    """Whoever sets something wakes the line: what was set goes out as soon as the request on the wire has ended."""

    def __init__(self, device: Device, clock: Clock, turn: Turn) -> None:
        super().__init__(device, clock)
        self.wake = asyncio.Event()
        self.turn = turn
        self._safe = dict(self.desired)
        self._pulses: set[str] = set()
        self._ebbing: set[str] = set()  # pulses that were written: safe again from the next cycle on

    def set(self, name: str, value: float) -> None:
        """Want `value` (register's unit) from the next cycle on. Raises RangeError_; then nothing changes."""
        register = self.device.registers.get(name)
        if register is None or name == HEARTBEAT:
            raise RangeError_(f"{self.device.name}: {name} cannot be set", "name a set-point of its register map")
        check_range(self.device.name, name, register, value)
        if self.desired[name] != value:
            self.desired[name] = float(value)
            self._wake()

    def safe(self) -> None:
        """Want every register that can be written at its safe value; it goes first in the next cycle."""
        self._pulses.clear()
        if self.desired != self._safe:
            self.desired.update(self._safe)
            self._wake()

    def _wake(self) -> None:
        self.wake.set()
        self.turn.wake.set()

    def due(self, at: float | None) -> None:
        """A set-point will be set at wire time `at` (s): no reading stands in its way then."""
        self.turn.expect(self, at)

    def pulse(self, name: str) -> None:
        """Write 1 once and its safe value at the cycle after. Raises RangeError_."""
        self.set(name, 1.0)
        self._pulses.add(name)

    def _ebb(self) -> None:
        self.desired.update({name: self._safe[name] for name in self._ebbing})
        self._ebbing.clear()
