"""The I/O coupler by names: interlock levels and the head's slide."""

from __future__ import annotations

from drivers.modbus.device import DeviceClient


class Io:
    """Thin view of the coupler's registers. A stale level reads as unsafe (False)."""

    def __init__(self, client: DeviceClient) -> None:
        self.client = client

    estop_ok: bool
    door_closed: bool
    chiller_ok: bool
    gas_pressure_ok: bool
    fume_extraction_ok: bool
    head_deployed: bool
    head_parked: bool
    age_s: float
    connected: bool
    faults: list[str]

    def deploy_head(self) -> None: ...
    def park_head(self) -> None: ...
    def safe(self) -> None: ...
    async def cycle(self) -> None: ...
