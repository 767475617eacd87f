"""Invariant 3: progress rests on lines executed at the machine, never on `ok`."""

from __future__ import annotations

import sqlite3
from contextlib import closing

from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall


async def test_executed_never_runs_ahead_of_the_line_that_the_machine_moves_on(cell: CellUnderTest) -> None:
    await cell.start(one_wall(cell.facts))
    cell.time_scale = cell.sim.time_scale = 3.0
    while cell.state is not State.IDLE:
        await cell.forward(ticks=7)
        lines = cell.snapshot.lines
        moving_on = cell.sim.cnc.machine.motion.line
        if not cell.is_still and moving_on:
            assert lines.executed < moving_on
        assert lines.executed <= lines.acknowledged <= lines.sent <= lines.total
    assert cell.snapshot.lines.executed == cell.snapshot.lines.total


async def test_lines_that_are_acknowledged_but_held_are_not_counted(cell: CellUnderTest) -> None:
    await cell.deposit(layers=1, pieces=40, length_mm=80.0)
    await cell.command("hold")
    await cell.forward(until=cell.is_state(State.HELD), seconds=2)
    await cell.forward(seconds=0.3)
    lines = cell.snapshot.lines
    assert lines.acknowledged > lines.executed + 5, "the machine's buffer holds lines"
    assert lines.executed == cell.sim.cnc.machine.motion.line - 1
    assert cell.snapshot.job is not None
    assert cell.snapshot.job.progress == lines.executed / lines.total
    with closing(sqlite3.connect(cell.store)) as db, db:
        assert db.execute("SELECT last_line FROM cell_runs").fetchone() == (lines.executed,)


async def test_a_lost_ok_ends_the_job_with_its_cause_instead_of_waiting_for_ever(cell: CellUnderTest) -> None:
    await cell.deposit(layers=1, pieces=40, length_mm=40.0, mill=False)
    cell.sim.faults.add("lost_ok")
    await cell.forward(until=cell.is_state(State.FAULT, State.IDLE), seconds=60)
    assert cell.state is State.FAULT
    assert cell.latched == ["answer_overdue"]
    await cell.forward(seconds=3.0)
    assert cell.outcome == "interrupted"


async def test_a_doubled_ok_does_not_count_a_line_twice(cell: CellUnderTest) -> None:
    await cell.deposit(layers=1, pieces=20)
    cell.sim.faults.add("doubled_ok")
    await cell.hurry(cell.is_state(State.FAULT, State.IDLE, State.HELD), scale=4.0)
    assert cell.snapshot.lines.executed <= cell.snapshot.lines.total
    assert cell.max_standstill_emission_w == 0.0


async def test_a_firmware_that_restarts_in_the_job_interrupts_it(cell: CellUnderTest) -> None:
    await cell.deposit()
    cell.sim.faults.add("firmware_reset")
    await cell.forward(until=cell.is_state(State.FAULT), seconds=2)
    await cell.forward(ticks=2)
    assert cell.is_dark
    assert cell.latched[0] in ("cnc_reset", "cnc_alarm")
    await cell.forward(seconds=2.0)
    assert cell.outcome == "interrupted"


async def test_an_alarm_of_the_machine_is_latched_with_its_cause_and_needs_homing_after_the_reset(
    cell: CellUnderTest,
) -> None:
    await cell.deposit()
    cell.sim.faults.add("alarm 1")
    await cell.forward(until=cell.is_state(State.FAULT), seconds=1)
    await cell.forward(ticks=2)
    assert cell.is_dark
    await cell.forward(seconds=2.5)
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.UNHOMED, State.IDLE), seconds=5)
