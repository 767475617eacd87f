"""The powder feeder by names: rate, carrier and shield gas, hopper."""

from __future__ import annotations

from drivers.modbus.device import DeviceClient


class Feeder:
    """Thin view of a feeder's registers."""

    def __init__(self, client: DeviceClient) -> None:
        self.client = client

    rate_setpoint_g_min: float
    rate_readback_g_min: float
    carrier_gas_setpoint_l_min: float
    carrier_gas_readback_l_min: float
    shield_gas_setpoint_l_min: float
    shield_gas_readback_l_min: float
    hopper_fraction: float
    age_s: float
    connected: bool
    faults: list[str]

    def set_rate(self, g_min: float) -> None: ...
    def set_carrier_gas(self, l_min: float) -> None: ...
    def set_shield_gas(self, l_min: float) -> None: ...
    def reset_faults(self) -> None: ...
    def safe(self) -> None: ...
    async def cycle(self) -> None: ...
