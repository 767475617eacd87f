"""A job once more, with changes, or after it failed; its name, tags, order and dependencies; and the steps of its life."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

import tomli_w
from fastapi import APIRouter
from fastapi.responses import JSONResponse
from sqlalchemy import Connection

from cellctl.api.asked_cell import cell_for
from cellctl.api.conditional import IfMatch
from cellctl.api.context import Service
from cellctl.api.jobs import check_can_come, check_seen, document, is_added, pins_of, recipe_from
from cellctl.api.models import Job, NewJob
from cellctl.api.models_jobs import Again, Change, Clone, CloneShown, JobEdit, Life, Step
from cellctl.api.parts import IdempotencyKey
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import Operator, Person, ServiceOf, Viewer
from cellctl.domain.fleet import ANY
from cellctl.domain.jobs import ENDED, ON_CELL, JobState
from cellctl.faults import one_line
from cellctl.planning.dispatcher import needs_of_part
from cellctl.store import audit, dependencies, history, idempotency, jobs, lanes, parts, threads
from cellctl.store.ids import new_id
from cellctl.store.jobs import JobRow
from planner.recipe import Recipe

J = JobState
router = APIRouter(prefix="/api/v1/jobs/{job_id}", tags=["job life"], responses=DOCUMENTED)
ABSENT = object()


def _flat(document: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Fields by their dotted names."""
    found: dict[str, Any] = {}
    for name, value in document.items():
        if isinstance(value, dict):
            found |= _flat(value, f"{prefix}{name}.")
        else:
            found[prefix + name] = value
    return found


def changes_between(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[Change]:
    """What differs between two recipes, field by field in the order of their names."""
    old, new = _flat(before), _flat(after)
    names = sorted(name for name in old.keys() | new.keys() if old.get(name, ABSENT) != new.get(name, ABSENT))
    return [Change(field=name, before=old.get(name), after=new.get(name)) for name in names]


def _merged(before: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """A recipe with other fields in place of its own; None takes one away."""
    found = {name: value for name, value in before.items() if name not in over or over[name] is not None}
    for name, value in over.items():
        if isinstance(value, dict) and isinstance(found.get(name), dict):
            found[name] = _merged(found[name], value)
        elif value is not None:
            found[name] = value
    return found


def _told(recipe: Recipe) -> dict[str, Any]:
    return recipe.model_dump(mode="json", exclude_none=True)


def cloned_recipe(job: JobRow, over: Mapping[str, Any]) -> tuple[dict[str, Any], list[Change]]:
    """(the recipe of a clone, what differs). Raises RecipeError, ConfigError."""
    before = _told(recipe_from(NewJob(part_id="", recipe_toml=job.recipe_toml)))
    recipe = _told(recipe_from(NewJob(part_id="", recipe=_merged(before, over))))
    return recipe, changes_between(before, recipe)


def _check_own_part(job: JobRow) -> None:
    if job.continues_job is not None:
        raise ApiError(
            409, "It goes on with another", f"{job.name} is the rest of {job.continues_job}: it cannot be made by itself",
            f"make {job.continues_job} once more",
        )  # fmt: skip


Make = Callable[[Connection, JobRow, float], JobRow]


def _make(service: Service, person: Person, verb: str, job_id: str, body: Again, key: str | None, make: Make) -> tuple[dict[str, Any], bool]:
    """(the answer, whether the job is new): once for each key. Raises ApiError, NotFoundError, KeyReusedError."""
    digest = idempotency.request_digest(verb, job_id, body.model_dump())
    now = service.store.clock()
    with service.store.write() as rows:
        earlier = idempotency.answered(rows, person.name, key, digest)
        if earlier is not None:
            return earlier, False
        before = jobs.get(rows, job_id)
        _check_own_part(before)
        job = make(rows, before, now)
        threads.set_tags(rows, job.id, job.tags)
        answer = document(service, job, rows).model_dump(mode="json")
        idempotency.remember(rows, person.name, key, digest, answer, now)
        for target in (before.id, job.id):
            audit.add(rows, person.deed(verb, target, body.because), now, f"ok: {job.id} from {before.id}")
    return answer, True


async def _submitted(service: Service, answer: dict[str, Any], is_new: bool) -> JSONResponse:
    if is_new:
        is_added(service, answer["id"])
    return JSONResponse(answer, 201)


def _like(job: JobRow, person: Person, now: float, how: str, **fields: Any) -> JobRow:
    """A fresh job of the same part, recipe and priority."""
    values: dict[str, Any] = {"recipe_toml": job.recipe_toml, "material": job.material, "name": job.name, "tags": job.tags}
    values |= {"material_sha256": job.material_sha256, "cell_sha256": job.cell_sha256}  # the same versions, unless it is changed
    values |= {"cell": job.cell, "cell_wanted": job.cell_wanted}
    if job.cell_wanted == ANY:
        values |= {"cell": "", "cell_sha256": ""}
    values |= fields
    return JobRow(
        id=new_id("job", now), part_id=job.part_id, created_at=now, created_by=person.name, priority=job.priority,
        made_from=job.id, made_how=how, **values,
    )  # fmt: skip


@router.post("/rerun", status_code=201, response_model=Job)
async def rerun(person: Operator, service: ServiceOf, job_id: str, body: Again, idempotency_key: IdempotencyKey = None) -> JSONResponse:
    """The same once more: a new job of the same part and recipe. Plan, program and proof that were made are used again; a person approves anew."""

    def make(rows: Connection, job: JobRow, now: float) -> JobRow:
        return jobs.add(rows, _like(job, person, now, "rerun", name=one_line(body.name or job.name)))

    return await _submitted(service, *await asyncio.to_thread(_make, service, person, "rerun", job_id, body, idempotency_key, make))


@router.post("/clone/changes")
def show_clone(_person: Viewer, service: ServiceOf, job_id: str, body: Clone) -> CloneShown:
    """What a clone with these changes would be: its whole recipe, and what differs. Makes nothing."""
    with service.store.read() as rows:
        job = jobs.get(rows, job_id)
    recipe, changes = cloned_recipe(job, body.recipe)
    return CloneShown(recipe=recipe, changes=changes)


@router.post("/clone", status_code=201, response_model=Job)
async def clone(person: Operator, service: ServiceOf, job_id: str, body: Clone, idempotency_key: IdempotencyKey = None) -> JSONResponse:
    """A new job of the same part with another recipe; `changes` tells what differs."""

    def make(rows: Connection, job: JobRow, now: float) -> JobRow:
        recipe, changes = cloned_recipe(job, body.recipe)
        if recipe.get("stock"):
            parts.get(rows, recipe["stock"])
        told = [{"field": one.field, "before": one.before, "after": one.after} for one in changes]
        tags = job.tags if body.tags is None else body.tags
        fields = {"recipe_toml": tomli_w.dumps(recipe), "material": recipe["material"], "changes": told, "tags": tags}
        pins = pins_of(service, rows, recipe["material"])
        needs = needs_of_part(rows, job.part_id, recipe_from(NewJob(part_id="", recipe=recipe)), pins["material_sha256"])
        fields |= pins | cell_for(service, rows, job.cell_wanted, needs)
        return jobs.add(rows, _like(job, person, now, "clone", name=one_line(body.name or job.name), **fields))

    return await _submitted(service, *await asyncio.to_thread(_make, service, person, "clone", job_id, body, idempotency_key, make))


@router.post("/retry", status_code=201, response_model=Job)
async def retry(person: Operator, service: ServiceOf, job_id: str, body: Again, idempotency_key: IdempotencyKey = None) -> JSONResponse:
    """A failed job again, from the step that failed: a new job that uses what was made before it. Who waited for the first waits for the new one."""

    def make(rows: Connection, job: JobRow, now: float) -> JobRow:
        if job.state is not J.FAILED:
            raise ApiError(409, "Not in this state", f"{job.name} is {job.state.value}, it has not failed", "only a failed job is tried again")
        with service.store.read_cell() as cell_rows:
            has_run = history.run_of(cell_rows, job.id) is not None
        if has_run:
            raise ApiError(
                409, "It failed on the cell", f"{job.name} was run on the cell: its part stands as it was left",
                "go on with its part, or clear the table and run the job again",
            )  # fmt: skip
        made = jobs.add(rows, _like(job, person, now, "retry", name=one_line(body.name or job.name), not_before=job.not_before))
        own = dependencies.of_jobs(rows, [job.id])[job.id]
        dependencies.replace(rows, made.id, [(one.on_job, one.until) for one in own])
        dependencies.hand_over(rows, job.id, made.id)
        return made

    return await _submitted(service, *await asyncio.to_thread(_make, service, person, "retry", job_id, body, idempotency_key, make))


@router.patch("")
async def edit(person: Operator, service: ServiceOf, job_id: str, body: JobEdit, if_match: IfMatch = None) -> Job:
    """Change a job's name, tags, priority, the time that it is not started before, or the jobs that it waits for.

    With If-Match (the ETag of the job that was read) nothing that somebody else changed meanwhile is undone.
    """
    given = body.model_fields_set

    def write() -> tuple[Job, list[str]]:
        now = service.store.clock()
        with service.store.write() as rows:
            job = jobs.get(rows, job_id)
            check_seen(service, rows, job, if_match)
            _check_order(job, given)
            if body.name is not None:
                jobs.change(rows, job_id, name=one_line(body.name))
            if body.tags is not None:
                threads.set_tags(rows, job_id, body.tags)
            if body.priority is not None and body.priority != job.priority:
                lanes.set_priority(rows, job_id, body.priority)
            if "not_before" in given:
                jobs.change(rows, job_id, not_before=body.not_before)
            if body.after is not None:
                for one in body.after:
                    check_can_come(jobs.get(rows, one.job), one.until)
                dependencies.replace(rows, job_id, [(one.job, one.until) for one in body.after])
            told = ", ".join(f"{name}={getattr(body, name)!r}" for name in sorted(given - {"because", "after"}))
            told_after = f"after={[(one.job, one.until.value) for one in body.after or []]}" if "after" in given else ""
            audit.add(rows, person.deed("edit", job_id, body.because), now, f"ok: {', '.join(filter(None, (told, told_after)))}"[:500])
            return document(service, jobs.get(rows, job_id), rows), dependencies.dependents_of(rows, job_id)

    job, dependents = await asyncio.to_thread(write)
    for changed in (job_id, *dependents):
        service.feed.take_job(changed)
    service.queue.wake()
    service.runs.wake()
    return job


def _check_order(job: JobRow, given: set[str]) -> None:
    """Raises ApiError if a job is past what decides when it starts."""
    late = sorted(given & {"priority", "not_before", "after"})
    if late and job.state in ENDED | ON_CELL:
        raise ApiError(
            409, "Not in this state", f"{', '.join(late)}: {job.name} is {job.state.value}: when it starts is decided",
            "name and tags can be changed at any time",
        )  # fmt: skip


@router.get("/life")
def life(_person: Viewer, service: ServiceOf, job_id: str) -> Life:
    """The steps of a job's life so far, each with its reason and whose doing it was."""
    with service.store.read() as rows:
        jobs.get(rows, job_id)
        steps = jobs.steps_of(rows, job_id)
    ends: list[float | None] = [step.at for step in steps[1:]]
    return Life(
        items=[
            Step(at=one.at, left=one.left, state=one.state, why=one.why, who=one.who, lasted_s=None if end is None else max(end - one.at, 0.0))
            for one, end in zip(steps, [*ends, None], strict=False)
        ]
    )
