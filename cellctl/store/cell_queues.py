"""How many jobs wait for each cell of a store."""

from __future__ import annotations

from sqlalchemy import Connection, func, select

from cellctl.domain.jobs import ENDED, ON_CELL
from cellctl.store.schema import jobs


def lengths(connection: Connection) -> dict[str, int]:
    """Jobs between submission and start, by the cell that they are given to; under "" those that no cell was chosen for yet."""
    over = [state.value for state in (*ENDED, *ON_CELL)]
    query = select(jobs.c.cell, func.count()).where(jobs.c.state.not_in(over)).group_by(jobs.c.cell)
    return {cell: int(count) for cell, count in connection.execute(query)}
