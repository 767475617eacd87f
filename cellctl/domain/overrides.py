"""Overrides of a running job: laser and powder in percent of what is programmed, within the material's process window."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LEAST_PERCENT, MOST_PERCENT = 10, 200  # what the feed override of firmware has too
AS_PROGRAMMED = 100
SETTLED = 4.0  # time constants of the powder flow until a new rate is there


@dataclass(frozen=True)
class Span:
    """The percentages that keep one channel in its window.

    low, high : the window, in `unit`   programmed : (least, usual, greatest) set-point above zero of the Program, in `unit`
    limit : greatest that the device takes, in `unit`
    """

    what: str
    unit: str
    low: float
    high: float
    programmed: tuple[float, float, float]
    limit: float = math.inf

    @classmethod
    def from_values(cls, what: str, unit: str, window: tuple[float, float], values: NDArray[np.float64], limit: float | None) -> Span | None:
        """The span of a channel whose set-points are `values` (n,), in a window (least, greatest); None where the Program never uses it."""
        used = values[values > 0.0]
        if not len(used):
            return None
        programmed = (float(used.min()), float(np.median(used)), float(used.max()))
        return cls(what, unit, *window, programmed, math.inf if limit is None else limit)

    @property
    def least(self) -> int:
        """Percent at which the usual set-point reaches the window's least; never above 100."""
        return min(max(math.ceil(100.0 * self.low / self.programmed[1] - 1e-9), LEAST_PERCENT), AS_PROGRAMMED)

    @property
    def most(self) -> int:
        """Percent at which the greatest set-point reaches the window's greatest, or the device's; never below 100."""
        return max(min(math.floor(100.0 * min(self.high, self.limit) / self.programmed[2] + 1e-9), MOST_PERCENT), AS_PROGRAMMED)

    def scaled(self, value: float, percent: int) -> float:
        """A set-point at this percentage: it does not leave the window, and one that is programmed outside goes no farther out."""
        if value <= 0.0 or percent == AS_PROGRAMMED:
            return value
        return min(max(value * percent / 100.0, min(self.low, value)), max(min(self.high, self.limit), value))

    def refusal(self, percent: int) -> str:
        """Why this percentage is not taken, with the bound and its unit; empty: it is."""
        if self.least <= percent <= self.most:
            return ""
        if percent > self.most:
            bound, value = f"at most {self.most} %", self.programmed[2]
            edge = f"{min(self.high, self.limit):g} {self.unit} is the greatest"
        else:
            bound, value, edge = f"at least {self.least} %", self.programmed[1], f"{self.low:g} {self.unit} is the least"
        asked = f"{value * percent / 100.0:g} {self.unit}"
        return f"{self.what} {percent} %: {bound} ({value:g} {self.unit} as programmed would be {asked}; {edge} of the material's window)"


class Overrides:
    """What a person has set for one run; every run begins with 100 %. laser, powder : None where the Program uses none of it, or nobody may."""

    def __init__(self, laser: Span | None = None, powder: Span | None = None, *, flow_settles_s: float = 0.0) -> None:
        """flow_settles_s : from a new powder rate until the flow at the nozzle has it"""
        self.laser, self.powder = laser, powder
        self.laser_percent = AS_PROGRAMMED
        self.powder_percent = AS_PROGRAMMED
        self._flow_settles_s = flow_settles_s
        self._powder_before = AS_PROGRAMMED
        self._changed_at = -math.inf

    def laser_w(self, programmed_w: float) -> float:
        """The laser's power for a programmed one (W)."""
        return self.laser.scaled(programmed_w, self.laser_percent) if self.laser is not None else programmed_w

    def powder_g_min(self, programmed_g_min: float) -> float:
        """The powder rate for a programmed one (g/min)."""
        return self.powder.scaled(programmed_g_min, self.powder_percent) if self.powder is not None else programmed_g_min

    def flow_before_g_min(self, programmed_g_min: float, now: float) -> float:
        """The rate that may still come out of the nozzle after a change (g/min); else that of now. now : wire time, s"""
        if self.powder is None or now - self._changed_at > self._flow_settles_s:
            return self.powder_g_min(programmed_g_min)
        return self.powder.scaled(programmed_g_min, self._powder_before)

    def set_powder(self, percent: int, now: float) -> None:
        """Powder in percent, from wire time `now` (s) on."""
        self._powder_before = self.powder_percent if now - self._changed_at > self._flow_settles_s else self._powder_before
        self.powder_percent, self._changed_at = percent, now
