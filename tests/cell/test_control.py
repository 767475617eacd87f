"""One client commands, others watch; taking over is explicit and recorded; a stop needs no control."""

from __future__ import annotations

from cellctl.domain.messages import Command, Reply
from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall


async def say(cell: CellUnderTest, verb: str, client: str, because: str = "test", **args: object) -> Reply:
    command = Command(f"{client}-{next(cell.ids)}", verb, client, because, dict(args), client)
    reply = await cell.commands.handle(command)
    await cell.forward(ticks=2)
    return reply


async def test_the_first_command_takes_control_and_another_clients_is_refused_by_the_holders_name(cell: CellUnderTest) -> None:
    assert cell.snapshot.control is None
    assert (await say(cell, "home", "anna")).ok
    await cell.forward(until=cell.is_state(State.IDLE), seconds=20)
    refused = await say(cell, "jog", "bert", axis="X", distance=5.0, feed=600.0)
    assert not refused.ok and refused.kind == "control" and "anna has control" in refused.error and refused.hint
    held = cell.snapshot.control
    assert held is not None and held.holder == "anna" and cell.state is State.IDLE
    assert cell.has_event("control", "anna takes control")


async def test_a_stop_needs_no_control(cell: CellUnderTest) -> None:
    await cell.deposit()
    assert (await say(cell, "stop", "bert")).ok
    await cell.forward(ticks=10)
    assert cell.state is State.STOPPED and cell.is_dark


async def test_taking_over_needs_a_reason_and_is_written_down(cell: CellUnderTest) -> None:
    await say(cell, "take_control", "anna")
    assert not (await say(cell, "take_control", "bert", because=" ")).ok
    assert (await say(cell, "take_control", "bert", because="anna went home")).ok
    assert not (await say(cell, "home", "anna")).ok
    await cell.forward(ticks=20)
    assert cell.has_event("control", "bert takes control over from anna, because anna went home")


async def test_a_holder_that_is_not_heard_is_told_absent_and_keeps_control(cell: CellUnderTest) -> None:
    await say(cell, "take_control", "anna")
    cell.clock.advance(cell.facts.by_hand.control_absent_s + 1.0)
    held = cell.snapshot.control
    assert held is not None and held.absent
    assert "not heard for" in (await say(cell, "home", "bert")).error
    assert (await say(cell, "present", "anna")).ok
    held = cell.snapshot.control
    assert held is not None and not held.absent


async def test_control_outlives_the_cell_process(cell: CellUnderTest) -> None:
    await say(cell, "take_control", "anna")
    await cell.end()
    await cell.power_up()
    assert not (await say(cell, "home", "bert")).ok


async def test_a_jog_ends_when_control_goes_to_another(cell: CellUnderTest) -> None:
    await say(cell, "jog", "anna", axis="X", distance=200.0, feed=3000.0)
    await cell.forward(ticks=40)
    await say(cell, "take_control", "bert", because="it goes the wrong way")
    await cell.forward(until=cell.is_state(State.IDLE), seconds=2)
    assert 0.0 < cell.sim.joints[0] < 100.0


async def test_a_confirmed_table_counts_until_something_moves_or_a_stop_is_pressed(cell: CellUnderTest) -> None:
    program = cell.programs["job-1"] = one_wall(cell.facts, layers=1, mill=False)
    start = {"job": "job-1", "name": program.part_name, "program": "job-1"}
    await cell.forward(ticks=10)
    before = cell.unix()
    await cell.command("jog", axis="X", distance=2.0, feed=3000.0)
    await cell.forward(until=cell.is_state(State.IDLE), seconds=3)
    refused = await cell.command("start", **start, confirmed_at=before)
    assert refused.kind == "table" and "the machine moved" in refused.error and cell.state is State.IDLE
    await cell.forward(ticks=10)
    assert (await cell.command("start", **start, confirmed_at=cell.unix())).ok


async def test_a_start_while_a_wire_is_gone_says_that_the_cell_was_not_ready(cell: CellUnderTest) -> None:
    program = cell.programs["job-1"] = one_wall(cell.facts, layers=1, mill=False)
    cell.sim.faults.add("modbus_silent feeder")
    await cell.forward(until=cell.is_state(State.OFFLINE), seconds=3)
    confirmed_at = cell.unix()
    start = {"job": "job-1", "name": program.part_name, "program": "job-1", "confirmed_at": confirmed_at}
    assert (await cell.command("start", **start)).kind == "readiness"
    cell.sim.faults.add("modbus_silent feeder 0")
    await cell.forward(until=cell.is_state(State.IDLE), seconds=5)
    assert (await cell.command("start", **start)).ok
