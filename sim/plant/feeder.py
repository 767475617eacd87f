"""The powder feeder: hopper, transport delay to the nozzle, settling of the flow, carrier and shield gas."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from config import Device
from sim.plant.signals import Signals

Floats = NDArray[np.float64]

HOPPER_EMPTY, CLOGGED, MOTOR_OVERLOAD = 2, 4, 8
GAS_S = 0.15  # time constant of a mass flow controller
CARRIER_MIN_L_MIN = 1.0  # below it the powder stays in the hose
TRICKLE_G_MIN = 1e-3  # below it the nozzle is dry


class Feeder(Signals):
    """Powder at the nozzle follows the feeder's disc by a delay and a first-order lag. The rate read-back is a sensor at the nozzle."""

    def __init__(self, device: Device, hopper_g: float, transport_s: float, settle_s: float) -> None:
        super().__init__(device)
        self.capacity_g = self.hopper_g = hopper_g
        self.transport_s, self.settle_s = transport_s, settle_s
        self.is_clogged = False
        self.gas_pressure_ok = True
        self.rate_at_nozzle_g_min = 0.0
        self.carrier_l_min = self.shield_l_min = 0.0
        self._time_s = 0.0
        self._in_hose: deque[tuple[float, float]] = deque()  # arrival time, rate
        self._fed_g_min = 0.0
        self._arriving_g_min = 0.0

    def write(self, name: str, value: float) -> None:
        """A value from the wire; the rate shows back at once in its read-back register."""
        super().write(name, value)
        self.show()

    def reset_faults(self) -> None:
        """Faults whose cause persists stay."""
        self.faults = (HOPPER_EMPTY if self.hopper_g <= 0.0 else 0) | (CLOGGED if self.is_clogged else 0)

    def restart(self) -> None:
        """Started anew: the disc stands; what is in the hose still arrives."""
        super().restart()
        self.show()

    @property
    def hopper_fraction(self) -> float:
        """Fill of the hopper, 0 to 1."""
        return self.hopper_g / self.capacity_g

    def _feed(self) -> float:
        """Rate at the feeder's disc now, g/min."""
        if self.hopper_g <= 0.0:
            self.faults |= HOPPER_EMPTY
        if self.is_clogged:
            self.faults |= CLOGGED
        flows = self.carrier_l_min >= CARRIER_MIN_L_MIN
        return self.values["rate_setpoint"] if flows and not self.faults else 0.0

    def step(self, dt: Floats, wire_dt_s: float) -> Floats:
        """Let the pieces of a step go by (dt (k,)). Returns the powder rate at the nozzle in each piece, g/min."""
        self.watch(wire_dt_s)
        total = float(dt.sum())
        share = 1.0 - math.exp(-total / GAS_S)
        supply = float(self.gas_pressure_ok)
        self.carrier_l_min += (self.values["carrier_gas_setpoint"] * supply - self.carrier_l_min) * share
        self.shield_l_min += (self.values["shield_gas_setpoint"] * supply - self.shield_l_min) * share
        fed = self._feed()
        if fed != self._fed_g_min:
            self._in_hose.append((self._time_s + self.transport_s, fed))
            self._fed_g_min = fed
        self.hopper_g = max(self.hopper_g - fed * total / 60.0, 0.0)
        if self.is_clogged:
            self._in_hose.clear()
            self._arriving_g_min = 0.0
        steady = not self._in_hose and abs(self._arriving_g_min - self.rate_at_nozzle_g_min) < TRICKLE_G_MIN
        if steady:
            self.rate_at_nozzle_g_min = self._arriving_g_min
            self._time_s += total
            rates = np.full(len(dt), self.rate_at_nozzle_g_min)
        else:
            rates = np.array([self._flow(float(piece)) for piece in dt])
        self.show()
        return np.zeros(len(dt)) if self.is_diverted else rates

    @property
    def is_diverted(self) -> bool:
        """Whether a diverter leads the powder to the bypass, so that none comes out of the nozzle."""
        return bool(self.values.get("diverter", 0.0))

    def _flow(self, dt: float) -> float:
        """Powder rate averaged over one piece, g/min; follows what arrives through the hose within it."""
        left, amount = dt, 0.0
        while left > 0.0:
            part = left
            if self._in_hose:
                wait = self._in_hose[0][0] - self._time_s
                if wait <= 1e-12:
                    self._arriving_g_min = self._in_hose.popleft()[1]
                    continue
                part = min(left, wait)
            decay = math.exp(-part / self.settle_s)
            gap = self.rate_at_nozzle_g_min - self._arriving_g_min
            amount += self._arriving_g_min * part + gap * self.settle_s * (1.0 - decay)
            self.rate_at_nozzle_g_min = self._arriving_g_min + gap * decay
            self._time_s += part
            left -= part
        return amount / dt if dt else self.rate_at_nozzle_g_min

    def show(self) -> None:
        """Bring the read-backs up to date."""
        values = self.values
        values["rate_readback"] = self.rate_at_nozzle_g_min
        values["carrier_gas_readback"] = self.carrier_l_min
        values["shield_gas_readback"] = self.shield_l_min
        values["hopper_level"] = self.hopper_fraction
        values["fault_word"] = float(self.faults)
        if "rate_setpoint_readback" in values:
            values["rate_setpoint_readback"] = values["rate_setpoint"]
