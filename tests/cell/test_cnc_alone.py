"""What only the CNC's status tells: its own feed hold and its own door input; light is out within a status period, 30 ms and a request."""

from __future__ import annotations

from pathlib import Path

import pytest

from config.cell import Cell
from tests.cell.harness import CellUnderTest, shipped_cell

STEP_S, TICK_STEPS = 0.001, 10
BOUND_S = 0.03 + 0.003  # and one request, as long as the map says it takes


def cell_with(status_period_s: float) -> Cell:
    facts = shipped_cell()
    return facts.model_copy(update={"cnc": facts.cnc.model_copy(update={"status_period_s": status_period_s})})


@pytest.mark.parametrize(("cause", "status_period_s"), [("feed hold", 0.1), ("door", 0.05)])
async def test_a_signal_of_the_cnc_alone_has_the_light_out_within_a_status_period(folder: Path, status_period_s: float, cause: str) -> None:
    async with CellUnderTest(folder / "s.db", cell=cell_with(status_period_s)) as cell:
        await cell.deposit(length_mm=60.0, mill=False, layers=1)
        await cell.forward(ticks=3)
        machine = cell.sim.cnc.machine
        machine.hold() if cause == "feed hold" else machine.door(True)
        lit_s = 0.0
        for step in range(round(0.3 / STEP_S)):
            await cell._pass(STEP_S)
            lit_s += 0.0 if cell.is_dark else STEP_S
            if (step + 1) % TICK_STEPS == 0:
                cell.controller.tick()
                await cell._settle()
        assert cell.is_dark and lit_s <= status_period_s + BOUND_S
