"""What is shown before and after planning: an estimate, a small picture, the recipe's schema, a plan in figures."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

import tomli_w
from fastapi import APIRouter
from fastapi.responses import FileResponse, Response

from cellctl.api.context import Service
from cellctl.api.jobs import pins_of, recipe_from
from cellctl.api.models import NewJob
from cellctl.api.models_estimates import EstimateAsked, EstimateTold, PlanFigures
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import Person, ServiceOf, Viewer
from cellctl.planning.previews import Ask, Superseded
from cellctl.planning.process import WorkerError
from cellctl.store import blobs, jobs, parts, versions
from planner.recipe import Recipe

router = APIRouter(prefix="/api/v1", responses=DOCUMENTED)
LASTING = {"Cache-Control": "private, max-age=31536000, immutable"}  # what is named by a hash never changes


async def _asked(service: Service, ask: Ask, of: str = "") -> dict[str, Any]:
    """The preview process's answer. Raises ApiError with its words."""
    try:
        return await service.previews.ask(ask, of)
    except Superseded:
        raise ApiError(409, "A newer question came", "the same person asked for another estimate of this part", "show the newer one") from None
    except WorkerError as error:
        failed = error.failed
        raise ApiError(failed.status, failed.title, failed.detail, failed.hint) from None


async def _made(service: Service, kind: Any, source: Path, target: Path) -> Path:
    """A file that the preview process makes once of another. Raises ApiError."""
    if not target.is_file():
        handle, scratch = tempfile.mkstemp(dir=service.store.blobs.unfinished)
        os.close(handle)
        try:
            await _asked(service, Ask(kind=kind, file=str(source), target=scratch))
            blobs.place(Path(scratch), target)
        finally:
            Path(scratch).unlink(missing_ok=True)
    return target


@router.post("/parts/{part_id}/estimate", tags=["parts"])
async def estimate(person: Viewer, service: ServiceOf, part_id: str, body: EstimateAsked) -> EstimateTold:
    """What the part would take with this recipe: layers, time, powder, cost. From its sections, without a plan; asked again by the
    same person for the same part, only the newest is answered (409 for the others)."""
    with service.store.read() as rows:
        part = parts.get(rows, part_id)
        recipe = recipe_from(NewJob(part_id=part_id, recipe=body.recipe))
        pins = pins_of(service, rows, recipe.material)
        material = versions.material(rows, recipe.material, sha256=pins["material_sha256"])
    toml = tomli_w.dumps(recipe.model_dump(mode="json", exclude_none=True))
    mesh = service.store.blobs.mesh(part.inspection.mesh_sha256)
    ask = Ask(kind="estimate", file=str(mesh), recipe_toml=toml, cell=str(service.settings.cell_file), material_toml=material.toml)
    return EstimateTold(part_id=part_id, **await _asked(service, ask, _asker(person, part_id)))


def _asker(person: Person, part_id: str) -> str:
    return f"{person.name} {person.client} {part_id}"


@router.get(
    "/parts/{part_id}/thumbnail",
    tags=["parts"],
    response_class=FileResponse,
    responses={200: {"content": {"image/png": {}}, "description": "PNG, 240 x 180, clear ground"}},
)
async def thumbnail(_person: Viewer, service: ServiceOf, part_id: str) -> Response:
    """A small picture of the part, drawn once."""
    with service.store.read() as rows:
        sha256 = parts.get(rows, part_id).inspection.mesh_sha256
    held = service.store.blobs
    path = await _made(service, "picture", held.mesh(sha256), held.thumbnail(sha256))
    return FileResponse(path, media_type="image/png", headers=LASTING)


@router.get("/recipe/schema", tags=["facts"], response_model=dict[str, Any])
def recipe_schema(_person: Viewer) -> dict[str, Any]:
    """The JSON schema of a recipe: every field with its meaning, default, bounds and choices."""
    return Recipe.model_json_schema()


@router.get("/jobs/{job_id}/plan/figures", tags=["results"], response_model=PlanFigures)
async def plan_figures(_person: Viewer, service: ServiceOf, job_id: str) -> Response:
    """The plan in figures by layer and process: lengths, times at the programmed feed, powder."""
    with service.store.read() as rows:
        job = jobs.get(rows, job_id)
    if job.plan_sha256 is None:
        raise ApiError(404, "Not there yet", f"{job.name} has no plan (it is {job.state.value})", "look at the job's state")
    held = service.store.blobs
    path = await _made(service, "figures", held.plan(job.plan_sha256), held.figures(job.plan_sha256))
    return FileResponse(path, media_type="application/json", headers=LASTING)
