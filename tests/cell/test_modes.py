"""Invariant 7: deposit to mill and back is a guarded transaction; what is not confirmed at the plant does not go on."""

from __future__ import annotations

from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall


async def test_before_the_tool_changes_the_laser_is_off_powder_purged_and_head_parked(cell: CellUnderTest) -> None:
    await cell.start(one_wall(cell.facts, layers=1))
    await cell.hurry(lambda: cell.sim.cnc.machine.is_changing_tool, scale=2.0)
    assert cell.sim.laser.values["enable"] == cell.sim.laser.values["emission_permit"] == 0.0
    assert cell.sim.feeder.rate_at_nozzle_g_min < 0.3
    assert cell.sim.io.is_parked


async def test_a_head_that_does_not_park_keeps_the_cutter_out(cell: CellUnderTest) -> None:
    await cell.start(one_wall(cell.facts, layers=1))
    await cell.hurry(lambda: "purging" in cell.snapshot.waiting, scale=3.0)
    cell.jam_head()
    await cell.forward(until=cell.is_state(State.FAULT), seconds=15)
    assert "parking the deposition head failed" in cell.snapshot.alarms[0].cause
    assert cell.sim.cnc.machine.tool == 1
    assert b"M6 T2" not in cell.wires.port.sent


async def test_a_head_that_does_not_deploy_keeps_the_laser_locked(cell: CellUnderTest) -> None:
    cell.jam_head()
    await cell.start(one_wall(cell.facts, layers=1))
    await cell.forward(until=cell.is_state(State.FAULT), seconds=15)
    assert cell.sim.laser.values["enable"] == 0.0
    assert cell.burnt_lines == set()
    assert b"N3 G1" not in cell.wires.port.sent


async def test_powder_that_never_gets_steady_keeps_the_pass_from_starting(cell: CellUnderTest) -> None:
    await cell.start(one_wall(cell.facts, layers=1))
    await cell.hurry(lambda: "powder to flow" in cell.snapshot.waiting, scale=3.0)
    cell.sim.feeder._feed = lambda: 4.0  # type: ignore[method-assign]  # less than was asked for
    await cell.hurry(cell.is_state(State.FAULT), scale=1.5)
    assert cell.latched == ["powder_flow"]
    assert cell.burnt_lines == set()


async def test_the_wrong_tool_keeps_the_laser_locked(cell: CellUnderTest) -> None:
    cell.sim.cnc.machine._finish = lambda: setattr(cell.sim.cnc.machine, "_timed", None)  # type: ignore[method-assign]  # an empty gripper
    cell.sim.cnc.machine.tool = 3
    await cell.start(one_wall(cell.facts, layers=1))
    await cell.forward(until=cell.is_state(State.FAULT), seconds=20)
    assert cell.latched == ["tool"]
    assert cell.burnt_lines == set()
    assert cell.sim.laser.values["enable"] == 0.0


async def test_a_datum_that_moved_before_the_pass_keeps_the_laser_locked(cell: CellUnderTest) -> None:
    await cell.start(one_wall(cell.facts, layers=1))
    cell.sim.cnc.interpreter.offsets.systems[540][2] += 1.0
    await cell.forward(until=cell.is_state(State.FAULT), seconds=20)
    assert cell.latched == ["datum"]
    assert cell.burnt_lines == set()


async def test_a_head_that_leaves_its_place_while_depositing_ends_the_job(cell: CellUnderTest) -> None:
    await cell.deposit()
    cell.sim.io.slide = 0.5
    cell.jam_head()
    await cell.forward(ticks=5)
    assert cell.is_dark
    assert cell.latched == ["head_position"]


async def test_a_door_opened_before_the_tool_change_holds_the_job_which_then_changes_the_tool_and_ends(cell: CellUnderTest) -> None:
    await cell.start(one_wall(cell.facts, layers=1))
    await cell.hurry(lambda: "purging" in cell.snapshot.waiting, scale=3.0)
    cell.sim.open_door()
    await cell.forward(until=cell.is_state(State.FAULT), seconds=2)
    assert cell.sim.cnc.machine.tool == 1
    await cell.forward(seconds=1)
    cell.sim.close_door()
    await cell.forward(seconds=1)
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.HELD), seconds=10)
    assert (await cell.command("resume")).ok
    await cell.hurry(lambda: cell.outcome != "", scale=5.0)
    assert cell.outcome == "completed" and cell.sim.cnc.machine.tool == 2
