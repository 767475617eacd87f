"""The computer's clock is set while the cell works: nothing that is measured changes, the step is told, and order is that of the numbers."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import cellctl
from cellctl.domain.states import State
from tests.cell.harness import UNIX_START, CellUnderTest

HOUR_S, DAY_S = 3600.0, 86400.0
KNOWN = {
    ("surroundings.py", "check"),  # a person's confirmation, durable across processes: refused when it lies in the future
    ("runs.py", "_why_confirmed_no_more"),  # the same, in the web process
    ("uploads.py", "sweep"),  # a day without a byte, durable across processes: a clock that is set on ends uploads early, never late
    ("neighbours.py", "_read"),  # by how much the database's clock is ahead of this host's
    ("clock_watch.py", "look"),  # finds the step
    ("clock_watch.py", "__init__"),
}
"""Where a time of day is taken from another, and why that is no duration that safety rests on."""


def set_clock(cell: CellUnderTest, step_s: float) -> None:
    cell.controller.times.unix = lambda: UNIX_START + cell.clock.now() + step_s
    for part in (cell.controller.table, cell.controller.control, cell.controller.clock_watch):
        part._unix = cell.controller.times.unix


@pytest.mark.parametrize("step_s", [-HOUR_S, DAY_S])
async def test_clock_set_while_depositing_changes_nothing_but_is_told(cell: CellUnderTest, step_s: float) -> None:
    await cell.deposit(layers=1, mill=False)
    elapsed = cell.controller.job_view().elapsed_s
    set_clock(cell, step_s)
    await cell.forward(ticks=20)
    assert cell.state is State.RUNNING and cell.is_depositing() and not cell.latched
    assert 0.0 < cell.controller.job_view().elapsed_s - elapsed < 1.0
    held = cell.snapshot.control
    assert held is not None and not held.absent
    await cell.hurry(cell.is_state(State.IDLE))
    cell.journal.commit()
    assert cell.outcome == "completed"
    told = [one for one in cell.events if one.kind == "clock"]
    assert len(told) == 1 and f"{abs(step_s):.1f} s" in told[0].text and ("back" in told[0].text) == (step_s < 0)
    assert [one.seq for one in cell.events] == list(range(1, len(cell.events) + 1))


@pytest.mark.parametrize("step_s", [-DAY_S, -HOUR_S, HOUR_S, DAY_S])
async def test_table_found_clear_before_the_clock_was_set_is_to_be_looked_at_again(cell: CellUnderTest, step_s: float) -> None:
    await cell.forward(ticks=5)
    before = cell.unix()
    set_clock(cell, step_s)
    await cell.forward(ticks=5)
    reply = await cell.command("start", job="j", name="j", program="j", confirmed_at=before)
    assert not reply.ok and reply.kind == "table"
    cell.controller.table.check(cell.controller.times.unix())  # a look after the step counts


def wall_clock_differences(path: Path) -> Iterator[tuple[str, str]]:
    """(file, function) of every subtraction or comparison of ages with a time of day in it."""
    for function in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            for node in ast.walk(function):
                if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Sub) and _tells_the_time_of_day(node):
                    yield path.name, function.name


def _tells_the_time_of_day(node: ast.AST) -> bool:
    calls = [one.func for one in ast.walk(node) if isinstance(one, ast.Call)]
    return any(ast.unparse(call).endswith((".unix", "_unix", "store.clock", "time.time", "unix")) for call in calls)


def test_no_duration_is_made_of_times_of_day() -> None:
    root = Path(cellctl.__file__).parent
    found = {where for part in ("cell", "api", "domain", "planning") for path in (root / part).glob("*.py") for where in wall_clock_differences(path)}
    assert found <= KNOWN
