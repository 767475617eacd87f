"""Learns how soon light follows the permit: the power read back crosses half of what is set, on and off each by itself."""

from __future__ import annotations

from collections.abc import Sequence

from drivers.modbus.crossing import Crossing
from drivers.modbus.device import DeviceClient

LONGEST_TIMEOUTS = 20.0  # of a request: a laser that takes longer is told by other means
LEAST_SHARE = 0.02  # of the greatest power: below it a read-back tells no edge


class LaserEdges:
    """Watches a laser whose light the permit alone gates. Where a wired gate stands between, the permit tells nothing: `is_gated`."""

    def __init__(self, client: DeviceClient) -> None:
        self._client = client
        self._crossing = Crossing(LONGEST_TIMEOUTS * client.device.timeout_s)
        self._least_w = LEAST_SHARE * (client.device.registers["power_setpoint"].max or 0.0)
        self.is_gated = False

    @property
    def is_waiting(self) -> bool:
        """Whether an edge is on its way."""
        return self._crossing.is_open

    def wrote(self, names: Sequence[str], began_at: float, ended_at: float) -> None:
        """The permit was written: an edge comes if there is power behind it."""
        if "emission_permit" not in names or self.is_gated:
            if "enable" in names:
                self._crossing.drop()
            return
        client, is_on = self._client, bool(self._client.desired["emission_permit"])
        shown_w = client.value("power_readback")
        power_w = client.desired["power_setpoint"] if is_on else shown_w
        comes = power_w > self._least_w and (shown_w < self._least_w if is_on else True) and bool(client.desired["enable"])
        if comes:
            edge = client.latency.rise if is_on else client.latency.fall
            self._crossing.begin(edge, began_at, 0.5 * power_w, is_rising=is_on)
        else:
            self._crossing.drop()

    def read(self, names: Sequence[str], began_at: float, ended_at: float) -> None:
        """The power was read back."""
        if "power_readback" in names:
            self._crossing.read(self._client.value("power_readback"), began_at, ended_at)
