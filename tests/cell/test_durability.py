"""Invariants 5 and 6: accepted things are durable before the answer; after a kill nothing is lost and nothing done twice."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall


def rows(store: Path, query: str) -> list[tuple[object, ...]]:
    with closing(sqlite3.connect(store)) as db, db:
        return db.execute(query).fetchall()


async def test_a_start_that_is_answered_is_in_the_store(cell: CellUnderTest) -> None:
    reply = await cell.start(one_wall(cell.facts), ident="start-7")
    assert reply.ok
    assert rows(cell.store, "SELECT job, total_lines, who, command_id, ended_at FROM cell_runs") == [
        ("job-1", 44, "tester", "start-7", None)
    ]
    commands = rows(cell.store, "SELECT data FROM events WHERE kind = 'command'")
    assert json.loads(str(commands[0][0]))["reply"]["ok"] is True


@pytest.mark.parametrize("lines", [0, 3, 9, 20, 38])
async def test_a_cell_process_killed_at_any_line_leaves_the_job_interrupted_and_the_plant_dark(
    cell: CellUnderTest, lines: int
) -> None:
    program = one_wall(cell.facts)
    await cell.start(program, ident="start-1")
    await cell.hurry(lambda: cell.snapshot.lines.executed >= lines, scale=3.0)
    await cell.forward(ticks=25)
    executed = cell.snapshot.lines.executed
    await cell.kill()
    await cell.forward(seconds=0.55)
    assert cell.is_dark
    assert cell.sim.feeder.values["rate_setpoint"] == 0.0
    known = rows(cell.store, "SELECT last_line, outcome FROM cell_runs")[0]
    assert executed - 2 <= int(str(known[0])) <= executed
    await cell.power_up()
    assert rows(cell.store, "SELECT last_line, outcome FROM cell_runs") == [(executed, "interrupted")]
    assert cell.state is State.FAULT and cell.latched == ["restarted"]
    assert f"last executed line {executed} of 44" in cell.snapshot.alarms[0].cause
    await cell.forward(seconds=3.0)
    assert cell.is_still, "what the machine had buffered does not run on"
    # the client that never got its answer asks again with the same id
    again = await cell.start(program, ident="start-1")
    assert again.ok and again.data["job"] == "job-1"
    assert cell.state is State.FAULT and cell.controller.run is None
    assert len(rows(cell.store, "SELECT job FROM cell_runs")) == 1
    other = await cell.start(program, ident="start-2")
    assert not other.ok
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.IDLE, State.UNHOMED), seconds=10)


async def test_a_job_that_ran_is_not_run_again_under_another_command(cell: CellUnderTest) -> None:
    program = one_wall(cell.facts, layers=1, mill=False)
    await cell.start(program)
    await cell.hurry(cell.is_state(State.IDLE))
    reply = await cell.start(program)
    assert not reply.ok and "job-1 was started before" in reply.error


async def test_a_latched_fault_outlives_the_process_and_leaves_by_reset_alone(cell: CellUnderTest) -> None:
    await cell.deposit()
    cell.sim.faults.add("fume_fail")
    await cell.forward(seconds=1.0)
    await cell.kill()
    await cell.power_up()
    await cell.forward(seconds=2.0)
    assert cell.state is State.FAULT
    assert set(cell.latched) == {"fume_extraction", "restarted"}
    reply = await cell.command("reset")
    assert not reply.ok and "extraction" in reply.error
    cell.sim.faults.add("fume_ok")
    await cell.forward(ticks=10)
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.IDLE, State.UNHOMED), seconds=10)
    await cell.kill()
    await cell.power_up()
    assert cell.latched == []


async def test_events_have_sequence_numbers_without_gaps_across_restarts(cell: CellUnderTest) -> None:
    await cell.start(one_wall(cell.facts))
    await cell.forward(seconds=1.0)
    await cell.kill()
    await cell.power_up()
    await cell.forward(seconds=1.0)
    numbers = [event.seq for event in cell.events]
    assert numbers == list(range(1, len(numbers) + 1))
    assert [row[0] for row in rows(cell.store, "SELECT seq FROM events ORDER BY seq")] == numbers


async def test_a_command_repeated_with_its_id_is_carried_out_once(cell: CellUnderTest) -> None:
    first = await cell.command("jog", ident="jog-1", axis="X", distance=10.0, feed=6000.0)
    await cell.forward(until=cell.is_state(State.IDLE), seconds=3)
    second = await cell.command("jog", ident="jog-1", axis="X", distance=10.0, feed=6000.0)
    await cell.forward(seconds=0.5)
    assert first == second
    assert cell.sim.joints[0] == pytest.approx(10.0, abs=1e-3)


async def test_a_store_that_cannot_be_written_holds_the_job_and_refuses_commands_but_never_a_stop(
    cell: CellUnderTest,
) -> None:
    await cell.deposit()
    cell.journal._db.execute("PRAGMA query_only = ON")
    reply = await cell.command("hold")
    assert not reply.ok and "journal cannot be written" in reply.error
    assert (await cell.command("stop")).ok
    await cell.forward(ticks=2)
    assert cell.is_dark and cell.state is State.STOPPED
    cell.journal._db.execute("PRAGMA query_only = OFF")


async def test_the_record_holds_set_points_and_readings_of_every_layer(cell: CellUnderTest) -> None:
    await cell.start(one_wall(cell.facts, mill=False))
    await cell.hurry(cell.is_state(State.IDLE), scale=3.0)
    cell.journal.commit()
    layers = rows(
        cell.store,
        "SELECT layer, max(laser_readback_w), max(powder_readback_g_min) FROM journal WHERE layer >= 0 GROUP BY layer",
    )
    assert [row[0] for row in layers] == [0, 1]
    assert all(row[1] == pytest.approx(800.0, abs=1.0) and row[2] == pytest.approx(10.0, rel=0.05) for row in layers)
    assert rows(cell.store, "SELECT outcome, last_line = total_lines FROM cell_runs") == [("completed", 1)]
