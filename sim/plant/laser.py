"""The laser: enable chain, set-point, hard-wired gate and interlocks, and a first-order ramp."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from config import Device
from sim.plant.signals import Signals

Floats = NDArray[np.float64]

ESTOP_OPEN, DOOR_OPEN, COOLING_LOW, FIBRE_OPEN = 1, 2, 4, 8
OVER_TEMPERATURE, BACK_REFLECTION, POWER_MODULE = 2, 4, 8
EMISSION_W = 1.0  # below it the emission contact is open
ROOM_DEG_C = 22.0
HEATING_DEG_PER_W = 0.008
HEATING_S = 60.0


@njit(cache=True)
def ramp(power: float, level: float, gates: Floats, dt: Floats, tau: float, mean: Floats) -> float:
    """Mean power of each piece into `mean` for a first-order laser that follows level * gate; returns the power at the end."""
    for k in range(len(dt)):
        goal = level * gates[k]
        if tau <= 0.0 or dt[k] <= 0.0:
            power = goal
            mean[k] = goal
            continue
        decay = np.exp(-dt[k] / tau)
        mean[k] = goal + (power - goal) * tau / dt[k] * (1.0 - decay)
        power = goal + (power - goal) * decay
    return power


class Laser(Signals):
    """Emits when enabled, permitted, gated, free of faults and with every interlock closed. Interlocks are wires, not software."""

    def __init__(self, device: Device, ramp_s: float, has_gate: bool) -> None:
        super().__init__(device)
        self.ramp_s = ramp_s
        self.has_gate = has_gate
        self.gate = not has_gate
        self.interlocks = 0
        self.fibre_is_open = False
        self.power_w = 0.0
        self.mean_power_w = 0.0
        self.temperature_deg_c = ROOM_DEG_C

    @property
    def level_w(self) -> float:
        """Power that an open gate lets out now."""
        ready = self.values["enable"] and self.values["emission_permit"] and not self.interlocks and not self.faults
        return self.values["power_setpoint"] if ready else 0.0

    @property
    def emission_w(self) -> float:
        """Emitted power now."""
        return self.power_w

    @property
    def is_emitting(self) -> bool:
        """Whether light comes out."""
        return self.power_w > EMISSION_W

    @property
    def is_pilot_lit(self) -> bool:
        """Whether the aiming beam comes out: asked for, with the E-stop chain closed and the power stage off."""
        return bool(self.values.get("pilot", 0.0)) and not self.interlocks & ESTOP_OPEN and not self.values["enable"]

    def set_interlocks(self, estop_ok: bool, door_closed: bool, flow_ok: bool) -> None:
        """Levels of the hard-wired interlocks. One open: emission is cut at once, and enable and permit have to be given again."""
        word = (0 if estop_ok else ESTOP_OPEN) | (0 if door_closed else DOOR_OPEN) | (0 if flow_ok else COOLING_LOW)
        self.interlocks = word | (FIBRE_OPEN if self.fibre_is_open else 0)
        if self.interlocks:
            self.cut()

    def cut(self) -> None:
        """Pump current off: no light within microseconds, enable chain open."""
        self.power_w = self.mean_power_w = 0.0
        self.values["enable"] = self.values["emission_permit"] = 0.0
        self.show()

    def restart(self) -> None:
        """Started anew: dark, and what hangs on wires shows as it is."""
        super().restart()
        self.cut()

    def fail(self, bits: int) -> None:
        """Latch fault bits."""
        self.faults |= bits
        self.cut()

    def step(self, gates: Floats, dt: Floats, wire_dt_s: float) -> Floats:
        """Let the pieces of a step go by (gates and dt (k,)). Returns the mean emission of each piece, W."""
        self.watch(wire_dt_s)
        if self.faults:
            self.cut()
        mean = np.zeros(len(dt))
        level = self.level_w
        if self.power_w or level:
            self.power_w = float(ramp(self.power_w, level, gates, dt, self.ramp_s, mean))
            if self.power_w < 1e-6:
                self.power_w = 0.0
        total = float(dt.sum())
        self.mean_power_w = float(mean @ dt) / total if total else self.power_w
        warm = ROOM_DEG_C + HEATING_DEG_PER_W * self.mean_power_w
        self.temperature_deg_c += (warm - self.temperature_deg_c) * (1.0 - float(np.exp(-total / HEATING_S)))
        if len(gates):
            self.gate = bool(gates[-1])
        self.show()
        return mean

    def show(self) -> None:
        """Bring the read-backs up to date."""
        values = self.values
        values["power_readback"] = self.power_w
        values["emission"] = float(self.is_emitting)
        values["interlock_word"] = float(self.interlocks)
        values["fault_word"] = float(self.faults)
        for name, value in (
            ("power_setpoint_readback", values["power_setpoint"]),
            ("temperature", self.temperature_deg_c),
        ):
            if name in values:
                values[name] = value
