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
        self._read_at: dict[Span, float] = {}
        self._lasts_s: dict[Span, float] = {}

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

    def keep(self, span: Span, values: Iterable[float], at: float) -> None:
        """Every register of a span was read, in the register's unit, by a request that was sent at wire time `at` (s)."""
        for name, value in zip(span.names, values, strict=True):
            self.readings[name] = Reading(value, at)
        self._read_at[span] = at

    def lasts_s(self, span: Span) -> float:
        """The shortest stale limit in a span, s."""
        limit_s = self._lasts_s.get(span)
        if limit_s is None:
            limit_s = self._lasts_s[span] = min(self.device.registers[name].stale_s for name in span.names)
        return limit_s

    def urgency(self, span: Span) -> float:
        """Age of a span's readings in its shortest stale limit; infinite if it was never read."""
        at = self._read_at.get(span)
        return math.inf if at is None else (self.clock.now() - at) / self.lasts_s(span)

    def patience_s(self, spans: Sequence[Span], takes_s: float, write_s: float) -> float:
        """How long reading may be put off for one write until the first of these spans, read one after another, is about to go stale (s)."""
        now = self.clock.now()
        left = sorted(self._read_at.get(span, -math.inf) + self.lasts_s(span) - now for span in spans)
        return min((each - write_s - (k + 1) * takes_s for k, each in enumerate(left)), default=0.0)

    def oldest(self, names: Iterable[str]) -> float:
        """Greatest age of several readings, s."""
        return max((self.age(name) for name in names), default=math.inf)

    def flags(self, name: str) -> list[str]:
        """Texts of the bits that are set in a word of flags."""
        return meanings(name, self.device.registers[name], self.value(name))
