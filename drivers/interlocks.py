"""The I/O coupler by names: interlock levels and the head's slide."""

from __future__ import annotations

from typing import ClassVar

from drivers.modbus.view import DeviceView

LEVELS = ("estop_ok", "door_closed", "chiller_ok", "gas_pressure_ok", "fume_extraction_ok", "head_deployed", "head_parked")


class Io(DeviceView):
    """Thin view of the coupler's registers. A stale or never read level is the unsafe one: False."""

    SHOWN: ClassVar[tuple[str, ...]] = (*LEVELS, "heartbeat_readback")

    def deploy_head(self) -> None:
        """Want the deposition head at its working position."""
        self.client.set("head_deploy", 1.0)

    def park_head(self) -> None:
        """Want the deposition head out of the way."""
        self.client.set("head_deploy", 0.0)

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
