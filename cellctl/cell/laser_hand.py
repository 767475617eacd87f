"""The safety tick's hand on the laser: permit and power, given and taken nowhere else."""

from __future__ import annotations

from cellctl.domain.overrides import Overrides
from drivers.cell_wires import CellDrivers
from drivers.interfaces import Clock


class LaserHand:
    """The only hand on permit and power. `apply` is called by every tick with the verdict of the permissives."""

    def __init__(self, drivers: CellDrivers, clock: Clock) -> None:
        self._laser = drivers.laser
        self._clock = clock
        self.power_wanted_w = 0.0
        self.factor = 1.0
        self.overrides = Overrides()  # of the run
        self.is_permitted = False
        self.dark_since = clock.now()
        self.because = ""

    def apply(self, may_emit: bool, because: str, *, is_arming: bool = False) -> None:
        """Permit with the wanted power, or neither; arming: the power alone, because the permit is about to come."""
        if not may_emit:
            self._take(because, self._power_w if is_arming else 0.0)
            return
        self._laser.set_power(self._power_w)
        self._laser.permit(True)
        self.is_permitted = True
        self.because = ""

    @property
    def _power_w(self) -> float:
        return self.overrides.laser_w(self.power_wanted_w) * self.factor

    @property
    def dark_in_s(self) -> float:
        """Seconds until a laser that cannot be told is dark by its own dead-man; 0 for one that answers or was dark before.

        So long the tip has to go on moving: light at standstill burns a hole.
        """
        client = self._laser.client
        is_heard = client.last_error is None or client.age("emission") <= client.device.timeout_s
        was_dark = not self.is_permitted and self._clock.now() - self.dark_since > client.device.dead_man_s
        return 0.0 if is_heard or was_dark else client.trips_in_s

    def lock(self, because: str) -> None:
        """Permit and power off, now. Harmless twice."""
        self._take(because, 0.0)

    def _take(self, because: str, power_w: float) -> None:
        if self.is_permitted:
            self.dark_since = self._clock.now()
        self.is_permitted = False
        self.because = because
        self._laser.permit(False)
        self._laser.set_power(power_w)
