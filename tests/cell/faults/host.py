"""Faults of the computer that the cell process runs on: its clock is set, its disk takes no rows or takes its time."""

from __future__ import annotations

from tests.cell.harness import CellUnderTest

PREFIX = "host "


def strike(cell: CellUnderTest, text: str) -> None:
    """Carry out one fault text: `host clock SECONDS`, `host disk read-only|writable`, `host commit SECONDS`. Raises KeyError for another."""
    kind, value = text.removeprefix(PREFIX).split()
    {"clock": _set_clock, "disk": _set_disk, "commit": _slow_down}[kind](cell, value)


def _set_clock(cell: CellUnderTest, step: str) -> None:
    before = cell.controller.times.unix
    step_s = float(step)
    cell.controller.times.unix = lambda: before() + step_s
    for part in (cell.controller.table, cell.controller.control, cell.controller.clock_watch):
        part._unix = cell.controller.times.unix


def _set_disk(cell: CellUnderTest, how: str) -> None:
    cell.journal._db.execute(f"PRAGMA query_only = {'ON' if how == 'read-only' else 'OFF'}")


def _slow_down(cell: CellUnderTest, takes: str) -> None:
    """Every commit takes so long (wire time): what waits for it waits, nothing else does."""
    takes_s, commit, ended_at = float(takes), type(cell)._commit, [cell.clock.now()]

    def late() -> None:
        if cell.clock.now() - ended_at[0] >= takes_s:
            ended_at[0] = cell.clock.now()
            commit(cell)

    cell._commit = late  # type: ignore[method-assign]
