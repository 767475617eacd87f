"""What was read from one device, and how old it is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from config.device import Device
from drivers.interfaces import Clock
from drivers.modbus.registers import Span, meanings


@dataclass(frozen=True, slots=True)
class Reading:
    """A value in the register's unit, and the clock time before the request that brought it was sent."""

    value: float
    at: float


class Readings:
    """The last reading of each register, in the register's unit."""

    def __init__(self, device: Device, clock: Clock) -> None:
        self.device = device
        self.clock = clock
        self.readings: dict[str, Reading] = {}

    def value(self, name: str) -> float:
        """Last reading, register's unit; NaN if it was never read."""
        reading = self.readings.get(name)
        return math.nan if reading is None else reading.value

    def age(self, name: str) -> float:
        """Seconds since the reading; infinite if it was never read."""
        reading = self.readings.get(name)
        return math.inf if reading is None else self.clock.now() - reading.at

    def is_stale(self, name: str) -> bool:
        """Whether the reading is older than the register's stale limit."""
        return self.age(name) > self.device.registers[name].stale_s

    def patience_s(self, spans: Sequence[Span], takes_s: float, write_s: float) -> float:
        """How long reading may be put off for one write until the first of these spans, read one after another, is about to go stale (s)."""
        left = sorted(min(self.device.registers[name].stale_s - self.age(name) for name in span.names) for span in spans)
        return min((each - write_s - (k + 1) * takes_s for k, each in enumerate(left)), default=0.0)

    def oldest(self, names: Iterable[str]) -> float:
        """Greatest age of several readings, s."""
        return max((self.age(name) for name in names), default=math.inf)

    def flags(self, name: str) -> list[str]:
        """Texts of the bits that are set in a word of flags."""
        return meanings(name, self.device.registers[name], self.value(name))
