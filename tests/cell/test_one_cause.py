"""One physical cause is told by several wires, in any order; the operator gets one alarm, the same for every order."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations

import pytest

from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall

Contact = Callable[[CellUnderTest], None]
APART_TICKS = 15  # contacts that open so far apart: longer than a reading of any wire, shorter than the stale limits


def io_level(name: str) -> Contact:
    def open_contact(cell: CellUnderTest) -> None:
        setattr(cell.sim.io, name, False)
        cell.sim.io.show()

    return open_contact


def laser_chain(estop_ok: bool, door_closed: bool, flow_ok: bool) -> Contact:
    return lambda cell: cell.sim.laser.set_interlocks(estop_ok, door_closed, flow_ok)


DOOR: dict[str, Contact] = {
    "coupler": io_level("door_closed"),
    "laser": laser_chain(True, False, True),
    "cnc": lambda cell: cell.sim.cnc.machine.door(True),
}
ESTOP: dict[str, Contact] = {
    "coupler": io_level("estop_ok"),
    "laser": laser_chain(False, True, True),
    "cnc": lambda cell: cell.sim.cnc.estop(True),
}
CHILLER: dict[str, Contact] = {"coupler": io_level("chiller_ok"), "laser": laser_chain(True, True, False)}


async def open_in_order(cell: CellUnderTest, contacts: dict[str, Contact], order: tuple[str, ...]) -> None:
    for name in order:
        contacts[name](cell)
        await cell.forward(ticks=APART_TICKS)
        assert cell.is_dark
        assert cell.state is State.FAULT, f"{name} alone stops the cell"
    await cell.forward(seconds=1.0)
    assert cell.is_still
    if order[0] != "cnc":  # a CNC that brakes by itself is heard with its next report, the laser's own contact is at once
        assert cell.max_standstill_emission_w == 0.0


@pytest.mark.parametrize("order", list(permutations(DOOR)), ids="-".join)
async def test_an_opened_door_is_told_as_an_open_door_whichever_wire_tells_it_first(
    cell: CellUnderTest, order: tuple[str, ...]
) -> None:
    await cell.deposit(mill=False)
    await open_in_order(cell, DOOR, order)
    (alarm,) = cell.snapshot.alarms
    assert (alarm.code, alarm.cause) == ("door", "The door is open")
    assert alarm.remedy == "close the door, reset, then resume or abort"
    assert cell.snapshot.because == "The door is open"
    cell.sim.close_door()
    await cell.forward(ticks=APART_TICKS)
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.HELD), seconds=5)
    if order != tuple(DOOR):  # the rest of the job is the same after each
        return
    assert (await cell.command("resume")).ok
    await cell.hurry(cell.is_state(State.IDLE), scale=4.0)
    assert (cell.outcome, cell.latched) == ("completed", [])


@pytest.mark.parametrize("order", list(permutations(ESTOP)), ids="-".join)
async def test_a_pressed_estop_is_told_as_an_estop_whichever_wire_tells_it_first(
    cell: CellUnderTest, order: tuple[str, ...]
) -> None:
    await cell.deposit(mill=False)
    await open_in_order(cell, ESTOP, order)
    (alarm,) = cell.snapshot.alarms
    assert (alarm.code, alarm.cause) == ("estop", "The emergency stop chain is open")
    assert cell.snapshot.because == alarm.cause
    assert cell.outcome == "interrupted"
    assert not (await cell.command("reset")).ok
    cell.sim.release_estop()
    await cell.forward(seconds=0.5)
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.UNHOMED), seconds=10)
    assert cell.latched == []


@pytest.mark.parametrize("order", list(permutations(CHILLER)), ids="-".join)
async def test_a_chiller_that_fails_is_told_as_such_whichever_wire_tells_it_first(
    cell: CellUnderTest, order: tuple[str, ...]
) -> None:
    await cell.deposit(mill=False)
    await open_in_order(cell, CHILLER, order)
    assert cell.latched == ["chiller"]
    assert cell.snapshot.because == cell.snapshot.alarms[0].cause


@pytest.mark.parametrize("is_flow_first", [True, False])
async def test_a_gas_bottle_that_runs_empty_is_told_as_low_pressure_though_powder_stops_with_it(
    cell: CellUnderTest, is_flow_first: bool
) -> None:
    await cell.deposit(length_mm=120.0, pieces=20, mill=False)
    if is_flow_first:
        cell.sim.feeder.gas_pressure_ok = False  # the feeder starves before the switch at the bottle opens
        await cell.forward(until=cell.is_state(State.FAULT), seconds=8.0)
        assert cell.latched == ["powder_flow"]
    cell.sim.faults.add("gas_low")
    await cell.forward(seconds=4.0)
    assert cell.latched == ["gas_pressure"]


async def test_a_door_that_is_opened_and_closed_between_two_readings_is_told_by_the_cnc(cell: CellUnderTest) -> None:
    await cell.deposit(mill=False)
    cell.sim.cnc.machine.door(True)
    cell.sim.cnc.machine.door(False)
    await cell.forward(ticks=APART_TICKS)
    assert cell.latched == ["door"]


async def test_an_interlock_that_opens_long_after_a_fault_is_no_cause_of_it(cell: CellUnderTest) -> None:
    await cell.deposit(mill=False)
    CHILLER["laser"](cell)
    await cell.forward(seconds=2.0)
    assert cell.latched == ["laser_interlock"]
    CHILLER["coupler"](cell)
    await cell.forward(seconds=1.0)
    assert cell.latched == ["laser_interlock"]


async def test_a_second_cause_beside_an_open_door_is_an_alarm_of_its_own(cell: CellUnderTest) -> None:
    await cell.deposit(mill=False)
    cell.sim.laser.fibre_is_open = True
    DOOR["laser"](cell)
    await cell.forward(ticks=APART_TICKS)
    assert sorted(cell.latched) == ["door", "laser_interlock"]
    texts = {alarm.code: alarm.cause for alarm in cell.snapshot.alarms}
    assert "fibre" in texts["laser_interlock"] and "door" not in texts["laser_interlock"]


async def test_a_limit_switch_hit_as_the_estop_is_pressed_stays_an_alarm_of_its_own(cell: CellUnderTest) -> None:
    await cell.deposit(mill=False)
    cell.sim.faults.add("alarm 1")
    await cell.forward(ticks=APART_TICKS)
    cell.sim.press_estop()
    await cell.forward(ticks=APART_TICKS)
    assert sorted(cell.latched) == ["cnc_alarm", "estop"]


async def test_reset_with_a_door_contact_of_the_laser_that_stays_open_fails_and_says_which_wire(
    cell: CellUnderTest,
) -> None:
    await cell.deposit(mill=False)
    DOOR["laser"](cell)
    await cell.forward(seconds=1.0)
    assert cell.latched == ["door"]
    for _ in range(2):
        assert (await cell.command("reset")).ok
        await cell.forward(until=cell.is_state(State.FAULT), seconds=8)
        assert cell.latched == ["door", "step_failed"]
        assert "the laser's interlock chain says door interlock open" in cell.snapshot.alarms[-1].cause
        assert "look at its contacts" in cell.snapshot.alarms[-1].remedy
    laser_chain(True, True, True)(cell)
    await cell.forward(ticks=APART_TICKS)
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.HELD), seconds=5)


async def test_reset_while_the_devices_fault_lasts_fails_with_that_fault_and_can_be_tried_again(
    cell: CellUnderTest,
) -> None:
    await cell.deposit(mill=False)
    cell.sim.faults.add("feeder_clog")
    await cell.forward(seconds=1.0)
    assert cell.latched == ["feeder_fault"]
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.FAULT), seconds=8)
    assert cell.latched == ["feeder_fault"]
    cell.sim.faults.add("feeder_clear")
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.HELD), seconds=8)


async def test_alarms_that_were_merged_are_one_alarm_again_after_the_process_was_killed(cell: CellUnderTest) -> None:
    await cell.start(one_wall(cell.facts, mill=False))
    await cell.hurry(cell.is_depositing)
    await open_in_order(cell, CHILLER, ("laser", "coupler"))
    await cell.forward(ticks=20)
    await cell.kill()
    await cell.power_up(until_idle=False)
    assert sorted(cell.latched) == ["chiller", "restarted"]
