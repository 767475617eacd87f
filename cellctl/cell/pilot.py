"""The aiming beam: on for a while, at rest or while a hand moves the machine, and off as soon as anything else goes on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cellctl.cell.preconditions import check_devices, signal_of
from cellctl.cell.refusal import Refused
from cellctl.domain.states import State
from drivers.cell_wires import CellDrivers

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller

AT_REST = frozenset({State.IDLE, State.UNHOMED, State.JOGGING})
HINT = "the aiming beam is for a cell that is IDLE, UNHOMED or JOGGING"


class Pilot:
    """Wants the beam on until a time; `advance` takes it away at the tick at which one of its conditions is gone."""

    def __init__(self, controller: Controller) -> None:
        self._c = controller
        self._until: float | None = None  # wire time, s

    @property
    def left_s(self) -> float:
        """For how long it will stay on (s); 0: it is off."""
        return max(self._until - self._c.times.wire.now(), 0.0) if self._until is not None else 0.0

    def turn_on(self, drivers: CellDrivers, seconds: float | None) -> None:
        """On for so many seconds, at most the cell file's pilot_max_s. Raises Refused."""
        longest = self._c.cell.by_hand.pilot_max_s
        if not drivers.laser.has_pilot:
            raise Refused("pilot: this laser has no aiming beam that can be switched", "add the coil `pilot` to its register map if it has one")
        if seconds is not None and not 0.0 < seconds <= longest:
            raise Refused(f"pilot: {seconds:g} s asked, at most {longest:g} s", "ask for less; it can be switched on again")
        why = self._why_not(drivers)
        if why:
            raise Refused(f"pilot: {why}", HINT)
        if not self._c.cell.by_hand.pilot_with_door_open:
            check_devices(drivers, for_job=False)
        drivers.laser.pilot(True)
        self._until = self._c.times.wire.now() + (seconds if seconds is not None else longest)
        self._c.event("pilot", f"aiming beam on for {self.left_s:.0f} s", {"on": True})

    def turn_off(self, because: str) -> None:
        """Off. Harmless twice."""
        drivers = self._c.drivers
        if drivers is not None and drivers.laser.is_pilot_on:
            drivers.laser.pilot(False)
        if self._until is not None:
            self._until = None
            self._c.event("pilot", f"aiming beam off: {because}", {"on": False, "because": because})

    def advance(self, now: float) -> None:
        """Called by every tick, before anything else acts."""
        drivers = self._c.drivers
        if drivers is None or (self._until is None and not drivers.laser.is_pilot_on):
            return
        why = "its time is over" if self._until is None or now >= self._until else self._why_not(drivers)
        if why:
            self.turn_off(why)
        else:
            drivers.laser.pilot(True)  # a jog that begins commands the laser safe, and the beam with it

    def _why_not(self, drivers: CellDrivers) -> str:
        c = self._c
        if c.state not in AT_REST:
            return f"the cell is {c.state.value}"
        if drivers.laser.is_enabled or drivers.laser.is_permitted:
            return "the laser is enabled"
        names = ("estop_ok",) if c.cell.by_hand.pilot_with_door_open else ("estop_ok", "door_closed")
        for name in names:
            signal = signal_of(drivers.io.client, name)
            if not signal.is_fresh:
                return "the I/O coupler does not answer"
            if not signal.value:
                return "the door is open" if name == "door_closed" else "the E-stop is pressed"
        return ""
