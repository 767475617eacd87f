"""Learns how long powder takes through the hose: from a new rate to its first change in the rate read back."""

from __future__ import annotations

from collections.abc import Sequence

from drivers.modbus.crossing import Crossing
from drivers.modbus.device import DeviceClient

LONGEST_S = 30.0  # a hose of some metres takes seconds
FIRST_SHARE = 0.1  # of the step: a change that is no noise of the sensor
LEAST_STEP_G_MIN = 1.0


class HoseDelay:
    """Watches steps of a feeder's rate. Where its read-back is measured at the feeder itself, it tells nothing of the hose."""

    def __init__(self, client: DeviceClient) -> None:
        self._client = client
        self._crossing = Crossing(LONGEST_S)
        self._told = 0.0

    @property
    def is_waiting(self) -> bool:
        """A hose is slow: readings at the usual period tell it well enough."""
        return False

    def wrote(self, names: Sequence[str], began_at: float, ended_at: float) -> None:
        """A rate was written."""
        if "rate_setpoint" not in names:
            return
        goal, shown = self._client.desired["rate_setpoint"], self._client.value("rate_readback")
        if goal == self._told:
            return
        before, self._told = self._told, goal
        is_steady = abs(shown - before) <= FIRST_SHARE * max(abs(goal - before), LEAST_STEP_G_MIN)
        if is_steady and abs(goal - shown) >= LEAST_STEP_G_MIN:
            level = shown + FIRST_SHARE * (goal - shown)
            self._crossing.begin(self._client.latency.transport, began_at, level, is_rising=goal > shown)
        else:
            self._crossing.drop()

    def read(self, names: Sequence[str], began_at: float, ended_at: float) -> None:
        """The rate was read back."""
        if "rate_readback" in names:
            self._crossing.read(self._client.value("rate_readback"), began_at, ended_at)
