"""Doors, E-stop chain, chiller, gas bottle, extraction, and the slide that deploys and parks the deposition head."""

from __future__ import annotations

from config import Device
from sim.plant.signals import Signals

SLIDE_TRAVEL_S = 1.0
COUNTS = 65536
COUNTED = {
    "estop_openings": "estop_ok", "door_openings": "door_closed", "chiller_openings": "chiller_ok", "gas_pressure_openings": "gas_pressure_ok",
    "fume_extraction_openings": "fume_extraction_ok",
}  # fmt: skip
"""Register of the coupler that counts -> contact, whose openings it counts since power-up."""


class InputsOutputs(Signals):
    """Levels of the cell's contacts. The slide's place is 0 parked to 1 deployed."""

    def __init__(self, device: Device) -> None:
        super().__init__(device)
        self.estop_ok = self.door_closed = self.chiller_ok = True
        self.gas_pressure_ok = self.fume_extraction_ok = True
        self.slide = 0.0
        self._was: dict[str, bool] = {}
        self.show()

    @property
    def is_deployed(self) -> bool:
        """Whether the head's slide is at its outer stop."""
        return self.slide >= 1.0

    @property
    def is_parked(self) -> bool:
        """Whether the head's slide is at its inner stop."""
        return self.slide <= 0.0

    def restart(self) -> None:
        """Started anew: outputs as at power-up, contacts as they are."""
        super().restart()
        self.show()

    def step(self, dt_s: float, wire_dt_s: float) -> None:
        """Let time go by; without E-stop chain the slide has no power and stays."""
        self.watch(wire_dt_s)
        if self.estop_ok:
            way = dt_s / SLIDE_TRAVEL_S
            self.slide = min(self.slide + way, 1.0) if self.values["head_deploy"] else max(self.slide - way, 0.0)
        self.show()

    def show(self) -> None:
        """Bring the contacts up to date, and count those that have opened."""
        for register, contact in COUNTED.items():
            is_closed = bool(getattr(self, contact))
            if register in self.values and self._was.get(contact, is_closed) and not is_closed:
                self.values[register] = (self.values[register] + 1.0) % COUNTS
            self._was[contact] = is_closed
        self.values.update(
            estop_ok=float(self.estop_ok), door_closed=float(self.door_closed), chiller_ok=float(self.chiller_ok),
            gas_pressure_ok=float(self.gas_pressure_ok), fume_extraction_ok=float(self.fume_extraction_ok),
            head_deployed=float(self.is_deployed), head_parked=float(self.is_parked),
        )  # fmt: skip
