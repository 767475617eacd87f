"""What became of a job: its plan by layer, its program, its proof."""

from __future__ import annotations

import os
import tempfile
import zipfile
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query
from fastapi.responses import FileResponse, HTMLResponse, Response
from pydantic import BaseModel
from starlette.background import BackgroundTask

from cellctl.api.context import Service
from cellctl.api.drawings import drawn_plan
from cellctl.api.models import Program, ProgramFile
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import ServiceOf, Viewer
from cellctl.planning.view import OVERVIEW, layer_file, layer_view
from cellctl.store import jobs
from cellctl.store.jobs import JobRow

router = APIRouter(prefix="/api/v1/jobs/{job_id}", tags=["results"], responses=DOCUMENTED)
JSON_FILE = "application/json"


class OperationOverview(BaseModel):
    """One operation of a layer. length_mm: without links"""

    index: int
    process: str
    passes: int
    length_mm: float


class LayerPlace(BaseModel):
    """Where a layer lies, mm, build frame, and its areas. bottom, top: point and unit normal of its planes; z_bottom and
    z_top are the heights of those points; tilt_deg: of the bottom plane from level; thickness_mm: least and greatest
    (0: parallel planes); subcomponent: number in the plan's list"""

    index: int
    z_bottom: float
    z_top: float
    bottom: list[float]
    top: list[float]
    tilt_deg: float
    thickness_mm: list[float]
    subcomponent: int
    overlap_mm2: float
    overhang_mm2: float


class LayerOverview(LayerPlace):
    """One layer with its operations."""

    operations: list[OperationOverview]


class SubcomponentOverview(BaseModel):
    """A piece built in one go. parent: number of the piece that it stands on, -1: the plate; layers: first and one past the
    last; base: point, mm, and direction of growth, build frame; why: one line each"""

    name: str
    parent: int
    setup: int
    layers: list[int]
    base: list[float]
    end_direction: list[float]
    axis_mm: list[list[float]]
    thickness_mm: list[float]
    volume_mm3: float
    joint_mm2: float
    overhang_mm2: float
    unsupported_mm: float
    support_mm3: float
    why: list[str]


class SetupOverview(BaseModel):
    """Pieces built without turning the part in between. direction: which is up, build frame; turn: in words"""

    direction: list[float]
    turn: str
    subcomponents: list[int]


class CandidateOverview(BaseModel):
    """A way to build the part that was weighed; smaller scores are better; buildable: share of the volume, 0 to 1"""

    name: str
    subcomponents: int
    setups: int
    overhang_mm2: float | None
    joint_mm2: float | None
    time_s: float | None
    score: float | None
    buildable: float | None
    chosen: bool
    note: str


class SkeletonOverview(BaseModel):
    """The part's centroidal axis as a graph, mm, build frame."""

    nodes_mm: list[list[float]]
    radii_mm: list[float]
    edges: list[list[int]]


class PlanOverview(BaseModel):
    """A plan. bounds: lowest and highest corner, mm, build frame; build_from_part: (4, 4)"""

    part: str
    material: str
    process: str
    layers: list[LayerOverview]
    bounds: list[list[float]]
    build_from_part: list[list[float]]
    tolerance_mm: float
    findings: list[str]
    volumes: dict[str, float]
    subcomponents: list[SubcomponentOverview]
    setups: list[SetupOverview]
    candidates: list[CandidateOverview]
    skeleton: SkeletonOverview | None


class PassView(BaseModel):
    """One pass as a polyline: x0, y0, z0, x1, ... mm, build frame, within 0.02 mm."""

    link: bool
    laser_w: float
    feed_mm_s: float
    points: list[float]


class OperationView(BaseModel):
    """One operation with its passes."""

    index: int
    process: str
    note: str
    passes: list[PassView]


class LayerView(LayerPlace):
    """One layer with all its passes. overhang: closed outlines of what rests on nothing, x0, y0, z0, x1, ... mm, build frame"""

    overhang: list[list[float]]
    operations: list[OperationView]


def _job(service: Service, job_id: str) -> JobRow:
    with service.store.read() as rows:
        return jobs.get(rows, job_id)


def _made(job: JobRow, sha256: str | None, what: str) -> str:
    """The hash of something that the job has, or ApiError 404."""
    if sha256 is None:
        raise ApiError(
            404, "Not there yet", f"{job.name} has no {what} (it is {job.state.value})", "look at the job's state"
        )
    return sha256


def _file(path: Path, media_type: str, filename: str | None = None, *, of: str | None = None) -> FileResponse:
    """A file of the store. of : hash of what it belongs to, which with its own name makes the ETag. Raises ApiError 404 if it is gone."""
    if not path.is_file():
        raise ApiError(404, "Not there", f"there is no {path.name}", "see what the job has")
    return FileResponse(path, media_type=media_type, filename=filename, headers={"ETag": f'"{of}-{path.name}"'} if of else None)


def _drawn(folder: Path, job: JobRow, layer: int) -> Response:
    """A layer of a plan that is being made: read at once, since the folder moves when the plan is done. Raises ApiError 404."""
    try:
        return Response(layer_view((folder / layer_file(layer)).read_bytes()), media_type=JSON_FILE)
    except FileNotFoundError:
        raise ApiError(
            404,
            "Not there yet",
            f"layer {layer} of {job.name} is not planned yet",
            "ask again, or watch the job's layers",
        ) from None


@router.get("/plan", response_model=PlanOverview)
def get_plan(_person: Viewer, service: ServiceOf, job_id: str) -> Response:
    """The plan's layers and operations."""
    job = _job(service, job_id)
    return _file(service.store.blobs.view(_made(job, job.plan_sha256, "plan")) / OVERVIEW, JSON_FILE, of=job.plan_sha256)


@router.get("/plan/layers/{layer}", response_model=LayerView)
def get_layer(_person: Viewer, service: ServiceOf, job_id: str, layer: int) -> Response:
    """One layer's passes as polylines; while the part is being planned, of each layer that is ready."""
    job = _job(service, job_id)
    if job.plan_sha256 is None and (drawing := service.queue.drawing(job_id)) is not None:
        return _drawn(drawing, job, layer)
    if not 0 <= layer < job.layers:
        raise ApiError(404, "Not found", f"{job.name} has no layer {layer}", f"layers are 0 to {job.layers - 1}")
    sha256 = _made(job, job.plan_sha256, "plan")
    return Response(layer_view((drawn_plan(service, sha256) / layer_file(layer)).read_bytes()), media_type=JSON_FILE)


@router.get(
    "/plan/file",
    response_class=FileResponse,
    responses={200: {"content": {"application/x-hdf5": {}}, "description": "plan.h5"}},
)
def get_plan_file(_person: Viewer, service: ServiceOf, job_id: str) -> Response:
    """The plan's own file (HDF5)."""
    job = _job(service, job_id)
    return _file(service.store.blobs.plan(_made(job, job.plan_sha256, "plan")), "application/x-hdf5", "plan.h5", of=job.plan_sha256)


def _program(service: Service, job_id: str) -> tuple[JobRow, Path, list[Path]]:
    job = _job(service, job_id)
    folder = service.store.blobs.program(_made(job, job.program_sha256, "program"))
    return job, folder, sorted(folder.iterdir())


def _zip(files: list[Path]) -> Path:
    """The files as a zip in a temporary place; the same files give the same bytes."""
    handle, name = tempfile.mkstemp(suffix=".zip")
    with os.fdopen(handle, "wb") as target, zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in files:
            archive.writestr(zipfile.ZipInfo(path.name), path.read_bytes(), zipfile.ZIP_DEFLATED)
    return Path(name)


@router.get("/program", response_model=Program, responses={200: {"content": {"application/zip": {}}}})
def get_program(
    _person: Viewer, service: ServiceOf, job_id: str, format: Annotated[Literal["json", "zip"], Query()] = "json"
) -> Any:
    """The program's files, listed or as a zip."""
    job, _folder, files = _program(service, job_id)
    if format == "zip":
        path = _zip(files)
        return FileResponse(
            path, media_type="application/zip", filename="program.zip", background=BackgroundTask(path.unlink)
        )
    listing = [ProgramFile(name=path.name, bytes=path.stat().st_size) for path in files]
    return Program(
        sha256=job.program_sha256 or "",
        lines=job.lines_total,
        layers=job.layers,
        duration_s=job.duration_s,
        files=listing,
    )


@router.get(
    "/program/{name}",
    response_class=Response,
    responses={200: {"content": {"text/plain": {}, "application/octet-stream": {}}}},
)
def get_program_file(_person: Viewer, service: ServiceOf, job_id: str, name: str) -> Response:
    """One file of the program: G-code as text, the line table as it is."""
    job, _folder, files = _program(service, job_id)
    path = next((path for path in files if path.name == name), None)
    if path is None:
        raise ApiError(404, "Not found", f"the program has no file {name[:60]!r}", "the listing names its files")
    text = path.suffix in (".ngc", ".json")
    return _file(path, "text/plain; charset=utf-8" if text else "application/octet-stream", None if text else path.name, of=job.program_sha256)


@router.get("/proof", response_model=dict[str, Any])
def get_proof(_person: Viewer, service: ServiceOf, job_id: str) -> Response:
    """The whole proof: figures and findings."""
    job = _job(service, job_id)
    return _file(service.store.blobs.proof(_made(job, job.proof_sha256, "proof")), JSON_FILE, of=job.proof_sha256)


@router.get(
    "/proof/picture", response_class=FileResponse, responses={200: {"content": {"image/png": {}}, "description": "PNG"}}
)
def get_picture(_person: Viewer, service: ServiceOf, job_id: str) -> Response:
    """The part as built in the twin, coloured by its deviation."""
    job = _job(service, job_id)
    return _file(service.store.blobs.picture(_made(job, job.proof_sha256, "proof")), "image/png", of=job.proof_sha256)


REPORT_POLICY = (
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content-Security-Policy of a report, whichever version of the software wrote it; the page itself carries a narrower one."""


@router.get(
    "/proof/report",
    response_class=HTMLResponse,
    responses={200: {"content": {"text/html": {}}, "description": "One page without scripts that needs nothing else"}},
)
def get_report(_person: Viewer, service: ServiceOf, job_id: str) -> Response:
    """The proof as a page to read, print and sign: verdict, figures, findings with pictures, course of the run."""
    job = _job(service, job_id)
    answer = _file(service.store.blobs.report(_made(job, job.proof_sha256, "proof")), "text/html; charset=utf-8", of=job.proof_sha256)
    answer.headers["Content-Security-Policy"] = REPORT_POLICY
    return answer
