"""Whoever opens the door of a cutting machine finds a spindle that stands; the job goes on only once it turns again."""

from __future__ import annotations

import pytest

from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall

STANDS_RPM = 1.0
LONGEST_TICKS = 3000
RUN_DOWN_S = 2.0  # of the simulated spindle from 6000 rpm, and some reports


async def cutting(cell: CellUnderTest, *, is_door_wired: bool) -> None:
    """In the middle of the milling pass. is_door_wired : whether the CNC has a door input of its own"""
    if not is_door_wired:
        cell.sim.cnc.machine.door = lambda is_open: None  # type: ignore[method-assign]
    program = one_wall(cell.facts, layers=1, length_mm=20.0)
    assert (await cell.start(program)).ok
    cut = next(k for k, line in enumerate(program.lines) if "M3 S6000" in line) + 3
    await cell.hurry(lambda: cell.snapshot.lines.executing > cut, scale=4.0)
    await cell.forward(ticks=5)
    assert cell.state is State.RUNNING and cell.sim.cnc.machine.spindle_rpm > 5000.0


async def goes_on(cell: CellUnderTest) -> None:
    """Reset and resume; while the tool moves behind it, the spindle is never below 90 % of its speed."""
    cell.sim.close_door()
    await cell.forward(seconds=1.0)
    if cell.state is State.FAULT:
        assert (await cell.command("reset")).ok
        await cell.forward(until=cell.is_state(State.HELD), seconds=8.0)
    assert (await cell.command("resume")).ok
    slowest = []
    program = cell.programs["job-1"]
    end = next(k for k, line in enumerate(program.lines) if "M5" in line)
    for _ in range(LONGEST_TICKS):
        if cell.state in (State.IDLE, State.FAULT):
            break
        await cell.forward(ticks=1)
        if not cell.is_still and cell.snapshot.lines.executing < end:
            slowest.append(cell.sim.cnc.machine.spindle_rpm)
    assert cell.outcome == "completed", cell.controller.because
    assert min(slowest) > 5400.0


@pytest.mark.parametrize("is_door_wired", [True, False])
async def test_a_door_opened_in_a_cut_stops_the_spindle_and_the_resume_has_it_turn_before_anything_moves(
    cell: CellUnderTest, is_door_wired: bool
) -> None:
    await cutting(cell, is_door_wired=is_door_wired)
    cell.sim.open_door()
    await cell.forward(seconds=RUN_DOWN_S)
    assert cell.is_still and cell.sim.cnc.machine.spindle_rpm < STANDS_RPM
    await cell.forward(seconds=3.0)
    assert cell.sim.cnc.machine.spindle_rpm < STANDS_RPM, "it stays so"
    await goes_on(cell)


async def test_a_door_opened_behind_an_operators_hold_stops_the_spindle_that_still_turns(cell: CellUnderTest) -> None:
    await cutting(cell, is_door_wired=False)
    assert (await cell.command("hold")).ok
    await cell.forward(seconds=2.0)
    assert cell.state is State.HELD and cell.sim.cnc.machine.spindle_rpm > 5000.0
    cell.sim.open_door()
    await cell.forward(seconds=RUN_DOWN_S)
    assert cell.sim.cnc.machine.spindle_rpm < STANDS_RPM
    assert cell.has_event("spindle", "door")
    await goes_on(cell)


async def test_a_spindle_that_does_not_stop_behind_an_open_door_is_told(cell: CellUnderTest) -> None:
    await cutting(cell, is_door_wired=False)
    cell.sim.cnc._override = lambda byte: None  # type: ignore[method-assign]  # a firmware without spindle stop
    cell.sim.open_door()
    await cell.forward(seconds=8.0)
    assert cell.sim.cnc.machine.spindle_rpm > 5000.0
    assert any("spindle" in alarm.cause for alarm in cell.snapshot.alarms)
