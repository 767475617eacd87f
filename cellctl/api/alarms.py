"""Alarms by incident, and the word that one was seen."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter, Path, Query
from sqlalchemy import Connection, select

from cellctl.api.cell import ABSENT_HINT, refused
from cellctl.api.cell_link import CellAbsentError
from cellctl.api.models_trends import AlarmItem, Alarms, AlarmTold, Seen
from cellctl.api.parts import Cursor, Limit
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import Operator, Person, ServiceOf, Viewer
from cellctl.store import alarms
from cellctl.store.alarms import Incident, Told
from cellctl.store.pages import cursor_of, seq_of
from cellctl.store.schema import cell_runs

router = APIRouter(prefix="/api/v1/cell/alarms", tags=["cell"], responses=DOCUMENTED)
ID_MAX = 2**53
AlarmId = Annotated[int, Path(ge=1, le=ID_MAX, description="`id` of an incident, or `seq` of one of its alarms")]
Moment = Annotated[float, Query(ge=0.0, le=1e11, allow_inf_nan=False, description="Unix time, s; 0: no bound")]


def _told(one: Told) -> AlarmTold:
    return AlarmTold(**{**asdict(one), "instead_of": list(one.instead_of)})


def _item(one: Incident, now: float, names: dict[str, str]) -> AlarmItem:
    until = now if one.ended_at is None else one.ended_at
    return AlarmItem(
        id=one.id, at=one.at, ended_at=one.ended_at, duration_s=max(until - one.at, 0.0), job=one.job, job_name=names.get(one.job, ""),
        first=_told(one.first), followed=[_told(other) for other in one.followed], reset_by=one.reset_by, because=one.because,
    )  # fmt: skip


def _names(rows: Connection, found: list[Incident]) -> dict[str, str]:
    """Names of the jobs that ran."""
    ids = {one.job for one in found if one.job}
    return {job: name or "" for job, name in rows.execute(select(cell_runs.c.job, cell_runs.c.name).where(cell_runs.c.job.in_(ids)))}


@router.get("")
def list_alarms(
    _person: Viewer,
    service: ServiceOf,
    cursor: Cursor = None,
    limit: Limit = 50,
    code: Annotated[str, Query(max_length=60, description="only incidents in which this alarm was")] = "",
    job: Annotated[str, Query(max_length=60)] = "",
    from_: Annotated[float, Query(alias="from", ge=0.0, le=1e11, allow_inf_nan=False, description="Unix time, s; 0: no bound")] = 0.0,
    to: Moment = 0.0,
) -> Alarms:
    """What was latched, by incident (what lies between two resets), newest first: first cause, what followed, who saw and who reset it."""
    before = seq_of(cursor) if cursor is not None else None
    with service.store.read_cell() as rows:
        found = alarms.incidents(rows, before, limit + 1, code, job, from_, to)
        names = _names(rows, found[:limit])
    items = [_item(one, service.store.clock(), names) for one in found[:limit]]
    return Alarms(items=items, next=cursor_of(items[-1].id) if len(found) > limit else None)


@router.get("/{ident}")
def get_alarm(_person: Viewer, service: ServiceOf, ident: AlarmId) -> AlarmItem:
    """One incident, by its id or by the number of any of its alarms."""
    with service.store.read_cell() as rows:
        found = alarms.incident(rows, ident)
        return _item(found, service.store.clock(), _names(rows, [found]))


@router.post("/{ident}/acknowledge")
async def acknowledge(person: Operator, service: ServiceOf, ident: AlarmId, body: Seen) -> AlarmItem:
    """Say that the alarms of an incident were seen: shown at every console. It resets nothing, needs no control, and is harmless twice."""

    def read() -> Incident:
        with service.store.read_cell() as rows:
            return alarms.incident(rows, ident)

    found = await asyncio.to_thread(read)
    unseen = [told.code for told in (found.first, *found.followed) if not told.acknowledged_by]
    outcome = "was reset already" if found.ended_at is not None else "was acknowledged already"
    if found.ended_at is None and unseen:
        outcome = await _tell(service, person, unseen, body.because)
    else:
        await service.deeds.note(service.store, person.deed("acknowledge", service.cell.name, body.because), outcome)
    return await asyncio.to_thread(get_alarm, person, service, ident)


async def _tell(service: ServiceOf, person: Person, codes: list[str], because: str) -> str:
    """The cell writes it down and shows it. Raises ApiError."""
    outcome = "failed"
    try:
        reply = await service.link.command("acknowledge", person.name, because, {"codes": codes}, client=person.client)
        outcome = "ok" if reply.ok else f"refused: {reply.error}"
    except CellAbsentError as error:
        outcome = f"no answer: {error}"
        raise ApiError(503, "The cell process does not answer", str(error), ABSENT_HINT) from None
    finally:
        await service.deeds.note(service.store, person.deed("acknowledge", service.cell.name, because or ", ".join(codes)), outcome)
    if not reply.ok:
        raise refused(reply.error, reply.hint, reply.kind)
    return outcome
