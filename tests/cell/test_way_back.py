"""A guarded sequence that fails is undone, last step first, each undoing verified; after reset and resume it is done from its beginning."""

from __future__ import annotations

from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall


def free_head(cell: CellUnderTest) -> None:
    """What jammed the head's slide is gone."""
    del cell.sim.io.step


async def test_a_laser_that_cannot_be_enabled_leaves_the_head_parked_the_gas_shut_and_says_so(cell: CellUnderTest) -> None:
    laser = cell.sim.laser
    await cell.start(one_wall(cell.facts, layers=1, mill=False))
    await cell.forward(until=lambda: "powder to flow" in cell.snapshot.waiting, seconds=20)
    assert cell.sim.io.is_deployed and laser.values["enable"] == 1.0
    cell.sim.feeder._feed = lambda: 4.0  # type: ignore[method-assign]  # a clog that no word of flags tells
    await cell.hurry(cell.is_state(State.FAULT), scale=1.5)
    del cell.sim.feeder._feed
    await cell.forward(until=lambda: cell.controller.way_back is None, seconds=30)
    assert cell.sim.io.is_parked and laser.values["enable"] == laser.values["emission_permit"] == 0.0
    assert cell.sim.feeder.rate_at_nozzle_g_min < 0.3
    assert cell.sim.feeder.values["carrier_gas_setpoint"] == cell.sim.feeder.values["shield_gas_setpoint"] == 0.0
    told = cell.snapshot.alarms[0].cause
    assert "undone: switching the laser off" in told and "NOT undone" not in told
    await cell.forward(ticks=20)
    assert cell.has_event("rollback", "waiting for powder to stop")
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.HELD), seconds=10)
    assert (await cell.command("resume")).ok
    await cell.hurry(lambda: cell.outcome != "", scale=5.0)
    assert cell.outcome == "completed" and cell.max_standstill_emission_w == 0.0


async def test_what_cannot_be_undone_is_told(cell: CellUnderTest) -> None:
    cell.jam_head()
    await cell.start(one_wall(cell.facts, layers=1, mill=False))
    await cell.forward(until=cell.is_state(State.FAULT), seconds=15)
    cell.sim.io.slide = 0.5
    cell.sim.open_door()
    await cell.forward(until=lambda: cell.controller.way_back is None, seconds=30)
    told = cell.snapshot.alarms[0].cause
    assert "NOT undone: parking the deposition head (the door is open)" in told
    assert cell.sim.laser.values["enable"] == 0.0


async def test_a_head_that_is_freed_after_the_fault_deploys_at_the_next_try(cell: CellUnderTest) -> None:
    cell.jam_head()
    await cell.start(one_wall(cell.facts, layers=1, mill=False))
    await cell.forward(until=cell.is_state(State.FAULT), seconds=15)
    free_head(cell)
    await cell.forward(until=lambda: cell.controller.way_back is None, seconds=30)
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.HELD), seconds=10)
    assert (await cell.command("resume")).ok
    await cell.hurry(lambda: cell.outcome != "", scale=5.0)
    assert cell.outcome == "completed"


async def test_no_cut_begins_before_the_spindle_turns_as_programmed(cell: CellUnderTest) -> None:
    machine = cell.sim.cnc.machine
    await cell.start(one_wall(cell.facts, layers=1, pieces=2, length_mm=8.0))
    await cell.hurry(lambda: "checking" in cell.snapshot.waiting and machine.tool == 2, scale=2.0)
    assert b"N13 G1" not in cell.wires.port.sent or machine.spindle_rpm > 0
    await cell.hurry(lambda: cell.outcome != "", scale=5.0)
    assert cell.outcome == "completed"


async def test_the_wrong_cutter_behind_a_tool_change_never_reaches_the_part(cell: CellUnderTest) -> None:
    machine = cell.sim.cnc.machine
    await cell.start(one_wall(cell.facts, layers=1, pieces=2, length_mm=8.0))
    await cell.hurry(lambda: machine.is_changing_tool and cell.sim.io.is_parked, scale=2.0)
    machine._finish = lambda: setattr(machine, "_timed", None)  # type: ignore[method-assign]  # an empty gripper
    await cell.forward(until=cell.is_state(State.FAULT), seconds=40)
    assert cell.latched == ["tool"] and cell.sim.cnc.machine.motion.speed == 0.0
