"""Tool changes at the plant: by hand where the control has no changer, only when a person says so; in any case dark, with the spindle at rest."""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path

import pytest

from cellctl.domain.states import State
from planner.program import LineKind, Program
from tests.cell.harness import CellUnderTest, shipped_cell
from tests.cell.jobs import Writer, bead, mill_pass, one_wall

T1, T2 = "T1 (coaxial head, 2 mm spot)", "T2 (end mill D8)"
LONG_S = 20.0  # nobody comes
OPERATOR_S = 2.0


def by_hand(program: Program, *, spindle_left_on: bool = False) -> Program:
    """What a post writes with the macro of a control without a changer: a pause in place of M6."""
    lines = [line.replace("M6 T", "M0 T") for line in program.lines]
    if spindle_left_on:
        lines = [line.replace("M3 S6000", "G4 P0").replace("M0 T2", "M3 S6000 T2 M0") for line in lines]
    return replace(program, lines=tuple(lines))


@pytest.fixture
async def bare(folder: Path) -> AsyncIterator[CellUnderTest]:
    """A cell whose control is grbl 1.1, which has no changer and reports no tool."""
    facts = shipped_cell()
    facts = facts.model_copy(update={"cnc": facts.cnc.model_copy(update={"firmware": "grbl"})})
    async with CellUnderTest(folder / "store.db", cell=facts) as cell:
        yield cell


async def asked_for(cell: CellUnderTest, tool: str) -> None:
    """Go on until the operator is asked for a tool."""
    await cell.hurry(cell.is_state(State.HELD, State.FAULT, State.IDLE), scale=4.0)
    assert cell.state is State.HELD, cell.latched
    assert cell.controller.because == f"put in tool {tool} by hand once the spindle stands, then resume"


async def test_tool_is_asked_for_by_name_and_nothing_goes_on_before_it_is_confirmed(bare: CellUnderTest) -> None:
    cell, machine = bare, bare.sim.cnc.machine
    assert (await cell.start(by_hand(one_wall(bare.facts, layers=1, pieces=2, length_mm=8.0)))).ok
    await asked_for(cell, T1)
    assert (await cell.command("resume")).ok
    await cell.forward(ticks=5)
    await asked_for(cell, T2)
    executed, joints = cell.snapshot.lines.executed, cell.sim.joints.copy()
    await cell.forward(seconds=LONG_S)
    assert cell.state is State.HELD and cell.is_still and (cell.sim.joints == joints).all()
    assert cell.snapshot.lines.executed == executed and machine.spindle_rpm == 0.0
    assert cell.is_dark and cell.sim.laser.values["emission_permit"] == 0.0 and cell.sim.laser.values["enable"] == 0.0
    assert cell.sim.io.is_parked and cell.sim.feeder.rate_at_nozzle_g_min < 0.3
    reply = await cell.command("resume", because="the 8 mm end mill is in")
    assert reply.ok, reply.error
    await cell.hurry(lambda: bool(cell.outcome), scale=4.0)
    assert cell.outcome == "completed" and cell.max_standstill_emission_w == 0.0
    assert cell.has_event("command", "resume, because the 8 mm end mill is in")


async def test_spindle_that_a_program_left_on_is_stopped_before_a_hand_reaches_in(bare: CellUnderTest) -> None:
    cell, machine = bare, bare.sim.cnc.machine
    program = by_hand(one_wall(cell.facts, layers=1, pieces=2, length_mm=8.0), spindle_left_on=True)
    assert (await cell.start(program)).ok
    await asked_for(cell, T1)
    assert (await cell.command("resume")).ok
    await cell.forward(ticks=5)
    await asked_for(cell, T2)
    await cell.forward(until=lambda: machine.spindle_rpm == 0.0, seconds=10.0)
    await cell.forward(seconds=LONG_S)
    assert machine.spindle_rpm == 0.0 and cell.state is State.HELD


async def test_door_opened_for_the_tool_and_closed_again_leaves_the_job_to_go_on(bare: CellUnderTest) -> None:
    cell = bare
    await cell.start(by_hand(one_wall(cell.facts, layers=1, pieces=2, length_mm=8.0, mill=False)))
    await asked_for(cell, T1)
    cell.sim.open_door()
    await cell.forward(seconds=OPERATOR_S)
    assert not (await cell.command("resume")).ok and cell.is_still
    cell.sim.close_door()
    await cell.forward(seconds=OPERATOR_S)
    assert cell.is_still, "closing the door confirms nothing"
    if cell.state is State.FAULT:
        assert (await cell.command("reset")).ok
        await cell.forward(until=cell.is_state(State.HELD), seconds=5)
    reply = await cell.command("resume")
    assert reply.ok, reply.error
    await cell.hurry(lambda: bool(cell.outcome), scale=4.0)
    assert cell.outcome == "completed"


def there_and_back(cell: CellUnderTest) -> Program:
    """A bead, a cut over it, and another bead on that."""
    w = Writer(cell.facts)
    w.line("G21 G90 G17 G49 G54 G93", LineKind.SETUP)
    w.line("M6 T1", LineKind.TOOL)
    w.layer = w.operation = 0
    bead(w, 0.0, 8.0, 2, first=True)
    mill_pass(w, 1, 8.0)
    w.tool = 1
    w.line("M6 T1", LineKind.TOOL)
    w.layer = w.operation = 2
    bead(w, 1.0, 8.0, 2, first=True)
    w.line("M2", LineKind.SETUP)
    return w.program("there and back", [0])


async def test_changer_works_only_dark_with_the_head_parked_and_the_spindle_told_to_stop(cell: CellUnderTest) -> None:
    machine, laser = cell.sim.cnc.machine, cell.sim.laser
    assert (await cell.start(there_and_back(cell))).ok
    cell.set_pace(4.0)
    changes = []
    was_changing = False
    while not cell.outcome:
        await cell.forward(ticks=1)
        if machine.is_changing_tool:
            assert laser.power_w < 1.0 and laser.values["emission_permit"] == 0.0 and machine.spindle_command_rpm == 0.0
            assert machine.motion.speed == 0.0
            if not was_changing:
                changes.append((machine.tool, cell.sim.io.is_parked))
        was_changing = machine.is_changing_tool
        assert cell.state is not State.FAULT, cell.latched
    assert cell.outcome == "completed"
    assert [tool for tool, _ in changes] == [1, 2] and all(parked for _, parked in changes)
