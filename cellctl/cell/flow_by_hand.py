"""Powder and gas for a while, by hand: behind a laser that is read back locked out, and shut again whatever happens."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cellctl.cell.preconditions import check_devices
from cellctl.cell.refusal import READINESS, Refused
from cellctl.cell.transaction import Step, Transaction
from cellctl.domain.messages import Command
from cellctl.domain.reactions import REACTIONS
from cellctl.domain.states import State, Trigger, after
from drivers.cell_wires import CellDrivers

if TYPE_CHECKING:
    from cellctl.cell.controller import Controller

AT_PLACE = 0.5  # mm or deg by which the machine may stand off the cell file's purge place


class FlowByHand:
    """One purge (powder and gas) or gas test at a time. Leaving PURGING by any way commands the feeder safe (Controller.go)."""

    def __init__(self, controller: Controller) -> None:
        self._c = controller
        self._until: float | None = None
        self._ended = ""
        self._steps: Transaction | None = None
        self._then: Transaction | None = None
        self._seconds = 0.0

    @property
    def left_s(self) -> float:
        """For how long it still flows (s)."""
        return max(self._until - self._c.times.wire.now(), 0.0) if self._until is not None else 0.0

    def begin(self, command: Command, drivers: CellDrivers) -> float:
        """Start; the seconds that it will take at the nozzle. Raises Refused, WrongStateError."""
        c, facts = self._c, self._c.cell.by_hand
        after(c.state, Trigger.PURGE)
        seconds, powder = _number(command, "seconds", 5.0), _number(command, "powder_g_min", 0.0)
        carrier, shield = _number(command, "carrier_l_min", facts.purge_carrier_l_min), _number(command, "shield_l_min", facts.purge_shield_l_min)
        if not 0.0 < seconds <= facts.purge_max_s:
            raise Refused(f"purge: {seconds:g} s asked, at most {facts.purge_max_s:g} s", "ask for less; it can be done again")
        if powder > 0.0 and carrier <= 0.0:
            raise Refused("purge: powder needs carrier gas", "ask for carrier gas with it")
        _check_bounds(drivers, {"rate_setpoint": powder, "carrier_gas_setpoint": carrier, "shield_gas_setpoint": shield})
        self._check(drivers)
        self._check_place(drivers)
        c.hand.lock("powder or gas by hand")
        drivers.laser.safe()
        what = f"powder at {powder:g} g/min" if powder > 0.0 else "gas"
        self._ended, self._until, self._then = "", None, None
        self._steps = Transaction([*self._on(carrier, shield), *(c.modes.powder(powder) if powder > 0.0 else [])])
        self._seconds = seconds
        c.go(Trigger.PURGE, command.because or f"{what} for {seconds:g} s")
        c.event("purge", f"{what} for {seconds:g} s by {command.who}", {"powder_g_min": powder, "seconds": seconds, "who": command.who})
        return seconds

    def _on(self, carrier: float, shield: float) -> list[Step]:
        modes = self._c.modes
        wanted = [(True, carrier), (False, shield)]
        return [modes.laser_off("powder or gas by hand"), self._c.gate.step(), *(modes.gas(*each) for each in wanted if each[1] > 0.0)]

    def _check(self, drivers: CellDrivers) -> None:
        facts = self._c.cell.by_hand
        if not facts.purge_with_door_open:
            check_devices(drivers, for_job=False)
        elif drivers.io.client.is_stale("estop_ok") or not drivers.io.estop_ok:
            raise Refused("purge: the E-stop is pressed, or the I/O coupler does not answer", REACTIONS["estop"].remedy, READINESS)
        if drivers.feeder.is_stale or drivers.feeder.faults:
            told = "; ".join(drivers.feeder.faults) or "it does not answer"
            raise Refused(f"purge: the powder feeder: {told}", "remove the cause at the device; `reset` clears what it has latched", READINESS)

    def _check_place(self, drivers: CellDrivers) -> None:
        facts, status = self._c.cell.by_hand, drivers.cnc.status
        if not facts.purge_place:
            return
        self._c.position.check()
        machine = status.machine if status is not None else {}
        off = {letter: at for letter, at in facts.places[facts.purge_place].items() if abs(machine.get(letter, 1e9) - at) > AT_PLACE}
        if off:
            where = ", ".join(f"{letter} {at:g}" for letter, at in off.items())
            raise Refused(f"purge: the head is not over its place: {where} is wanted", f"send the machine to {facts.purge_place} first")

    def end(self, because: str) -> None:
        """Shut now. Harmless without one."""
        if self._c.state is State.PURGING:
            self._ended = self._ended or because

    def advance(self, now: float) -> None:
        """Called by every tick in PURGING. Raises StepFailedError."""
        c = self._c
        if self._then is not None:
            c.transaction = self._then
            if self._then.advance(now):
                self._until = self._then = None
                c.go(Trigger.PURGED, f"powder and gas are shut: {self._ended}")
            return
        if not self._ended and self._steps is not None:
            c.transaction = self._steps
            if self._steps.advance(now):
                self._steps, self._until, c.transaction = None, now + self._seconds, None
        if not self._ended and self._until is not None and now >= self._until:
            self._ended = "its time is over"
        if self._ended:
            self._then = Transaction([c.modes.powder_off(), c.modes.gas_off()])


def _number(command: Command, name: str, usual: float) -> float:
    value = command.args.get(name)
    if value is None:
        return usual
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value < 1e6:
        raise Refused(f"purge: {name} is {value!r}", "give a number, not below 0")
    return float(value)


def _check_bounds(drivers: CellDrivers, asked: dict[str, float]) -> None:
    for name, value in asked.items():
        register = drivers.feeder.client.device.registers[name]
        if register.max is not None and value > register.max:
            raise Refused(f"purge: {name} {value:g} {register.unit}, at most {register.max:g} {register.unit}", "ask for less")
