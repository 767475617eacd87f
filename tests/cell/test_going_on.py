"""Before motion goes on after a hold, a fault or a wrong tool, the cell is set up and verified anew, as if for the first time."""

from __future__ import annotations

from cellctl.domain.states import State
from planner.program import Program
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall

SPINDLE_STOP = b"\x9e"


def short(cell: CellUnderTest, *, layers: int = 1, mill: bool = True) -> Program:
    return one_wall(cell.facts, layers=layers, pieces=2, length_mm=8.0, mill=mill)


async def mill_and_hold(cell: CellUnderTest) -> None:
    """Start a job and hold it in the middle of its milling pass."""
    motion = cell.sim.cnc.machine.motion
    assert (await cell.start(short(cell))).ok
    await cell.hurry(lambda: cell.sim.cnc.machine.tool == 2 and cell.sim.cnc.machine.spindle_rpm > 5900.0, scale=3.0)
    await cell.hurry(lambda: cell.state is State.RUNNING and motion.speed > 0.0, scale=2.0)
    assert (await cell.command("hold")).ok
    await cell.forward(until=cell.is_state(State.HELD), seconds=5)


async def reset_and_resume(cell: CellUnderTest) -> None:
    await cell.forward(until=lambda: cell.controller.way_back is None and not cell.controller.quiesce_pending, seconds=30)
    await cell.forward(seconds=0.5)
    reply = await cell.command("reset")
    assert reply.ok, reply.error
    await cell.forward(until=cell.is_state(State.HELD), seconds=10)
    reply = await cell.command("resume")
    assert reply.ok, reply.error


async def ends(cell: CellUnderTest) -> str:
    await cell.hurry(lambda: cell.outcome != "", scale=5.0)
    assert cell.max_standstill_emission_w == 0.0
    return cell.outcome


async def test_a_cut_goes_on_only_with_the_spindle_at_its_speed(cell: CellUnderTest) -> None:
    machine = cell.sim.cnc.machine
    await mill_and_hold(cell)
    cell.wires.port.write(SPINDLE_STOP)  # somebody stops it while the job is held
    await cell.forward(until=lambda: machine.spindle_rpm == 0.0, seconds=10)
    await cell.command("resume")
    await cell.forward(until=lambda: machine.motion.speed > 0.0, seconds=20)
    assert machine.spindle_rpm > 5000.0
    assert await ends(cell) == "completed"


async def test_another_tool_found_in_the_middle_of_a_cut_ends_the_job_before_anything_moves(cell: CellUnderTest) -> None:
    await mill_and_hold(cell)
    cell.sim.cnc.machine.tool = 3
    await cell.command("resume")
    await cell.forward(until=cell.is_state(State.FAULT), seconds=10)
    assert cell.latched == ["tool"] and cell.is_still
    await cell.forward(until=lambda: cell.outcome != "", seconds=5)
    assert cell.outcome == "failed"


async def test_a_held_spindle_that_never_gets_to_speed_is_stopped_on_the_way_back_and_let_go_at_the_next_try(cell: CellUnderTest) -> None:
    machine = cell.sim.cnc.machine
    await mill_and_hold(cell)
    machine.spindle_override = 0.5  # a slipping belt
    await cell.forward(seconds=3)
    await cell.command("resume")
    await cell.forward(until=cell.is_state(State.FAULT), seconds=30)
    assert cell.is_still and "spindle" in cell.snapshot.alarms[0].cause
    await cell.forward(until=lambda: machine.spindle_rpm == 0.0, seconds=10)
    machine.spindle_override = 1.0
    await reset_and_resume(cell)
    assert await ends(cell) == "completed"


async def test_the_wrong_tool_found_before_a_pass_holds_the_job_until_it_is_put_right(cell: CellUnderTest) -> None:
    machine = cell.sim.cnc.machine
    finish = machine._finish
    machine._finish = lambda: setattr(machine, "_timed", None)  # type: ignore[method-assign]  # an empty gripper
    machine.tool = 3
    await cell.start(short(cell, mill=False))
    await cell.forward(until=cell.is_state(State.FAULT), seconds=20)
    assert cell.latched == ["tool"] and cell.outcome == ""
    await reset_and_resume(cell)
    await cell.forward(until=cell.is_state(State.FAULT), seconds=20)  # it is checked again
    assert cell.burnt_lines == set()
    machine._finish, machine.tool = finish, 1  # type: ignore[method-assign]
    await reset_and_resume(cell)
    assert await ends(cell) == "completed"


async def test_a_moved_datum_found_before_a_pass_holds_the_job_until_it_is_put_right(cell: CellUnderTest) -> None:
    offset = cell.sim.cnc.interpreter.offsets.systems[540]
    await cell.start(short(cell, mill=False))
    offset[2] += 1.0
    await cell.forward(until=cell.is_state(State.FAULT), seconds=20)
    assert cell.latched == ["datum"] and cell.outcome == ""
    offset[2] -= 1.0
    await reset_and_resume(cell)
    assert await ends(cell) == "completed"


async def test_what_a_way_back_undid_is_done_again_where_only_powder_was_waited_for(cell: CellUnderTest) -> None:
    feeder = cell.sim.feeder
    await cell.start(short(cell, layers=2, mill=False))
    await cell.hurry(lambda: cell.snapshot.job is not None and cell.snapshot.job.layer == 1 and cell.state is State.PREPARING, scale=2.0)
    assert cell.sim.io.is_deployed
    feeder._feed = lambda: 4.0  # type: ignore[method-assign]  # a clog
    await cell.hurry(cell.is_state(State.FAULT), scale=1.5)
    del feeder._feed
    await cell.forward(until=lambda: cell.controller.way_back is None, seconds=30)
    assert cell.sim.io.is_parked
    await reset_and_resume(cell)
    assert await ends(cell) == "completed"


async def test_a_job_held_while_it_is_prepared_stands_dark_and_without_powder_and_is_prepared_anew(cell: CellUnderTest) -> None:
    laser, feeder = cell.sim.laser, cell.sim.feeder
    await cell.start(short(cell, layers=2, mill=False))
    await cell.hurry(lambda: cell.snapshot.job is not None and cell.snapshot.job.layer == 1 and cell.state is State.PREPARING, scale=2.0)
    assert (await cell.command("hold")).ok
    await cell.forward(seconds=4)
    assert cell.state is State.HELD and cell.is_still and cell.is_dark
    assert laser.values["emission_permit"] == 0.0 and feeder.rate_at_nozzle_g_min < 0.3
    assert (await cell.command("resume")).ok
    assert await ends(cell) == "completed"
