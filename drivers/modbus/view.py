"""What the views of all Modbus devices share: the cycle, the age of what was read, the last error and the faults."""

from __future__ import annotations

from typing import ClassVar

from drivers.errors import DriverError
from drivers.modbus.device import DeviceClient


class DeviceView:
    """Thin view of one device's registers. Setters take effect at the next cycle (the client's `wake` is set).

    SHOWN : registers whose readings the view shows; the oldest of them is the view's age.
    """

    SHOWN: ClassVar[tuple[str, ...]] = ()

    def __init__(self, client: DeviceClient) -> None:
        self.client = client

    def safe(self) -> None:
        """Want every output at its safe value; they go first in the next cycle."""
        self.client.safe()

    async def cycle(self) -> None:
        """Write, read and compare once; errors are in `last_error`."""
        await self.client.cycle()

    @property
    def age_s(self) -> float:
        """Age of the oldest reading, s (infinite: never read)."""
        return self.client.oldest(self.SHOWN)

    @property
    def is_stale(self) -> bool:
        """Whether one of the readings is older than its limit."""
        return any(self.client.is_stale(name) for name in self.SHOWN)

    @property
    def connected(self) -> bool:
        """Whether the device answers."""
        return self.client.connected

    @property
    def last_error(self) -> DriverError | None:
        """What went wrong in the last cycle."""
        return self.client.last_error

    @property
    def faults(self) -> list[str]:
        """Texts of the device's own fault word if it has one, of wrong values read back and of a heartbeat that is not followed."""
        own = self.client.flags("fault_word") if "fault_word" in self.SHOWN else []
        return own + self.client.faults
