"""What every Modbus device has: values by register name, and the dead-man that turns its outputs safe."""

from __future__ import annotations

from config import Device

HEARTBEAT_FAULT = 1


class Signals:
    """Values of one device, in units, by the names of its register map. Subclasses give them physics.

    The dead-man: a heartbeat register that does not change for dead_man_s of wire time. Outputs that are not safe then become safe.
    """

    def __init__(self, device: Device) -> None:
        self.device = device
        self.values = {name: 0.0 for name in device.registers}
        self.safe = {name: register.safe for name, register in device.registers.items() if register.safe is not None}
        self.values.update(self.safe)
        self.watches_heartbeat = True
        self.faults = 0
        self._beat_age_s = float("inf")

    @property
    def is_alive(self) -> bool:
        """Whether the host's heartbeat is young enough."""
        return not self.watches_heartbeat or self._beat_age_s <= self.device.dead_man_s

    def write(self, name: str, value: float) -> None:
        """A value from the wire, in units."""
        if name == "heartbeat":
            if value != self.values["heartbeat"]:
                self._beat_age_s = 0.0
            self.values["heartbeat_readback"] = value
        self.values[name] = value
        if name == "fault_reset" and value:
            self.values["fault_reset"] = 0.0
            self.reset_faults()

    def reset_faults(self) -> None:
        """Clear latched faults whose cause is gone."""
        self.faults = 0

    def restart(self) -> None:
        """The device has lost power and starts anew: registers at their power-up values, nothing latched, no heartbeat heard."""
        self.values = {name: 0.0 for name in self.device.registers}
        self.values.update(self.safe)
        self.faults = 0
        self._beat_age_s = float("inf")

    def outputs_safe(self) -> None:
        """All set-points to their safe values."""
        for name, value in self.safe.items():
            if name != "heartbeat":
                self.values[name] = value

    @property
    def is_safe(self) -> bool:
        """Whether every output has its safe value."""
        return all(self.values[name] == value for name, value in self.safe.items() if name != "heartbeat")

    def watch(self, wire_dt_s: float) -> None:
        """Let the wire's time go by for the dead-man."""
        self._beat_age_s += wire_dt_s
        if not self.is_alive and not self.is_safe:
            self.outputs_safe()
            self.faults |= HEARTBEAT_FAULT
