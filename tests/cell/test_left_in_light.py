"""What is told at a start of the light that a dead cell process would leave at standstill, against the plant where it does die."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cellctl.cell.left_in_light import told
from config.cell import Cell
from planner.program import SCHEDULE_DTYPE, Channel, LineKind, Program
from tests.cell.harness import CellUnderTest, shipped_cell
from tests.cell.jobs import one_wall

STEP_S = 0.005


def cell_with(rx_bytes: int, planner_blocks: int, *, is_stream_gated: bool = True) -> Cell:
    facts = shipped_cell()
    simulation = facts.simulation.model_copy(update={"rx_bytes": rx_bytes, "planner_blocks": planner_blocks})
    changes: dict[str, object] = {"simulation": simulation}
    if not is_stream_gated:
        changes["cnc"] = facts.cnc.model_copy(update={"laser_gate_output": None})
    return facts.model_copy(update=changes)


async def light_at_standstill_s(cell: CellUnderTest) -> float:
    """Seconds for which the plant emits at standstill after the process was killed."""
    await cell.kill()
    lit_s = 0.0
    for _ in range(round(1.5 / STEP_S)):
        await cell._pass(STEP_S)
        lit_s += STEP_S if cell.is_still and not cell.is_dark else 0.0
    assert cell.is_dark
    return lit_s


@pytest.mark.parametrize("is_stream_gated", [True, False])
async def test_a_control_that_holds_little_motion_is_told_with_a_bound_that_the_plant_keeps(folder: Path, is_stream_gated: bool) -> None:
    async with CellUnderTest(folder / "s.db", cell=cell_with(128, 5, is_stream_gated=is_stream_gated)) as cell:
        program = one_wall(cell.facts, length_mm=60.0, pieces=300, layers=1, mill=False)  # 0.2 mm a line: 20 ms each
        reply = await cell.start(program)
        assert reply.ok, reply.error
        await cell.forward(until=lambda: cell.is_depositing() and cell.snapshot.lines.executing > 40, seconds=60.0)
        text = await _told(cell)
        assert "if the cell process died" in text and cell.has_event("dead_man", text)
        bound_s = float(text.split("up to ")[1].split(" s")[0])
        assert 0.05 < bound_s <= cell.sim.laser.device.dead_man_s
        lit_s = await light_at_standstill_s(cell)
        assert lit_s <= bound_s + 2.0 * STEP_S


@pytest.mark.parametrize("is_stream_gated", [True, False])
async def test_a_control_that_holds_more_than_the_dead_man_leaves_no_light_at_standstill_and_nothing_is_told(
    folder: Path, is_stream_gated: bool
) -> None:
    async with CellUnderTest(folder / "s.db", cell=cell_with(1024, 100, is_stream_gated=is_stream_gated)) as cell:
        await cell.deposit(length_mm=60.0, pieces=600, mill=False)
        assert await _told(cell) == "" and not cell.has_event("dead_man")
        assert await light_at_standstill_s(cell) == 0.0


async def test_the_end_of_a_pass_before_a_barrier_is_told_for_a_gate_over_modbus_alone(folder: Path) -> None:
    for is_stream_gated in (True, False):
        facts = cell_with(1024, 100, is_stream_gated=is_stream_gated)
        async with CellUnderTest(folder / f"{is_stream_gated}.db", cell=facts) as cell:
            reply = await cell.start(_wall_that_ends_at_a_barrier(facts))
            assert reply.ok, reply.error
            assert bool(await _told(cell)) is not is_stream_gated


def _wall_that_ends_at_a_barrier(facts: Cell) -> Program:
    """One wall whose stream waits right behind the last line of its bead."""
    program = one_wall(facts, layers=1, mill=False)
    n = int(np.flatnonzero(program.table["kind"] == LineKind.PROCESS)[-1]) + 1 + (2 if program.gate == "stream" else 1)
    entry = np.array([(n, Channel.SHIELD_GAS_L_MIN, 1, 15.0)], dtype=SCHEDULE_DTYPE)
    schedule = np.concatenate([program.schedule, entry])
    return replace(program, schedule=schedule[np.argsort(schedule["n"], kind="stable")])


async def _told(cell: CellUnderTest) -> str:
    run, drivers = cell.controller.run, cell.controller.drivers
    assert run is not None and drivers is not None and drivers.cnc.identity is not None
    return await told(run.program, run.timeline, drivers.laser.client, drivers.cnc.identity)
