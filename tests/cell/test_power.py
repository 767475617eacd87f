"""The whole machine without power at once, and its return: one cause, no light, one run that is interrupted where metal ended."""

from __future__ import annotations

import sqlite3
from contextlib import closing

import pytest

from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest


@pytest.mark.parametrize("is_held", [False, True])
async def test_machine_powered_off_in_a_job_is_one_alarm_and_an_interrupted_run(cell: CellUnderTest, is_held: bool) -> None:
    await cell.deposit()
    if is_held:
        assert (await cell.command("hold")).ok
        await cell.forward(until=cell.is_state(State.HELD), seconds=3.0)
    cell.witness.forget()
    cell.sim.faults.add("power_off")
    await cell.forward(until=lambda: cell.outcome != "", seconds=5.0)
    assert cell.is_dark and cell.latched == ["power"] and cell.outcome == "interrupted"
    assert "main switch" in cell.snapshot.alarms[0].remedy
    refused = await cell.command("reset")
    assert not refused.ok and "does not answer" in refused.error
    cell.sim.faults.add("power_on")
    await cell.forward(seconds=2.0)
    assert cell.latched == ["power"] and cell.is_dark and cell.is_still
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.UNHOMED), seconds=5.0)
    assert (await cell.command("home")).ok
    await cell.forward(until=cell.is_state(State.IDLE), seconds=20.0)
    await cell.forward(seconds=1.0)
    assert cell.state is State.IDLE and not cell.snapshot.position
    with closing(sqlite3.connect(cell.store)) as db:
        assert db.execute("SELECT outcome, count(*) FROM cell_runs").fetchall() == [("interrupted", 1)]
        ends = "SELECT json_extract(data, '$.metal_end.line') FROM events WHERE json_extract(data, '$.outcome') = 'interrupted'"
        data = db.execute(ends).fetchall()
    assert len(data) == 1 and data[0][0] > 0


async def test_machine_homed_in_no_time_is_not_taken_for_one_that_has_locked_itself(cell: CellUnderTest) -> None:
    cell.sim.faults.add("power_off")
    await cell.forward(until=cell.is_state(State.OFFLINE), seconds=5.0)
    cell.sim.faults.add("power_on")
    await cell.forward(until=cell.is_state(State.UNHOMED), seconds=5.0)
    assert (await cell.command("home")).ok
    await cell.forward(until=lambda: cell.state is not State.HOMING, seconds=20.0)
    await cell.forward(seconds=1.0)
    assert cell.state is State.IDLE
