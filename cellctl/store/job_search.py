"""Jobs that fit what is asked for, in pages: newest first, or in the order of their queue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from sqlalchemy import ColumnElement, Connection, or_, select, tuple_

from cellctl.domain.fleet import ANY
from cellctl.domain.jobs import JobState
from cellctl.store import lanes
from cellctl.store.job_tables import job_notes, job_tags
from cellctl.store.jobs import JobRow, row_of
from cellctl.store.pages import page
from cellctl.store.schema import jobs

Sort = Literal["newest", "queue"]


@dataclass(frozen=True)
class Asked:
    """What jobs are looked for; what is left out is not asked. tags : it has them all; text : in its name, id, state's reason or a note

    created_from, created_to : Unix time, s: from the first on, and before the second
    cell : by name; `any`: those that wait for one
    """

    states: Sequence[JobState] = ()
    tags: Sequence[str] = ()
    material: str = ""
    part_id: str = ""
    text: str = ""
    created_from: float | None = None
    created_to: float | None = None
    created_by: str = ""
    cell: str = ""


def _conditions(asked: Asked) -> list[ColumnElement[bool]]:
    job = jobs.c
    found: list[ColumnElement[bool]] = []
    if asked.states:
        found.append(job.state.in_([state.value for state in asked.states]))
    for tag in dict.fromkeys(asked.tags):
        found.append(job.id.in_(select(job_tags.c.job_id).where(job_tags.c.tag == tag)))
    for column, wanted in ((job.material, asked.material), (job.part_id, asked.part_id), (job.created_by, asked.created_by)):
        if wanted:
            found.append(column == wanted)
    if asked.cell:
        found.append(job.cell == ("" if asked.cell == ANY else asked.cell))
    if asked.created_from is not None:
        found.append(job.created_at >= asked.created_from)
    if asked.created_to is not None:
        found.append(job.created_at < asked.created_to)
    for word in asked.text.split():
        noted = select(job_notes.c.job_id).where(job_notes.c.text.icontains(word, autoescape=True))
        columns = (job.name, job.id, job.why, job.material, job.created_by, job.tags)
        found.append(or_(*(column.icontains(word, autoescape=True) for column in columns), job.id.in_(noted)))
    return found


def find(connection: Connection, asked: Asked, sort: Sort, cursor: str | None, limit: int) -> tuple[list[JobRow], str | None]:
    """Up to `limit` jobs, and the cursor of the rest (None at the end). Raises CursorError."""
    query = select(jobs).where(*_conditions(asked))
    if sort == "newest":
        rows, following = page(connection, jobs, query, cursor, limit)
        return [row_of(row) for row in rows], following
    if cursor is not None:
        query = query.where(tuple_(*lanes.PLACE) > tuple_(*lanes.place_in(cursor)))
    found = connection.execute(query.order_by(*lanes.PLACE).limit(limit + 1)).mappings().all()
    shown = [row_of(row) for row in found[:limit]]
    last = shown[-1] if len(found) > limit else None
    return shown, lanes.cursor_of((last.priority, last.rank, last.seq)) if last else None
