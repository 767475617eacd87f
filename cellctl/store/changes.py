"""The order of changes to jobs: whoever knows the number of the last one that it saw asks for what came after it."""

from __future__ import annotations

from sqlalchemy import Connection, func, select

from cellctl.store.schema import jobs


def last_change(connection: Connection) -> int:
    """Number of the newest change, 0 if there is none."""
    return int(connection.execute(select(func.coalesce(func.max(jobs.c.changed), 0))).scalar_one())


def changed_since(connection: Connection, change: int) -> list[tuple[str, int]]:
    """(id, number of its newest change) of every job that was changed after that one, in the order of their changes."""
    query = select(jobs.c.id, jobs.c.changed).where(jobs.c.changed > change).order_by(jobs.c.changed, jobs.c.seq)
    return [(row.id, int(row.changed)) for row in connection.execute(query)]
