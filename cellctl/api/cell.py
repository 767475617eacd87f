"""The cell: its snapshot, its commands, its events. Commands name the end state and are harmless twice."""

from __future__ import annotations

import asyncio
from enum import StrEnum
from typing import Annotated, Any, Literal

import httpx
import msgspec
from fastapi import APIRouter, Query, Request
from fastapi.responses import Response

from cellctl.api.cell_link import CellAbsentError
from cellctl.api.context import Service
from cellctl.api.feed import event_document
from cellctl.api.models import About, CellCommand, CommandAnswer, ControlAsked, EventItem, Events
from cellctl.api.parts import Cursor, Limit, Since, Until
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.runs import StartRefusedError
from cellctl.api.sign_in import Operator, Person, ServiceOf, Viewer
from cellctl.api.table import check_found, check_free, found_of
from cellctl.domain.jobs import JobState
from cellctl.domain.messages import Reply
from cellctl.planning.keys import software_version
from cellctl.store import history, jobs
from cellctl.store.pages import cursor_of, seq_of
from cellctl.tls import pinned_context

router = APIRouter(prefix="/api/v1/cell", tags=["cell"], responses=DOCUMENTED)
ABSENT_HINT = "it is restarted by itself; if it stays away look at the service's log; the E-stop works in any case"
STOP_TIMEOUT_S = 2.0
PERCENTS = ("feed_percent", "laser_percent", "powder_percent")


class Verb(StrEnum):
    """What a person may tell the cell."""

    START = "start"
    HOLD = "hold"
    RESUME = "resume"
    ABORT = "abort"
    STOP = "stop"
    RESET = "reset"
    HOME = "home"
    UNLOCK = "unlock"
    CONFIRM_POSITION = "confirm_position"
    JOG = "jog"
    OVERRIDE = "override"


@router.get(
    "", responses={200: {"content": {"application/json": {"schema": {"$ref": "#/components/schemas/Snapshot"}}}}}
)
def get_snapshot(_person: Viewer, service: ServiceOf) -> Response:
    """The newest snapshot of the cell. 503 if none is younger than a second: an old one would say nothing about now."""
    snapshot = service.link.fresh
    if snapshot is None:
        raise ApiError(503, "The cell process does not answer", "no snapshot within the last second", ABSENT_HINT)
    return Response(msgspec.json.encode(snapshot), media_type="application/json", headers={"Cache-Control": "no-store"})


@router.get("/about")
def about(request: Request, service: ServiceOf) -> About:
    """Which cell this is and where STOP goes. Open to everybody: stopping needs no sign-in."""
    cell = service.cell
    return About(cell=cell.name, mode=cell.mode, version=software_version(), stop_url=service.stop_url(request))


@router.get("/facts", response_model=dict[str, Any])
def facts(_person: Viewer, service: ServiceOf) -> dict[str, Any]:
    """The facts of the cell: axes, limits, tools, placement."""
    return service.cell.model_dump(mode="json")


@router.get("/events")
def list_events(
    _person: Viewer,
    service: ServiceOf,
    cursor: Cursor = None,
    limit: Limit = 50,
    job: Annotated[str | None, Query(max_length=60)] = None,
    kind: Annotated[str | None, Query(max_length=60)] = None,
    since: Since = None,
    until: Until = None,
) -> Events:
    """Events, newest first; those that all given filters let through."""
    before = seq_of(cursor) if cursor is not None else None
    with service.store.read_cell() as rows:
        found = history.events_before(rows, before, limit + 1, job, kind, since, until)
    items = [EventItem.model_validate(event_document(event)) for event in found[:limit]]
    return Events(items=items, next=cursor_of(items[-1].seq) if len(found) > limit else None)


def _arguments(verb: Verb, body: CellCommand) -> dict[str, Any]:
    """What the verb needs. Raises ApiError 422."""
    percents = {name: value for name in PERCENTS if (value := getattr(body, name)) is not None}
    if (verb is Verb.OVERRIDE) != bool(percents):
        given = ", ".join(percents)
        detail = f"override needs one of {', '.join(PERCENTS)}" if verb is Verb.OVERRIDE else f"{given} does not belong to {verb.value}"
        raise ApiError(422, "The request does not fit", detail, "percent of what is programmed, for override alone")
    if verb is Verb.JOG:
        if body.axis is None or body.distance is None or body.feed is None:
            raise ApiError(
                422,
                "The request does not fit",
                "jog needs axis, distance and feed",
                "distance in mm or deg, feed per minute",
            )
        return {"axis": body.axis, "distance": body.distance, "feed": body.feed, "continuous": body.continuous}
    if body.axis is not None or body.distance is not None or body.feed is not None or body.continuous:
        raise ApiError(
            422, "The request does not fit", f"axis, distance and feed do not belong to {verb.value}", "leave them out"
        )
    if verb is not Verb.START and (body.job is not None or body.table_clear or body.part_untouched):
        raise ApiError(
            422, "The request does not fit", f"job, table_clear and part_untouched do not belong to {verb.value}", "leave them out"
        )
    return percents


async def _stop_without_link(service: Service, person: Person, body: CellCommand) -> Reply:
    """The way of the console's button: straight to the stop listener. Raises CellAbsentError."""
    port = service.stop_port
    document = {"id": body.id or "", "because": f"{person.name}: {body.because or 'stop'}"}
    try:
        cert = service.settings.tls_cert
        verify = pinned_context(cert) if cert is not None else True
        async with httpx.AsyncClient(timeout=STOP_TIMEOUT_S, trust_env=False, verify=verify) as client:
            answer = await client.post(f"{service.stop_scheme}://127.0.0.1:{port}/stop", json=document)
        answer.raise_for_status()
    except httpx.HTTPError as error:
        raise CellAbsentError(f"neither its socket nor its stop listener answers ({type(error).__name__})") from None
    return Reply(id=body.id or "", ok=True, data=answer.json())


async def _send(service: Service, person: Person, verb: Verb, body: CellCommand) -> Reply:
    """Carry the command to the cell. Raises CellAbsentError, StartRefusedError, ApiError."""
    if verb is Verb.START:
        return await _start(service, person, body)
    because = body.because or ("" if verb is Verb.CONFIRM_POSITION else f"{verb.value} by {person.name}")
    arguments = _arguments(verb, body)
    if verb is not Verb.STOP:
        return await service.link.command(verb.value, person.name, because, arguments, body.id, client=person.client)
    try:
        return await service.link.command(
            verb.value, person.name, because, arguments, body.id, timeout_s=STOP_TIMEOUT_S, client=person.client
        )
    except CellAbsentError:
        return await _stop_without_link(service, person, body)


async def _start(service: Service, person: Person, body: CellCommand) -> Reply:
    """Start a queued job whose table is, or hereby is, confirmed clear."""
    _arguments(Verb.START, body)
    job_id = body.job
    if job_id is None:
        raise ApiError(422, "The request does not fit", "start needs job", "name an approved job")

    def confirmed() -> jobs.JobRow:
        with service.store.write() as rows:
            job = jobs.get(rows, job_id)
            if job.state is not JobState.QUEUED:
                raise ApiError(
                    409, "Not in this state", f"{job.name} is {job.state.value}, not queued", "approve it first"
                )
            if job.cell != service.cell.name:
                raise ApiError(409, "Another cell", f"{job.name} is {job.cell}'s, this is {service.cell.name}", "start it at its own cell")
            check_found(job, body.table_clear, body.part_untouched)
            is_found = body.table_clear or body.part_untouched
            if is_found:
                check_free(rows, job.cell)
            if not is_found and not job.table_clear:
                found = found_of(job)
                raise ApiError(
                    409, found.title, f"{job.name}: nobody confirmed that {found.what}", f"look, then set {found.field}"
                )
            if not is_found:  # who starts by hand relies on what another found, and answers for it from here on
                return jobs.change(rows, job_id, confirmed_by=person.name, confirmed_client=person.client)
            return jobs.confirm_table(rows, job_id, service.store.clock(), person.name, person.client)

    job = await asyncio.to_thread(confirmed)
    return await service.runs.start(job, person.name, body.because or "started by hand")


PRESENT = {"present": "present", "keep": "jog_keep", "end": "jog_end"}


async def _sign_of_life(service: Service, person: Person, verb: str) -> CommandAnswer:
    """What is neither written down nor carried out once only. Raises ApiError."""
    try:
        reply = await service.link.command(verb, person.name, "", client=person.client, timeout_s=STOP_TIMEOUT_S)
    except CellAbsentError as error:
        raise ApiError(503, "The cell process does not answer", str(error), ABSENT_HINT) from None
    if not reply.ok:
        raise refused(reply.error, reply.hint, reply.kind)
    return CommandAnswer(ok=True, state=str(reply.data.get("state", "")), data=reply.data)


def refused(error: str, hint: str, kind: str = "") -> ApiError:
    """The cell's refusal as a problem."""
    if kind == "store":
        return ApiError(503, "The journal cannot be written", error, hint, {"Retry-After": "5"})
    return ApiError(409, "Another client has control" if kind == "control" else "The cell refused", error, hint)


@router.post("/control")
async def control(person: Operator, service: ServiceOf, body: ControlAsked) -> CommandAnswer:
    """Take control of the cell, take it over from another client (with a reason), give it back, or tell that one is still there.

    The client is what X-Client-Id says, else the token. A stop needs no control.
    """
    if body.action == "present":
        return await _sign_of_life(service, person, PRESENT["present"])
    verb, outcome = f"{body.action}_control", "failed"
    try:
        reply = await service.link.command(verb, person.name, body.because, client=person.client)
        outcome = "ok" if reply.ok else f"refused: {reply.error}"
    except CellAbsentError as error:
        outcome = f"no answer: {error}"
        raise ApiError(503, "The cell process does not answer", str(error), ABSENT_HINT) from None
    finally:
        await service.deeds.note(service.store, person.deed(verb, service.cell.name, body.because), outcome)
    if not reply.ok:
        raise refused(reply.error, reply.hint, reply.kind)
    return CommandAnswer(ok=True, state=str(reply.data.get("state", "")), data=reply.data)


@router.post("/jog/{what}")
async def jog_on(person: Operator, service: ServiceOf, what: Literal["keep", "end"]) -> CommandAnswer:
    """The button of a continuous jog is still held (to be said more often than the cell file's jog_repeat_s), or let go."""
    return await _sign_of_life(service, person, PRESENT[what])


@router.post("/{verb}")
async def command(person: Operator, service: ServiceOf, verb: Verb, body: CellCommand) -> CommandAnswer:
    """Command the cell. Answered when the cell has accepted it and written it down."""
    target = body.job or service.cell.name
    outcome = "failed"
    try:
        reply = await _send(service, person, verb, body)
        outcome = "ok" if reply.ok else f"refused: {reply.error}"
    except CellAbsentError as error:
        outcome = f"no answer: {error}"
        raise ApiError(503, "The cell process does not answer", str(error), ABSENT_HINT) from None
    except StartRefusedError as error:
        outcome = f"refused: {error.message}"
        raise refused(error.message, error.hint, error.kind) from None
    except ApiError as error:
        outcome = f"refused: {error.detail}"
        raise
    finally:
        await service.deeds.note(service.store, person.deed(verb.value, target, body.because), outcome)
    if not reply.ok:
        raise refused(reply.error, reply.hint, reply.kind)
    service.runs.wake()
    snapshot = service.link.snapshot
    state = str(reply.data.get("state") or (snapshot.state if snapshot else ""))
    return CommandAnswer(ok=True, state=state, data=reply.data)
