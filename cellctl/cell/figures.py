"""The figures of a sample: what devices and the CNC were told and tell, in the order of the channels; None where nobody knows."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cellctl.domain.channels import INTERLOCK_BITS
from drivers.cell_wires import CellDrivers

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller

Figure = float | None
OPEN_END = float("inf")


class TickJitter:
    """Largest deviation of the time between two ticks from the period, since it was last taken. period_s : s"""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._last_at: float | None = None
        self._worst_s = 0.0
        self.taken_ms = 0.0  # as it was last taken

    def struck(self, now: float) -> None:
        """A tick at wire time `now` (s)."""
        if self._last_at is not None:
            self._worst_s = max(self._worst_s, abs(now - self._last_at - self._period_s))
        self._last_at = now

    @property
    def worst_ms(self) -> float:
        """Of the ticks since it was taken, and of those before (ms)."""
        return max(self.taken_ms, 1e3 * self._worst_s)

    def take(self) -> float:
        """Of the ticks since it was last taken (ms); begins anew."""
        self.taken_ms, self._worst_s = 1e3 * self._worst_s, 0.0
        return self.taken_ms


def _known(value: float) -> Figure:
    """JSON and SQL have no infinity; NaN: never read."""
    return value if -OPEN_END < value < OPEN_END else None


def _of_devices(d: CellDrivers) -> tuple[Figure, ...]:
    laser, feeder = d.laser, d.feeder
    light = (laser.power_setpoint_w, _known(laser.power_readback_w)) if laser.connected else (None, None)
    if not feeder.connected:
        return *light, None, None, None, None, None, None
    return (
        *light, feeder.rate_setpoint_g_min, _known(feeder.rate_readback_g_min), feeder.carrier_gas_setpoint_l_min,
        _known(feeder.carrier_gas_readback_l_min), feeder.shield_gas_setpoint_l_min, _known(feeder.shield_gas_readback_l_min),
    )  # fmt: skip


def _fill_percent(free: int | None, size: int) -> Figure:
    return None if free is None or size <= 0 else 100.0 * min(max(1.0 - free / size, 0.0), 1.0)


def fills_percent(d: CellDrivers) -> tuple[Figure, Figure]:
    """How full the CNC's planner and its receive buffer are; None where it does not report them."""
    status, identity = d.cnc.status, d.cnc.identity
    if status is None or identity is None:
        return None, None
    return _fill_percent(status.planner_free, identity.planner_blocks), _fill_percent(status.rx_free, identity.rx_bytes)


def _of_cnc(c: Controller, d: CellDrivers, jitter_ms: float) -> tuple[Figure, ...]:
    status = d.cnc.status
    if status is None or not c.is_cnc_alive:
        return None, None, None, jitter_ms, None, None
    last = c.run.follower.last if c.run is not None else None
    speed = c.run.follower.speed_mm_s if c.run is not None and last is not None and last.is_run else 0.0
    return speed, *fills_percent(d), jitter_ms, status.rpm if status.has_rpm else None, float(status.overrides[0])


def figures(c: Controller, d: CellDrivers, jitter_ms: float) -> tuple[Figure, ...]:
    """One for each of domain.channels.NAMES, as the cell stands. jitter_ms : of the tick, since the sample before"""
    overrides = c.run.overrides if c.run is not None else None
    percents = (None, None) if overrides is None else (float(overrides.laser_percent), float(overrides.powder_percent))
    return *_of_devices(d), *_of_cnc(c, d, jitter_ms), *percents


def interlocks(d: CellDrivers) -> int | None:
    """Bits of the levels in domain.channels.INTERLOCK_BITS that are safe; None if the coupler does not answer."""
    io = d.io
    return sum(1 << bit for bit, name in enumerate(INTERLOCK_BITS) if getattr(io, name)) if io.connected else None
