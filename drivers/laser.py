"""The laser by names: enable chain, set-point, emission, interlock and fault words."""

from __future__ import annotations

from typing import ClassVar

from drivers.laser_edges import LaserEdges
from drivers.modbus.device import DeviceClient
from drivers.modbus.view import DeviceView


class Laser(DeviceView):
    """Thin view of a laser's registers. Setters take effect at the next cycle (the client's `wake` is set)."""

    SHOWN: ClassVar[tuple[str, ...]] = ("power_readback", "emission", "interlock_word", "fault_word", "heartbeat_readback")

    def __init__(self, client: DeviceClient) -> None:
        super().__init__(client)
        self.edges = LaserEdges(client)
        client.watcher = self.edges

    def enable(self, on: bool) -> None:
        """Want the power stage on or off; emission needs the permit besides."""
        self.client.set("enable", float(on))

    def permit(self, on: bool) -> None:
        """Want emission permitted or not."""
        self.client.set("emission_permit", float(on))

    @property
    def has_pilot(self) -> bool:
        """Whether the laser has an aiming beam that can be switched."""
        return "pilot" in self.client.device.registers

    def pilot(self, on: bool) -> None:
        """Want the aiming beam on or off. A laser without one has nothing to switch."""
        if self.has_pilot:
            self.client.set("pilot", float(on))

    @property
    def is_pilot_on(self) -> bool:
        """Whether the aiming beam is wanted on."""
        return bool(self.client.desired.get("pilot", 0.0))

    def set_power(self, watts: float) -> None:
        """Want this power, W. Raises RangeError_ beyond the laser's bounds."""
        self.client.set("power_setpoint", watts)

    def reset_faults(self) -> None:
        """Ask the laser to leave its latched faults."""
        self.client.pulse("fault_reset")

    @property
    def power_setpoint_w(self) -> float:
        """Power that is wanted, W."""
        return self.client.desired["power_setpoint"]

    @property
    def power_readback_w(self) -> float:
        """Power that the laser says it emits, W (NaN: never read)."""
        return self.client.value("power_readback")

    @property
    def is_enabled(self) -> bool:
        """Whether the power stage is wanted on."""
        return bool(self.client.desired["enable"])

    @property
    def is_permitted(self) -> bool:
        """Whether emission is wanted permitted."""
        return bool(self.client.desired["emission_permit"])

    @property
    def is_emitting(self) -> bool:
        """Whether the laser says that it emits; a stale reading says yes, as the unsafe case."""
        return self.client.is_stale("emission") or self.client.value("emission") != 0.0

    @property
    def interlocks(self) -> list[str]:
        """Texts of the interlocks that are open."""
        return self.client.flags("interlock_word")
