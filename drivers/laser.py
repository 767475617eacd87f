"""The laser by names: enable chain, set-point, emission, interlock and fault words."""

from __future__ import annotations

from drivers.modbus.device import DeviceClient


class Laser:
    """Thin view of a laser's registers. Setters take effect at the next cycle (the client's `wake` is set)."""

    def __init__(self, client: DeviceClient) -> None:
        self.client = client

    power_setpoint_w: float
    power_readback_w: float
    is_enabled: bool
    is_permitted: bool
    is_emitting: bool
    age_s: float
    connected: bool
    faults: list[str]
    interlocks: list[str]

    def enable(self, on: bool) -> None: ...
    def permit(self, on: bool) -> None: ...
    def set_power(self, watts: float) -> None: ...
    def reset_faults(self) -> None: ...
    def safe(self) -> None: ...
    async def cycle(self) -> None: ...
