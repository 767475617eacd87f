"""A job that is held before its spindle is set going goes on with the line that does so."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from cellctl.domain.states import State
from planner.program import Channel, Program
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall


def with_gas_before(program: Program, index: int) -> Program:
    """The same, waiting before one line until more gas flows."""
    row = np.zeros(1, dtype=program.schedule.dtype)
    row["n"], row["channel"], row["barrier"], row["value"] = index + 1, Channel.SHIELD_GAS_L_MIN, 1, 20.0
    rows = np.concatenate([program.schedule, row])
    return replace(program, schedule=rows[np.argsort(rows["n"], kind="stable")])


async def test_a_hold_before_the_spindle_is_set_going_resumes_and_ends_the_job(tmp_path: Path) -> None:
    async with CellUnderTest(tmp_path / "store.db") as cell:
        program = one_wall(cell.facts, layers=1, length_mm=20.0, pieces=5)
        on = next(k for k, text in enumerate(program.lines) if "M3" in text.split())
        assert (await cell.start(with_gas_before(program, on))).ok

        def waits_before_it() -> bool:
            run = cell.controller.run
            assert run is not None
            return cell.state is State.RUNNING and run.line == on and cell.sim.cnc.machine.spindle_rpm == 0.0

        await cell.hurry(waits_before_it)
        await cell.command("hold")
        await cell.forward(until=cell.is_state(State.HELD), seconds=10)
        assert cell.sim.cnc.machine.spindle_rpm == 0.0
        await cell.command("resume")
        await cell.hurry(lambda: cell.controller.run is None or cell.state is State.FAULT)
        assert cell.outcome == "completed" and not cell.latched, cell.controller.because
