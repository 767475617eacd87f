"""The order of jobs before the planner and before the cell, and what lies on the cell's table."""

from __future__ import annotations

import asyncio
from typing import Any

from fastapi import APIRouter
from pydantic import BaseModel
from sqlalchemy import Connection

from cellctl.api.context import Service
from cellctl.api.jobs import documents
from cellctl.api.models import Job
from cellctl.api.models_jobs import Clear, Move, Table
from cellctl.api.parts import Cursor, Limit
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import Operator, ServiceOf, Viewer
from cellctl.api.table import check_found, check_free
from cellctl.api.waits import why_not_yet
from cellctl.domain.jobs import ON_CELL, JobState
from cellctl.store import audit, cell_table, jobs, lanes
from cellctl.store.job_search import Asked, find
from cellctl.store.lanes import Lane, NotInLaneError, Place

router = APIRouter(prefix="/api/v1", tags=["queue"], responses=DOCUMENTED)
WORDS = {Lane.PLANNING: "planning queue", Lane.CELL: "queue of the cell"}
LOOKED_AT = 200  # first jobs of the queue among which the next one is looked for


class Queue(BaseModel):
    """A page of a queue in its order. version: changes with every change of the order; first: position of the first item, from 0"""

    lane: Lane
    version: int
    length: int
    first: int
    items: list[Job]
    next: str | None = None


def check_version(rows: Connection, lane: Lane, seen: int | None) -> None:
    """Raises ApiError 412 if the order is not the one that was seen."""
    if seen is not None and seen != lanes.version(rows, lane):
        raise ApiError(
            412, "The queue changed meanwhile", f"the {WORDS[lane]} is not as you saw it: jobs were moved, came or left since",
            "look at the queue again, then move the job",
        )  # fmt: skip


@router.get("/queue")
def get_queue(
    _person: Viewer, service: ServiceOf, lane: Lane = Lane.CELL, cursor: Cursor = None, limit: Limit = 50
) -> Queue:
    """A queue of this cell in its order, with what each job waits for.

    `version` names the order: give it to a move, which then changes no other order."""
    cell = service.cell.name
    with service.store.read() as rows:
        found, following = find(rows, Asked((lanes.STATE_OF[lane],), cell=cell), "queue", cursor, limit)
        version = lanes.version(rows, lane)
        ahead = lanes.ahead_of(rows, lane, _place(found[0]), cell) if found and cursor is not None else 0
        items = documents(service, found, rows)
        return Queue(lane=lane, version=version, length=lanes.length(rows, lane, cell), first=ahead, items=items, next=following)


def _place(job: jobs.JobRow) -> Place:
    return (job.priority, job.rank, job.seq)


def _target(rows: Connection, lane: Lane, cell: str, body: Move) -> tuple[Place | None, Place | None] | None:
    """The new neighbours of a job (before it, behind it); None if it stands there already. Raises NotInLaneError, ApiError."""
    here = lanes.place_of(rows, lane, body.job)
    if body.job in (body.before, body.behind):
        raise ApiError(422, "The request does not fit", "a job cannot be put beside itself", "name another job")
    if body.to in ("up", "down"):
        by = lanes.neighbour(rows, lane, here, body.to == "down", cell)
        if by is None:
            return None
        beyond = lanes.neighbour(rows, lane, by, body.to == "down", cell)
        return (by, beyond) if body.to == "down" else (beyond, by)
    if body.before is not None:
        behind: Place | None = lanes.place_of(rows, lane, body.before)
    elif body.behind is not None:
        behind = _beyond(rows, lane, cell, lanes.place_of(rows, lane, body.behind), here, after=True)
    else:
        position = {"first": 0, "last": 10**9}[body.to] if body.to is not None else body.position or 0
        behind = lanes.at_position(rows, lane, position, body.job, cell)
    if behind is None:
        last = _last(rows, lane, cell, here)
        return None if last is None else (last, None)
    return _beyond(rows, lane, cell, behind, here, after=False), behind


def _beyond(rows: Connection, lane: Lane, cell: str, place: Place, moved: Place, *, after: bool) -> Place | None:
    """The neighbour of a place, the one that moves left out."""
    found = lanes.neighbour(rows, lane, place, after, cell)
    return lanes.neighbour(rows, lane, found, after, cell) if found == moved else found


def _last(rows: Connection, lane: Lane, cell: str, moved: Place) -> Place | None:
    """The last of a lane, None if that is the one that moves."""
    last = lanes.neighbour(rows, lane, (lanes.LAST + 1, 0, 0), False, cell)
    return None if last == moved else last


@router.post("/queue/move")
async def move(
    person: Operator, service: ServiceOf, body: Move, lane: Lane = Lane.CELL, limit: Limit = 50
) -> Queue:
    """Move a job in its queue. It takes on the priority of its new neighbours where it has to. With `version` 412 tells that the order changed."""
    ways = [body.to, body.before, body.behind, body.position]
    if sum(way is not None for way in ways) != 1:
        raise ApiError(422, "The request does not fit", "say one of to, before, behind and position", "the schema is in /openapi.json")

    def write() -> Queue:
        now = service.store.clock()
        with service.store.write() as rows:
            job = jobs.get(rows, body.job)
            check_version(rows, lane, body.version)
            try:
                target = _target(rows, lane, job.cell, body)
            except NotInLaneError as error:
                raise ApiError(409, "Not in this queue", f"{error} ({job.name} is {job.state.value})", "look at the queue again") from None
            if target is not None:
                lanes.insert_between(rows, lane, job.id, *target)
                where = body.to or (f"before {body.before}" if body.before else f"behind {body.behind}" if body.behind else f"to {body.position}")
                audit.add(rows, person.deed("move", job.id, body.because), now, f"ok: {where} in the {WORDS[lane]}")
            found, following = find(rows, Asked((lanes.STATE_OF[lane],), cell=job.cell), "queue", None, limit)
            version = lanes.version(rows, lane)
            items = documents(service, found, rows)
            return Queue(lane=lane, version=version, length=lanes.length(rows, lane, job.cell), first=0, items=items, next=following)

    queue = await asyncio.to_thread(write)
    service.feed.take_job(body.job)
    service.queue.wake()
    service.runs.wake()
    return queue


def table_document(service: Service, rows: Connection) -> Table:
    """What lies on the table, and what could start once somebody looked."""
    lying = cell_table.lying_on(rows, service.cell.name)
    now = service.store.clock()
    on_it = jobs.get(rows, lying.job_id) if lying.job_id else None
    first = jobs.first_in(rows, JobState.QUEUED, LOOKED_AT, service.cell.name)
    next_one = next((job for job in first if job.continues_job is None and not why_not_yet(rows, job, now)), None)
    if on_it is not None:
        verb = "is being made on it" if on_it.state in ON_CELL else f"lies on it ({on_it.state.value})"
        text = f"the part of {on_it.name} {verb}: nothing starts before a person found the table clear"
    elif lying.cleared_at is not None:
        text = f"{lying.cleared_by} found it clear"
    else:
        text = "nobody has looked at it: nothing starts before a person found the table clear"
    return Table(
        cell=lying.cell, job=on_it.id if on_it else None, name=on_it.name if on_it else "", state=on_it.state.value if on_it else "",
        since=lying.since or None, cleared_at=lying.cleared_at, cleared_by=lying.cleared_by, because=lying.because,
        next=next_one.id if next_one else None, next_name=next_one.name if next_one else "", text=text,
    )  # fmt: skip


@router.get("/table", tags=["table"])
def get_table(_person: Viewer, service: ServiceOf) -> Table:
    """What lies on the cell's table."""
    with service.store.read() as rows:
        return table_document(service, rows)


@router.post("/table/clear", tags=["table"])
async def clear_table(person: Operator, service: ServiceOf, body: Clear) -> Table:
    """A person looked: the table is clear. With `start` a queued job may start on it; without, nothing starts, and who waits for that goes on."""

    def write() -> tuple[Table, list[str]]:
        now = service.store.clock()
        with service.store.write() as rows:
            check_free(rows, service.cell.name)
            lying = cell_table.lying_on(rows, service.cell.name)
            cell_table.clear(rows, service.cell.name, now, person.name, body.because)
            changed = [lying.job_id] if lying.job_id else []
            if body.start is not None:
                changed.append(_confirm(rows, body.start, now, person.name, person.client).id)
            audit.add(rows, person.deed("clear table", body.start or lying.job_id or service.cell.name, body.because), now, "ok")
            return table_document(service, rows), changed

    table, changed = await asyncio.to_thread(write)
    for job_id in changed:
        service.feed.take_job(job_id)
    service.runs.wake()
    return table


def _confirm(rows: Connection, job_id: str, now: float, who: str, client: str) -> Any:
    """Vouch for the table before one queued job. Raises ApiError, NotFoundError."""
    job = jobs.get(rows, job_id)
    if job.state is not JobState.QUEUED:
        raise ApiError(409, "Not in this state", f"{job.name} is {job.state.value}, not queued", "approve it first")
    check_found(job, True, False)
    return jobs.confirm_table(rows, job_id, now, who, client)
