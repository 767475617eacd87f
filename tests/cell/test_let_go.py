"""A run that is over gives its program's file back at once, without waiting for a collection of garbage."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from cellctl.cell.opened_program import OpenedProgram, open_form
from cellctl.cell.program_form import write_form
from cellctl.domain.messages import Reply
from cellctl.domain.states import State
from planner.program import Program
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall

DIGEST = "d" * 64


@pytest.fixture
def no_collection() -> Iterator[None]:
    """Nothing is freed but by its last reference."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


class Mapped:
    """A cell that opens its programs from forms. is_other : the next one is another cell's"""

    def __init__(self, cell: CellUnderTest, folder: Path) -> None:
        self.cell, self._form = cell, folder / "form"
        write_form(one_wall(cell.facts, layers=1, length_mm=60.0, pieces=60), cell.facts, self._form, DIGEST)
        self.is_other = False
        self._jobs = 0
        cell.commands._read_program = self._open

    async def _open(self, directory: Path) -> tuple[Program, str]:
        program = open_form(self._form, DIGEST)
        assert isinstance(program, OpenedProgram)
        return (replace(program, cell_sha256="0" * 64, cell_name="another") if self.is_other else program), DIGEST

    async def start(self) -> Reply:
        self._jobs += 1
        return await self.cell.command("start", job=f"job-{self._jobs}", name="wall", program="form")

    async def idle(self) -> None:
        """Bring the cell back to IDLE from wherever it is."""
        cell = self.cell
        await cell.forward(until=lambda: cell.controller.run is None, seconds=60)
        await cell.forward(seconds=2)
        if cell.state in (State.STOPPED, State.FAULT):
            assert (await cell.command("reset")).ok
            await cell.forward(until=cell.is_state(State.IDLE, State.UNHOMED), seconds=60)
        if cell.state is State.UNHOMED:
            await cell.command("home")
        await cell.forward(until=cell.is_state(State.IDLE), seconds=60)


def held() -> tuple[int, int]:
    """How many descriptors this process has, and how often a form is mapped."""
    return len(os.listdir("/proc/self/fd")), sum("form.bin" in line for line in Path("/proc/self/maps").read_text().splitlines())


async def completed(cell: CellUnderTest) -> None:
    await cell.hurry(lambda: cell.controller.run is None)
    assert cell.outcome == "completed"


async def aborted_while_held(cell: CellUnderTest) -> None:
    await cell.hurry(cell.is_depositing)
    await cell.command("hold")
    await cell.forward(until=cell.is_state(State.HELD), seconds=10)
    await cell.command("abort")


async def stopped_while_prepared(cell: CellUnderTest) -> None:
    await cell.forward(ticks=20)
    assert cell.state is State.PREPARING
    await cell.command("stop")


async def stopped_while_depositing(cell: CellUnderTest) -> None:
    await cell.hurry(cell.is_depositing)
    await cell.command("stop")


async def broken_off_by_a_fault(cell: CellUnderTest) -> None:
    await cell.hurry(cell.is_depositing)
    cell.controller.fault("internal", "test")


ENDS = (completed, aborted_while_held, stopped_while_prepared, stopped_while_depositing, broken_off_by_a_fault)


async def test_a_run_holds_one_descriptor_and_none_once_it_is_over_however_it_ends(tmp_path: Path, no_collection: None) -> None:
    async with CellUnderTest(tmp_path / "store.db") as cell:
        mapped = Mapped(cell, tmp_path)
        before = held()
        for end in ENDS:
            assert (await mapped.start()).ok
            assert held() == (before[0] + 1, before[1] + 1), end.__name__
            await end(cell)
            await mapped.idle()
            assert held() == before, end.__name__
            assert cell.snapshot.job is not None and cell.snapshot.lines.total > 0, "the last run can still be seen"


async def test_a_refused_start_lets_its_program_go(tmp_path: Path, no_collection: None) -> None:
    async with CellUnderTest(tmp_path / "store.db") as cell:
        mapped = Mapped(cell, tmp_path)
        before = held()
        mapped.is_other = True
        assert "posted for cell" in (await mapped.start()).error
        assert held() == before
        mapped.is_other = False
        cell.journal._db.execute("PRAGMA query_only = ON")  # a store that refuses
        assert not (await mapped.start()).ok
        cell.journal._db.execute("PRAGMA query_only = OFF")
        assert held() == before


async def test_a_program_that_is_replaced_after_a_refusal_lets_the_first_one_go(tmp_path: Path, no_collection: None) -> None:
    async with CellUnderTest(tmp_path / "store.db") as cell:
        mapped = Mapped(cell, tmp_path)
        before = held()
        for _ in range(2):
            assert (await mapped.start()).ok
            assert not (await mapped.start()).ok, "one job at a time"
            await stopped_while_depositing(cell)
            await mapped.idle()
        assert held() == before
