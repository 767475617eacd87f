"""Touch-off and tool table: points are read where the machine stands, fitted, compared with what stands, and adopted with a reason."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any

import msgspec
from fastapi import APIRouter, Depends, Response

from cellctl.api.cell import ABSENT_HINT, refused
from cellctl.api.cell_link import CellAbsentError
from cellctl.api.context import Service
from cellctl.api.jobs import document as job_document
from cellctl.api.models import Because_, Job
from cellctl.api.models_hand import (
    Adoption,
    MeasuredState,
    MeasuredVersion,
    Point,
    PointAsked,
    ToolAsked,
    ToolRow,
    TouchOff,
    TouchOffResult,
)
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import Operator, Person, ServiceOf, Viewer, needs
from cellctl.domain.jobs import JobState
from cellctl.domain.measured import Measured, MeasuredError, ToolMeasured, check
from cellctl.measuring import touch_off
from cellctl.measuring.touch_off import Found, Touched, TouchOffError
from cellctl.store import audit, jobs, measured
from cellctl.store.tokens import Role
from config.cell import Cell
from planner.errors import PlannerError

router = APIRouter(prefix="/api/v1", tags=["by hand"], responses=DOCUMENTED)
VERSIONS = 50
Engineer = Annotated[Person, Depends(needs(Role.ENGINEER))]
TITLE = "The points tell nothing"


@router.get("/cell/measured")
async def get_measured(_person: Viewer, service: ServiceOf) -> MeasuredState:
    """Placement as it stands, and the versions of what was measured, newest first."""

    def read() -> list[measured.Version]:
        with service.store.read_cell() as rows:
            return measured.versions(rows, service.cell.name, VERSIONS)

    found = await asyncio.to_thread(read)
    cell = service.cell
    rotary = [joint for joint in (*cell.kinematics.table, *cell.kinematics.head) if cell.axis(joint.axis).kind == "rotary"]
    return MeasuredState(
        cell_sha256=cell.sha256,
        part_origin_mm=cell.placement.part_origin_mm,
        pivots_mm={joint.axis: cell.placement.pivots_mm.get(joint.axis, joint.point_mm) for joint in rotary},
        versions=[MeasuredVersion(seq=v.seq, at=v.at, who=v.who, because=v.because, what=v.what, points=v.points) for v in found],
    )


@router.post("/cell/touch_off/point")
async def touch(_person: Operator, service: ServiceOf, body: PointAsked) -> Point:
    """Where the machine stands now, as a point. Refused while it moves, or while its position is not to be trusted."""
    now = service.link.fresh
    if now is None:
        raise ApiError(503, "The cell process does not answer", "no snapshot within the last second", ABSENT_HINT)
    if now.state != "IDLE" or now.cnc.state != "Idle":
        raise ApiError(409, "The machine does not stand", f"the cell is {now.state}, the CNC {now.cnc.state}", "wait until it stands")
    if now.position:
        raise ApiError(409, "The position is not to be trusted", now.position, "home the machine first")
    tool = body.tool or now.cnc.tool
    if not tool:
        raise ApiError(409, "No tool is known", "the control does not tell which tool is mounted", "say which tool touches")
    return Point(joints={letter: now.cnc.machine[letter] for letter in service.cell.letters if letter in now.cnc.machine}, tool=tool)


@router.post("/cell/touch_off/fit")
def fit(_person: Viewer, service: ServiceOf, body: TouchOff) -> TouchOffResult:
    """What the points say, what is left over, and how far it is from what stands. Changes nothing."""
    return _result(service, body, _fitted(service.cell, body))


def _fitted(cell: Cell, body: TouchOff) -> Found:
    """Raises ApiError 422."""
    for point in body.points:
        if set(point.joints) != set(cell.letters):
            raise ApiError(422, TITLE, f"a point has axes {', '.join(point.joints)}", f"this machine has {', '.join(cell.letters)}")
    points = [Touched(dict(point.joints), point.tool) for point in body.points]
    try:
        if body.kind == "pivot":
            return touch_off.centre_of_rotation(cell, body.axis or "", points)
        if body.kind == "plane":
            return touch_off.substrate_plane(cell, points)
        if body.kind == "origin":
            return touch_off.part_origin(cell, points)
        return touch_off.tool_length(cell, body.tool or 0, body.block_mm, points)
    except (TouchOffError, PlannerError) as error:
        raise ApiError(422, TITLE, error.message, error.hint) from None
    except KeyError as error:
        raise ApiError(422, TITLE, f"no axis {error}", f"this machine has {', '.join(cell.letters)}") from None


def _result(service: Service, body: TouchOff, found: Found) -> TouchOffResult:
    why = _why_not(service, body, found)
    name = {"pivot": f"pivot of {body.axis}", "plane": "substrate plane", "origin": "part origin", "tool": f"T{body.tool}"}[body.kind]
    return TouchOffResult(
        kind=body.kind, name=name, value_mm=found.value, before_mm=found.before, shift_mm=found.shift_mm,
        residuals_mm=list(found.residuals_mm), residual_mm=found.residual_mm, tilt_deg=found.tilt_deg, adoptable=not why, why=why,
    )  # fmt: skip


def _why_not(service: Service, body: TouchOff, found: Found) -> str:
    by_hand = service.cell.by_hand
    if found.residual_mm > by_hand.residual_max_mm:
        told = f"the points disagree by {found.residual_mm:.3f} mm, at most {by_hand.residual_max_mm:g} mm"
        return f"{told}: remove the one that is off and touch again"
    if found.tilt_deg > by_hand.tilt_max_deg:
        told = f"the substrate is tilted by {found.tilt_deg:.3f} deg, at most {by_hand.tilt_max_deg:g} deg"
        return f"{told}: programs are posted for a level one, shim it"
    try:
        check(service.standing.filed, _with(service, body, found))
    except MeasuredError as error:
        return f"{error.message}: {error.hint}"
    return ""


def _with(service: Service, body: TouchOff, found: Found) -> Measured:
    """What stands, with this measurement in it."""
    stands = _stands(service)
    if body.kind == "pivot":
        return msgspec.structs.replace(stands, pivots_mm={**stands.pivots_mm, body.axis or "": found.value})
    if body.kind in ("plane", "origin"):
        return msgspec.structs.replace(stands, part_origin_mm=found.value)
    number = body.tool or 0
    tool = touch_off.tool_of(service.cell, number)
    before = stands.tools.get(number)
    wear = before.length_wear_mm if before else 0.0
    length = -found.value[2] + wear
    one = msgspec.structs.replace(before, length_mm=length) if before else ToolMeasured(length, tool.diameter_mm)
    return msgspec.structs.replace(stands, tools={**stands.tools, number: one})


def _stands(service: Service) -> Measured:
    with service.store.read_cell() as rows:
        newest = measured.newest(rows, service.cell.name)
    return newest.document if newest is not None else Measured()


@router.post("/cell/touch_off/adopt")
async def adopt(person: Operator, service: ServiceOf, body: Adoption) -> TouchOffResult:
    """Let the measurement stand from now on: the cell moves by it, programs are posted for it, and older ones are refused at their start."""
    found = _fitted(service.cell, body)
    result = await asyncio.to_thread(_result, service, body, found)
    if not body.because.strip():
        raise ApiError(422, "A reason is needed", "because is empty", "say why it was measured")
    if not result.adoptable:
        raise ApiError(409, "Not to be adopted", result.why, "measure again")
    document = await asyncio.to_thread(_with, service, body, found)
    x, y, z = found.shift_mm
    what = f"{result.name}: {x:+.3f} {y:+.3f} {z:+.3f} mm, residual {found.residual_mm:.3f} mm"
    await _stand(service, person, document, what, body.because, body.id, body.model_dump(include={"kind", "axis", "tool", "block_mm", "points"}))
    return result


async def _stand(service: Service, person: Person, document: Measured, what: str, because: str, ident: str | None, points: dict[str, Any]) -> None:
    """Tell the cell, which writes it down; then post and prove for it. Raises ApiError."""
    outcome = "failed"
    try:
        args = {"document": msgspec.to_builtins(document, str_keys=True), "what": what, "points": points}
        reply = await service.link.command("measured", person.name, because, args, ident, client=person.client)
        outcome = f"ok: {what}" if reply.ok else f"refused: {reply.error}"
    except CellAbsentError as error:
        outcome = f"no answer: {error}"
        raise ApiError(503, "The cell process does not answer", str(error), ABSENT_HINT) from None
    finally:
        await service.deeds.note(service.store, person.deed("measured", service.cell.name, because), outcome)
    if not reply.ok:
        raise refused(reply.error, reply.hint, reply.kind)
    await asyncio.to_thread(service.standing.read)
    service.queue.use_cell(service.standing.cell, service.standing.file)


@router.get("/cell/tools")
async def list_tools(_person: Viewer, service: ServiceOf) -> list[ToolRow]:
    """The tools as they stand, beside the cell file's figures."""
    stands = await asyncio.to_thread(_stands, service)
    return [_row(service, number, stands) for number in (tool.number for tool in service.standing.filed.tools)]


def _row(service: Service, number: int, stands: Measured) -> ToolRow:
    filed = touch_off.tool_of(service.standing.filed, number)
    one = stands.tools.get(number)
    now = one or ToolMeasured(-filed.tip_mm[2], filed.diameter_mm)
    return ToolRow(
        number=number, name=filed.name, kind=filed.kind, filed_length_mm=-filed.tip_mm[2], filed_diameter_mm=filed.diameter_mm,
        length_mm=now.length_mm, diameter_mm=now.diameter_mm, length_wear_mm=now.length_wear_mm, diameter_wear_mm=now.diameter_wear_mm,
        measured=one is not None,
    )  # fmt: skip


@router.put("/cell/tools/{number}")
async def put_tool(person: Operator, service: ServiceOf, number: int, body: ToolAsked) -> ToolRow:
    """Length, diameter and wear of a tool, as measured; refused out of bounds."""
    stands = await asyncio.to_thread(_stands, service)
    one = ToolMeasured(body.length_mm, body.diameter_mm, body.length_wear_mm, body.diameter_wear_mm)
    document = msgspec.structs.replace(stands, tools={**stands.tools, number: one})
    try:
        check(service.standing.filed, document)
    except MeasuredError as error:
        raise ApiError(422, "Out of bounds", error.message, error.hint) from None
    what = f"T{number}: length {body.length_mm:g} mm less {body.length_wear_mm:g}, diameter {body.diameter_mm:g} mm less {body.diameter_wear_mm:g}"
    await _stand(service, person, document, what, body.because, body.id, {})
    return _row(service, number, document)


@router.delete("/cell/measured", status_code=204)
async def forget(person: Engineer, service: ServiceOf, because: str) -> Response:
    """Back to the cell file's placement and tools; what was measured stays among the versions."""
    await _stand(service, person, Measured(), "back to the cell file", because, None, {})
    return Response(status_code=204)


@router.post("/jobs/{job_id}/post_again")
async def post_again(person: Operator, service: ServiceOf, job_id: str, body: Because_) -> Job:
    """Post and prove a waiting job for the cell as it stands now; a person approves it again. Nothing to do is harmless."""

    def write() -> jobs.JobRow:
        now = service.store.clock()
        with service.store.write() as rows:
            job = jobs.get(rows, job_id)
            if job.continues_job is not None:
                raise ApiError(
                    409, "Not in this state", f"{job.name} goes on with a part that was begun on the earlier placement", "cancel it, or measure back"
                )
            if job.state not in (JobState.QUEUED, JobState.WAITING_FOR_APPROVAL) or job.claimed_by:
                raise ApiError(409, "Not in this state", f"{job.name} is {job.state.value}", "only a job that waits can be posted again")
            audit.add(rows, person.deed("post_again", job_id, body.because), now, "ok")
            return jobs.move(
                rows, job_id, JobState.SUBMITTED, at=now, why="to be posted for the cell as it was measured", table_clear=False, approved_by=""
            )

    job = await asyncio.to_thread(write)
    service.queue.wake()
    service.feed.take_job(job_id)
    return job_document(service, job)
