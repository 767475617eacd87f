"""Going on with the part of an interrupted job: from where, and the new job that does it; and the begin of its generated program."""

from __future__ import annotations

import asyncio
from itertools import islice
from typing import Any, Literal

from fastapi import APIRouter
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field, model_validator

from cellctl.api.context import Service
from cellctl.api.jobs import document, is_added
from cellctl.api.models import Because, Job, Strict
from cellctl.api.parts import IdempotencyKey
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import Operator, Person, ServiceOf, Viewer
from cellctl.api.standing import ResumptionPoint, metal_end, operations_of, resumption_point, why_none
from cellctl.store import audit, dependencies, idempotency, jobs, lineage, threads
from cellctl.store.ids import new_id
from cellctl.store.jobs import JobRow

router = APIRouter(prefix="/api/v1/jobs/{job_id}", tags=["resumption"], responses=DOCUMENTED)
LINES_BEHIND_JOINT = 12
HEAD_LINES_MAX = 500


class Resumption(Strict):
    """How to go on. layer: with from=layer, index from 0; operation: with from=operation, its number over the whole plan;
    overlap_mm: of the bead that is run again, default one bead's width"""

    from_: Literal["metal_end", "layer", "operation"] = Field("metal_end", alias="from")
    layer: int | None = Field(None, ge=0, le=10**7)
    operation: int | None = Field(None, ge=0, le=10**7)
    overlap_mm: float | None = Field(None, ge=0.0, le=1000.0)
    because: str = Because

    @model_validator(mode="after")
    def _fits(self) -> Resumption:
        for name in ("layer", "operation"):
            if (self.from_ == name) != (getattr(self, name) is not None):
                raise ValueError(f"{name} belongs to from={name}, and only to it")
        return self


class ProgramHead(BaseModel):
    """The begin of a program, to be read. head_lines: those that were generated for the joint; the others are the first of what follows"""

    lines: list[str]
    head_lines: int
    lines_total: int


@router.get("/resumption-point")
def get_point(_person: Viewer, service: ServiceOf, job_id: str) -> ResumptionPoint:
    """Where metal ended in a job that was interrupted, how that is known, and what one may go on from."""
    with service.store.read() as rows, service.store.read_cell() as cell_rows:
        return resumption_point(service.store, rows, cell_rows, jobs.get(rows, job_id))


@router.post("/resume", status_code=202, response_model=Job)
async def resume(
    person: Operator, service: ServiceOf, job_id: str, body: Resumption, idempotency_key: IdempotencyKey = None
) -> JSONResponse:
    """Go on with the part of an interrupted job: a new job, whose program is generated and proved, and then waits for approval.

    It has the priority and the tags of the first; who waited for that one waits for the new one.
    """
    answer, is_new = await asyncio.to_thread(_resume, service, person, job_id, body, idempotency_key)
    if is_new:
        is_added(service, answer["id"])
    return JSONResponse(answer, 202)


def _resume(service: Service, person: Person, job_id: str, body: Resumption, key: str | None) -> tuple[dict[str, Any], bool]:
    """(the answer, whether the job is new). Raises ApiError, NotFoundError, KeyReusedError."""
    digest = idempotency.request_digest("resume", job_id, body.model_dump())
    now = service.store.clock()
    with service.store.write() as rows, service.store.read_cell() as cell_rows:
        earlier = idempotency.answered(rows, person.name, key, digest)
        if earlier is not None:
            return earlier, False
        before = jobs.get(rows, job_id)
        why = why_none(rows, cell_rows, before)
        end = metal_end(service.store, cell_rows, before) if not why else None
        if why or end is None:
            raise ApiError(409, "It cannot go on", why or f"every line of {before.name} was executed", "see the job's resumption-point")
        _check_choice(service, before, body)
        asked = {"from": body.from_, "layer": body.layer, "operation": body.operation, "overlap_mm": body.overlap_mm}
        point = {**asked, "line": end.line, "fraction": end.fraction, "known_by": end.known_by, "because": body.because}
        row = JobRow(
            new_id("job", now), _name(lineage.chain_of(rows, before)), before.part_id, before.cell, before.recipe_toml, before.material,
            now, person.name, plan_sha256=before.plan_sha256, layers=before.layers, continues_job=before.id, resume_point=point,
            material_sha256=before.material_sha256, cell_wanted=before.cell, priority=before.priority, tags=before.tags,
            cell_sha256=service.cell.sha256 if before.cell == service.cell.name else before.cell_sha256,
        )  # fmt: skip
        jobs.add(rows, row)
        threads.set_tags(rows, row.id, row.tags)
        for ended in (before, *lineage.continued_by(rows, before.id)):
            if ended.id != row.id:
                dependencies.hand_over(rows, ended.id, row.id)
        answer = document(service, jobs.get(rows, row.id), rows).model_dump()
        idempotency.remember(rows, person.name, key, digest, answer, now)
        for target in (before.id, row.id):
            audit.add(rows, person.deed("resume", target, body.because), now, f"ok: {row.id} continues {before.id}")
    return answer, True


def _check_choice(service: Service, job: JobRow, body: Resumption) -> None:
    """Whether the plan has what is asked for. Raises ApiError."""
    if body.from_ == "metal_end":
        return
    asked = body.layer if body.from_ == "layer" else body.operation
    known = sorted({getattr(choice, body.from_) for choice in operations_of(service.store, job)})
    if known and asked not in known:
        raise ApiError(
            422, "The request does not fit", f"{body.from_} {asked}: {job.name} has no such {body.from_} with passes",
            f"there are {known[0]} to {known[-1]}",
        )  # fmt: skip


def _name(chain: list[JobRow]) -> str:
    return f"{chain[0].name}, continued" + (f" ({len(chain)})" if len(chain) > 1 else "")


@router.get("/program/head")
def get_head(_person: Viewer, service: ServiceOf, job_id: str) -> ProgramHead:
    """The first lines of a job's program as text: of a job that goes on with another, all that was generated, and what follows the joint."""
    with service.store.read() as rows:
        job = jobs.get(rows, job_id)
    if job.program_sha256 is None:
        raise ApiError(404, "Not there yet", f"{job.name} has no program (it is {job.state.value})", "look at the job's state")
    head = min(int((job.resumption or {}).get("head_lines", 0)), HEAD_LINES_MAX)
    lines: list[str] = []
    for path in sorted(service.store.blobs.program(job.program_sha256).glob("layer_*.ngc")):
        with path.open(encoding="ascii", errors="replace") as file:
            lines += [line.rstrip("\n") for line in islice(file, head + LINES_BEHIND_JOINT - len(lines))]
        if len(lines) >= head + LINES_BEHIND_JOINT:
            break
    return ProgramHead(lines=lines, head_lines=head, lines_total=job.lines_total)
