"""What lies on a cell's table: the part of the job that ran last, until a person found the table clear."""

from __future__ import annotations

from dataclasses import dataclass

from sqlalchemy import Connection, insert, select, update

from cellctl.store.job_tables import cell_tables
from cellctl.store.schema import jobs


@dataclass(frozen=True)
class Lying:
    """What is known of a table. job_id : whose part lies on it, empty if none is known; since, cleared_at : Unix time, s

    cleared_at is None where something lies on it, or nobody ever looked.
    """

    cell: str
    job_id: str = ""
    since: float = 0.0
    cleared_at: float | None = None
    cleared_by: str = ""
    because: str = ""


def lying_on(connection: Connection, cell: str) -> Lying:
    """What lies on the table of a cell."""
    row = connection.execute(select(cell_tables).where(cell_tables.c.cell == cell)).mappings().first()
    return Lying(**row) if row is not None else Lying(cell)


def occupy(connection: Connection, cell: str, job_id: str, at: float) -> None:
    """A job was started: from here on its part lies on the table. `at` is its end where its run was heard of only afterwards."""
    before = lying_on(connection, cell)
    _write(connection, Lying(cell, job_id, at))
    if before.cleared_at is not None and before.cleared_at > at:  # somebody looked since
        clear(connection, cell, before.cleared_at, before.cleared_by, before.because)


def clear(connection: Connection, cell: str, at: float, who: str, because: str) -> None:
    """A person found the table clear: whatever lay on it is away."""
    lying = lying_on(connection, cell)
    job_id: str | None = lying.job_id
    while job_id:  # a job that goes on with another works on the same part
        connection.execute(update(jobs).where(jobs.c.id == job_id).values(cleared_at=at))
        job_id = connection.execute(select(jobs.c.continues_job).where(jobs.c.id == job_id)).scalar()
    _write(connection, Lying(cell, "", lying.since, at, who, because))


def _write(connection: Connection, lying: Lying) -> None:
    values = dict(lying.__dict__)
    if connection.execute(update(cell_tables).where(cell_tables.c.cell == lying.cell).values(**values)).rowcount == 0:
        connection.execute(insert(cell_tables).values(**values))
