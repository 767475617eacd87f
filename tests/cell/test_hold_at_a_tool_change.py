"""A job that is held before its tool change is carried out goes on with the change."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cellctl.domain.states import State
from planner.program import LineKind
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall


async def test_a_hold_between_two_tools_resumes_with_the_change_and_ends_the_job(tmp_path: Path) -> None:
    async with CellUnderTest(tmp_path / "store.db") as cell:
        program = one_wall(cell.facts, layers=1, length_mm=20.0, pieces=5)
        change = int(np.flatnonzero(program.table["kind"] == LineKind.TOOL)[-1])
        assert (await cell.start(program)).ok

        def stands_before_it() -> bool:
            run = cell.controller.run
            assert run is not None
            return cell.state is State.RUNNING and run.line == change

        await cell.hurry(stands_before_it)
        await cell.command("hold")
        await cell.forward(until=cell.is_state(State.HELD), seconds=10)
        await cell.command("resume")
        await cell.hurry(lambda: cell.controller.run is None)
        assert cell.outcome == "completed" and not cell.latched
