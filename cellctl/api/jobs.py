"""Jobs: submitting, approving, cancelling, and what they are doing."""

from __future__ import annotations

import asyncio
import tomllib
from collections.abc import Sequence
from typing import Annotated, Any

import tomli_w
from fastapi import APIRouter, Query
from pydantic import ValidationError
from sqlalchemy import Connection

from cellctl.api import models_jobs as told
from cellctl.api.asked_cell import cell_for
from cellctl.api.conditional import IfMatch, check_unchanged, etag_of_document
from cellctl.api.context import Service
from cellctl.api.models import Approval, Because_, Job, JobError, Jobs, NewJob
from cellctl.api.models_jobs import TAGS_MAX, TIME_MAX
from cellctl.api.parts import Cursor, IdempotencyKey, Limit
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import Operator, Person, ServiceOf, Viewer
from cellctl.api.table import check_found, check_free, found_of
from cellctl.api.waits import waits_of, why_of
from cellctl.domain.jobs import ENDED, ON_CELL, JobState
from cellctl.faults import one_line
from cellctl.planning.dispatcher import needs_of_part
from cellctl.planning.view import layers_written
from cellctl.store import audit, dependencies, idempotency, job_search, jobs, parts, threads, versions
from cellctl.store.dependencies import Dependency
from cellctl.store.ids import new_id
from cellctl.store.job_search import Asked, Sort
from cellctl.store.jobs import JobRow
from cellctl.store.parts import NotFoundError
from cellctl.store.tokens import Role
from config import ConfigError, explain
from planner.errors import RecipeError
from planner.recipe import Recipe, parse_recipe

J = JobState
Word = Annotated[str, Query(max_length=60)]
router = APIRouter(prefix="/api/v1/jobs", tags=["jobs"], responses=DOCUMENTED)


def document(service: Service, row: JobRow, rows: Connection | None = None) -> Job:
    """A job as it is told, with where the work on it stands now, and, where `rows` are given to look into, the jobs that it waits for."""
    found = dependencies.of_jobs(rows, [row.id])[row.id] if rows is not None else []
    return _document(service, row, found)


def documents(service: Service, found: Sequence[JobRow], rows: Connection) -> list[Job]:
    """Several jobs as they are told."""
    known = dependencies.of_jobs(rows, [row.id for row in found])
    return [_document(service, row, known[row.id]) for row in found]


def _document(service: Service, row: JobRow, after: Sequence[Dependency]) -> Job:
    at = service.queue.progress.get(row.id)
    progress = at.fraction if at else (row.lines_executed / row.lines_total if row.lines_total else 0.0)
    fields = {name: getattr(row, name) for name in Job.model_fields if hasattr(row, name)}
    drawing = service.queue.drawing(row.id)
    if drawing is not None:
        fields["layers"] = layers_written(drawing)
    silence = service.fleet.silence_of(row)
    waits = waits_of(row, after, service.store.clock(), silence)
    return Job(
        **{
            **fields,
            "state": row.state.value,
            "recipe": tomllib.loads(row.recipe_toml),
            "error": JobError(**row.error) if row.error else None,
            "stage": at.stage if at else row.state.value,
            "progress": 1.0 if row.state is J.COMPLETED else min(progress, 1.0),
            "why": silence or why_of(row, waits),
            "waits_for": waits,
            "after": [
                told.Dependency(job=one.on_job, name=one.name, state=one.state.value, until=one.until, met=one.is_met) for one in after
            ],
            "changes": row.changes or [],
        }
    )


def recipe_from(body: NewJob) -> Recipe:
    """The request's recipe, validated; it names materials and stock by name, never by a file. Raises RecipeError, ConfigError."""
    if body.recipe is not None and body.recipe_toml is not None:
        raise ApiError(422, "Two recipes", "recipe and recipe_toml are both given", "leave one out")
    if body.recipe_toml is not None:
        recipe = parse_recipe(body.recipe_toml, "recipe")
    else:
        try:
            recipe = Recipe.model_validate(body.recipe or {})
        except ValidationError as error:
            raise RecipeError(f"recipe: {explain(error)}", "correct the field that is named") from None
    if any(mark in recipe.material for mark in ("/", "\\", ".toml")):
        raise RecipeError(
            f"recipe: material: {recipe.material!r} is not a name", "name a material of GET /api/v1/materials"
        )
    return recipe


def pins_of(service: Service, rows: Connection, material: str) -> dict[str, str]:
    """The versions of material and cell that a job submitted now is made with. Raises ConfigError for a material that is not there."""
    try:
        newest = versions.material(rows, material)
    except NotFoundError:
        known = ", ".join(row.name for row in versions.materials(rows))
        raise ConfigError(f"recipe: material: there is no material {material[:60]!r}", f"there are: {known}") from None
    return {"material_sha256": newest.sha256, "cell_sha256": service.cell.sha256}


def check_can_come(other: JobRow, until: dependencies.Until) -> None:
    """Raises ApiError if a job is to wait for what can never be."""
    if until is dependencies.Until.COMPLETED and other.state in ENDED and other.state is not J.COMPLETED:
        raise ApiError(409, "It would wait for ever", f"{other.name} is {other.state.value} and will not be completed", "name another job")


def _submit(service: Service, person: Person, body: NewJob, key: str | None) -> tuple[dict[str, Any], bool]:
    """(the answer, whether the job is new)."""
    recipe = recipe_from(body)
    digest = idempotency.request_digest("job", body.model_dump())
    now = service.store.clock()
    with service.store.write() as rows:
        earlier = idempotency.answered(rows, person.name, key, digest)
        if earlier is not None:
            return earlier, False
        part = parts.get(rows, body.part_id)
        if recipe.stock is not None:
            parts.get(rows, recipe.stock)
        toml = tomli_w.dumps(recipe.model_dump(mode="json", exclude_none=True))
        name = one_line(body.name or part.name)
        extra: dict[str, Any] = {"priority": body.priority, "not_before": body.not_before}
        pins = pins_of(service, rows, recipe.material)
        extra |= pins | cell_for(service, rows, body.cell, needs_of_part(rows, part.id, recipe, pins["material_sha256"]))
        job = jobs.add(
            rows,
            JobRow(
                id=new_id("job", now), name=name, part_id=part.id, recipe_toml=toml, material=recipe.material, created_at=now,
                created_by=person.name, **extra,
            ),
        )  # fmt: skip
        threads.set_tags(rows, job.id, body.tags)
        for one in body.after:
            check_can_come(jobs.get(rows, one.job), one.until)
        dependencies.replace(rows, job.id, [(one.job, one.until) for one in body.after])
        answer = document(service, jobs.get(rows, job.id), rows).model_dump()
        idempotency.remember(rows, person.name, key, digest, answer, now)
        audit.add(rows, person.deed("submit", job.id), now, "ok")
    return answer, True


@router.post("", status_code=201)
async def submit(person: Operator, service: ServiceOf, body: NewJob, idempotency_key: IdempotencyKey = None) -> Job:
    """Submit a job. It is planned, posted and proved at once, then waits for approval."""
    answer, is_new = await asyncio.to_thread(_submit, service, person, body, idempotency_key)
    if is_new:
        is_added(service, answer["id"])
    return Job(**answer)


def is_added(service: Service, job_id: str) -> None:
    """A job was added: somebody gives it to a cell, or plans it."""
    service.feed.take_job(job_id)
    service.fleet.wake()
    service.queue.wake()


@router.get("")
def list_jobs(
    _person: Viewer,
    service: ServiceOf,
    cursor: Cursor = None,
    limit: Limit = 50,
    state: Annotated[list[JobState] | None, Query(description="only jobs in one of these states")] = None,
    tag: Annotated[list[Word] | None, Query(max_length=TAGS_MAX, description="only jobs with all of these tags")] = None,
    material: Word = "",
    part: Annotated[str, Query(max_length=60, description="only jobs of this part")] = "",
    cell: Annotated[str, Query(max_length=200, description="only jobs of this cell; any: those that wait for one")] = "",
    text: Annotated[str, Query(max_length=200, description="words, each in its name, id, tags, material, person, reason or a note")] = "",
    by: Annotated[str, Query(max_length=200, description="only jobs that this person submitted")] = "",
    created_from: Annotated[float | None, Query(ge=0, le=TIME_MAX, description="Unix time, s")] = None,
    created_to: Annotated[float | None, Query(ge=0, le=TIME_MAX, description="Unix time, s; before it")] = None,
    sort: Annotated[Sort, Query(description="newest first, or in the order of the queue")] = "newest",
) -> Jobs:
    """Jobs, newest first, or in the order of their queue. A cursor stays valid while jobs come and go."""
    asked = Asked(state or (), tag or (), material, part, text, created_from, created_to, by, cell)
    with service.store.read() as rows:
        found, following = job_search.find(rows, asked, sort, cursor, limit)
        return Jobs(items=documents(service, found, rows), next=following)


@router.get("/{job_id}")
def get_job(_person: Viewer, service: ServiceOf, job_id: str) -> Job:
    """One job."""
    with service.store.read() as rows:
        return document(service, jobs.get(rows, job_id), rows)


def check_seen(service: Service, rows: Connection, job: JobRow, if_match: str | None) -> None:
    """Raise ApiError 412 if the sender decided on another state of this job than it has now. Without If-Match nothing is asked."""
    if if_match is not None:
        check_unchanged(if_match, etag_of_document(document(service, job, rows)), job.name)


def check_approval(job: JobRow, person: Person, body: Approval) -> None:
    """Raise ApiError unless this person may approve this job: its proof passed, or an engineer gives a reason."""
    passed = bool(job.proof and job.proof.get("passed"))
    if passed or job.state is not J.WAITING_FOR_APPROVAL:
        return
    if not body.override_reason.strip():
        raise ApiError(
            409,
            "The proof did not pass",
            f"{job.name}: its proof did not pass, so it cannot be approved",
            "change the recipe; an engineer may give override_reason",
        )
    if not person.role.includes(Role.ENGINEER):
        raise ApiError(
            403,
            "Not allowed",
            f"only an engineer may override a proof; {person.name} is {person.role.value}",
            "ask an engineer",
        )


@router.post("/{job_id}/approve")
async def approve(person: Operator, service: ServiceOf, job_id: str, body: Approval, if_match: IfMatch = None) -> Job:
    """Approve a job. With `table_clear` (of a job that continues another: `part_untouched`) it starts as soon as the cell is idle;
    a queued one may be confirmed later by the same call."""

    def write() -> Job:
        now = service.store.clock()
        with service.store.write() as rows:
            job = jobs.get(rows, job_id)
            check_seen(service, rows, job, if_match)
            check_approval(job, person, body)
            check_found(job, body.table_clear, body.part_untouched)
            if job.state is not J.QUEUED:
                reasons = {"approve_because": body.because, "override_reason": body.override_reason}
                told_why = body.override_reason or body.because
                reason = f"{person.name} approved it" + (f": {told_why}" if told_why else "")
                changes: dict[str, Any] = {"why": found_of(job).missing, "approved_by": person.name, **reasons}
                job = jobs.move(rows, job_id, J.QUEUED, at=now, by=person.name, reason=reason, **changes)
            if body.table_clear or body.part_untouched:
                check_free(rows, job.cell)
                job = jobs.confirm_table(rows, job_id, now, person.name, person.client)
            audit.add(rows, person.deed("approve", job_id, body.override_reason or body.because), now, "ok")
            return document(service, job, rows)

    job = await asyncio.to_thread(write)
    service.feed.take_job(job_id)
    service.runs.wake()
    return job


@router.post("/{job_id}/cancel")
async def cancel(person: Operator, service: ServiceOf, job_id: str, body: Because_, if_match: IfMatch = None) -> Job:
    """Cancel a job that is not on the cell. Twice is harmless."""

    def write() -> JobRow:
        now = service.store.clock()
        with service.store.write() as rows:
            job = jobs.get(rows, job_id)
            if job.state is J.CANCELLED:
                return job
            check_seen(service, rows, job, if_match)
            if job.state in ON_CELL or job.claimed_by:
                where = "on the cell" if job.state in ON_CELL else f"about to be started on {job.cell}"
                raise ApiError(409, "Not in this state", f"{job.name} is {where}", "abort it with POST /api/v1/cell/abort")
            audit.add(rows, person.deed("cancel", job_id, body.because), now, "ok")
            reason = f"{person.name} cancelled it" + (f": {body.because}" if body.because else "")
            return jobs.move(rows, job_id, J.CANCELLED, at=now, by=person.name, reason=reason, why=body.because)

    job = await asyncio.to_thread(write)
    service.queue.cancel(job_id)
    service.feed.take_job(job_id)
    return document(service, job)
