"""The powder feeder by names: rate, carrier and shield gas, hopper."""

from __future__ import annotations

from typing import ClassVar

from drivers.hose_delay import HoseDelay
from drivers.modbus.device import DeviceClient
from drivers.modbus.view import DeviceView


class Feeder(DeviceView):
    """Thin view of a feeder's registers. Setters take effect at the next cycle (the client's `wake` is set)."""

    SHOWN: ClassVar[tuple[str, ...]] = (
        "rate_readback", "carrier_gas_readback", "shield_gas_readback", "hopper_level", "fault_word", "heartbeat_readback",
    )  # fmt: skip

    def __init__(self, client: DeviceClient) -> None:
        super().__init__(client)
        client.watcher = HoseDelay(client)

    def set_rate(self, g_min: float) -> None:
        """Want this powder rate, g/min. Raises RangeError_ beyond the feeder's bounds."""
        self.client.set("rate_setpoint", g_min)

    def set_carrier_gas(self, l_min: float) -> None:
        """Want this carrier gas flow, L/min. Raises RangeError_."""
        self.client.set("carrier_gas_setpoint", l_min)

    def set_shield_gas(self, l_min: float) -> None:
        """Want this shield gas flow, L/min. Raises RangeError_."""
        self.client.set("shield_gas_setpoint", l_min)

    @property
    def has_diverter(self) -> bool:
        """Whether powder can be led to a bypass while it flows."""
        return "diverter" in self.client.device.registers

    def divert(self, on: bool) -> None:
        """Want powder led to the bypass, or to the nozzle. A feeder without a diverter leads all of it to the nozzle: nothing is done."""
        if self.has_diverter:
            self.client.set("diverter", float(on))

    @property
    def is_diverted(self) -> bool:
        """Whether powder is wanted at the bypass."""
        return bool(self.client.desired.get("diverter", 0.0))

    def reset_faults(self) -> None:
        """Ask the feeder to leave its latched faults."""
        self.client.pulse("fault_reset")

    @property
    def rate_setpoint_g_min(self) -> float:
        """Powder rate that is wanted, g/min."""
        return self.client.desired["rate_setpoint"]

    @property
    def rate_readback_g_min(self) -> float:
        """Powder rate that the feeder measures, g/min (NaN: never read)."""
        return self.client.value("rate_readback")

    @property
    def carrier_gas_setpoint_l_min(self) -> float:
        """Carrier gas that is wanted, L/min."""
        return self.client.desired["carrier_gas_setpoint"]

    @property
    def carrier_gas_readback_l_min(self) -> float:
        """Carrier gas that flows, L/min (NaN: never read)."""
        return self.client.value("carrier_gas_readback")

    @property
    def shield_gas_setpoint_l_min(self) -> float:
        """Shield gas that is wanted, L/min."""
        return self.client.desired["shield_gas_setpoint"]

    @property
    def shield_gas_readback_l_min(self) -> float:
        """Shield gas that flows, L/min (NaN: never read)."""
        return self.client.value("shield_gas_readback")

    @property
    def hopper_fraction(self) -> float:
        """How full the hopper is, 0..1 (NaN: never read)."""
        return self.client.value("hopper_level")
