"""The I/O coupler by names: interlock levels and the head's slide."""

from __future__ import annotations

from drivers.errors import DriverError
from drivers.modbus.device import DeviceClient

LEVELS = ("estop_ok", "door_closed", "chiller_ok", "gas_pressure_ok", "fume_extraction_ok", "head_deployed", "head_parked")
SHOWN = (*LEVELS, "heartbeat_readback")


class Io:
    """Thin view of the coupler's registers. A stale or never read level is the unsafe one: False."""

    def __init__(self, client: DeviceClient) -> None:
        self.client = client

    def deploy_head(self) -> None:
        """Want the deposition head at its working position."""
        self.client.set("head_deploy", 1.0)

    def park_head(self) -> None:
        """Want the deposition head out of the way."""
        self.client.set("head_deploy", 0.0)

    def safe(self) -> None:
        """Want every output at its safe value."""
        self.client.safe()

    async def cycle(self) -> None:
        """Write, read and compare once; errors are in `last_error`."""
        await self.client.cycle()

    def level(self, name: str) -> bool:
        """A level, False when its reading is stale."""
        return not self.client.is_stale(name) and self.client.value(name) != 0.0

    @property
    def estop_ok(self) -> bool:
        """Whether the E-stop chain is closed."""
        return self.level("estop_ok")

    @property
    def door_closed(self) -> bool:
        """Whether the door is closed."""
        return self.level("door_closed")

    @property
    def chiller_ok(self) -> bool:
        """Whether the chiller runs."""
        return self.level("chiller_ok")

    @property
    def gas_pressure_ok(self) -> bool:
        """Whether there is gas pressure."""
        return self.level("gas_pressure_ok")

    @property
    def fume_extraction_ok(self) -> bool:
        """Whether the fume extraction runs."""
        return self.level("fume_extraction_ok")

    @property
    def head_deployed(self) -> bool:
        """Whether the head is confirmed at its working position."""
        return self.level("head_deployed")

    @property
    def head_parked(self) -> bool:
        """Whether the head is confirmed out of the way."""
        return self.level("head_parked")

    @property
    def is_deploying(self) -> bool:
        """Whether the head is wanted at its working position."""
        return bool(self.client.desired["head_deploy"])

    @property
    def age_s(self) -> float:
        """Age of the oldest reading, s (infinite: never read)."""
        return self.client.oldest(SHOWN)

    @property
    def is_stale(self) -> bool:
        """Whether one of the readings is older than its limit."""
        return any(self.client.is_stale(name) for name in SHOWN)

    @property
    def connected(self) -> bool:
        """Whether the coupler answers."""
        return self.client.connected

    @property
    def last_error(self) -> DriverError | None:
        """What went wrong in the last cycle."""
        return self.client.last_error

    @property
    def faults(self) -> list[str]:
        """Wrong values read back and a heartbeat that is not followed."""
        return self.client.faults
