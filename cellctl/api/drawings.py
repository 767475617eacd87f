"""What the console draws: a plan's geometry by layer and as a whole, a program's track by layer, a proof's as-built surface."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query
from fastapi.responses import FileResponse, Response
from pydantic import BaseModel

from cellctl.api.context import Service
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import ServiceOf, Viewer
from cellctl.planning.redraw import RedrawError, track_of, view_of
from cellctl.planning.track import INDEX, chunk_file
from cellctl.planning.view import WHOLE, layer_file
from cellctl.store import jobs
from cellctl.store.jobs import JobRow

router = APIRouter(prefix="/api/v1/jobs/{job_id}", tags=["drawings"], responses=DOCUMENTED)
MEDIA_TYPE = "application/vnd.hybridcell.view"
FOREVER = "private, max-age=31536000, immutable"
AGAIN = "private, no-cache"
FORMAT = "arrays with a JSON header: HCV2, length of the header (u32), header, arrays; little-endian"
BINARY: dict[int | str, dict[str, Any]] = {200: {"content": {MEDIA_TYPE: {}}, "description": FORMAT}}

Of = Annotated[
    str | None, Query(max_length=64, description="hash of the plan, program or proof that is meant: the answer may then be kept for ever")
]
IfNoneMatch = Annotated[str | None, Header(alias="If-None-Match", max_length=400)]


class TrackChunk(BaseModel):
    """Lines of one layer. layer: -1 where the lines belong to none; path_start_mm: way of the tip before them"""

    layer: int
    first_line: int
    lines: int
    time_start_s: float
    time_end_s: float
    path_start_mm: float


class Track(BaseModel):
    """A program by time: its chunks in order, the predicted duration, and the letters of the joints."""

    version: int
    lines: int
    duration_s: float
    axes: list[str]
    chunks: list[TrackChunk]


def _job(service: Service, job_id: str) -> JobRow:
    with service.store.read() as rows:
        return jobs.get(rows, job_id)


def _sha256(job: JobRow, sha256: str | None, what: str) -> str:
    if sha256 is None:
        raise ApiError(404, "Not there yet", f"{job.name} has no {what} (it is {job.state.value})", "look at the job's state")
    return sha256


def drawn_plan(service: Service, sha256: str) -> Path:
    """The view folder of a plan, made anew if an earlier version left it. Raises ApiError 500."""
    try:
        return view_of(service.store.blobs.plan(sha256), service.store.blobs.view(sha256))
    except RedrawError as error:
        raise ApiError(500, "The plan cannot be drawn", str(error), "plan the part again") from None


def drawn_program(service: Service, sha256: str) -> Path:
    """The track folder of a program, made anew if need be. Raises ApiError 500."""
    try:
        return track_of(service.store.blobs.program(sha256))
    except RedrawError as error:
        raise ApiError(500, "The program cannot be drawn", str(error), "post the plan again") from None


def _answer(path: Path, sha256: str, meant: str | None, known: str | None, media_type: str = MEDIA_TYPE) -> Response:
    """The file with a tag of what it is made of; 304 where the client has it. Raises ApiError 404 if there is no such file."""
    tag = f'"{sha256[:32]}-{path.name}"'
    headers = {"ETag": tag, "Cache-Control": FOREVER if meant == sha256 else AGAIN}
    if not path.is_file():
        raise ApiError(404, "Not there", f"there is no {path.name}", "see what the job has")
    if known is not None and tag in known:
        return Response(status_code=304, headers=headers)
    return FileResponse(path, media_type=media_type, headers=headers)


@router.get("/plan/geometry", response_class=FileResponse, responses=BINARY)
def get_whole(_person: Viewer, service: ServiceOf, job_id: str, of: Of = None, if_none_match: IfNoneMatch = None) -> Response:
    """All layers in one drawing with as many vertices as a graphics card takes at once; `layers` says where each begins."""
    job = _job(service, job_id)
    sha256 = _sha256(job, job.plan_sha256, "plan")
    return _answer(drawn_plan(service, sha256) / WHOLE, sha256, of, if_none_match)


@router.get("/plan/layers/{layer}/geometry", response_class=FileResponse, responses=BINARY)
def get_layer_geometry(
    _person: Viewer, service: ServiceOf, job_id: str, layer: int, of: Of = None, if_none_match: IfNoneMatch = None
) -> Response:
    """One layer's passes, every vertex: position, arc length, speed, power, tilt, powder; and the set-points of each pass."""
    job = _job(service, job_id)
    if not 0 <= layer < job.layers:
        raise ApiError(404, "Not found", f"{job.name} has no layer {layer}", f"layers are 0 to {job.layers - 1}")
    sha256 = _sha256(job, job.plan_sha256, "plan")
    return _answer(drawn_plan(service, sha256) / layer_file(layer), sha256, of, if_none_match)


@router.get("/program/track", response_model=Track)
def get_track(_person: Viewer, service: ServiceOf, job_id: str, of: Of = None, if_none_match: IfNoneMatch = None) -> Response:
    """The program by time: which lines each layer has, and when they run by prediction."""
    job = _job(service, job_id)
    sha256 = _sha256(job, job.program_sha256, "program")
    return _answer(drawn_program(service, sha256) / INDEX, sha256, of, if_none_match, "application/json")


@router.get("/program/track/{chunk}", response_class=FileResponse, responses=BINARY)
def get_chunk(
    _person: Viewer, service: ServiceOf, job_id: str, chunk: int, of: Of = None, if_none_match: IfNoneMatch = None
) -> Response:
    """The lines of one chunk: when each ends, and where tip, axis and joints are then."""
    job = _job(service, job_id)
    sha256 = _sha256(job, job.program_sha256, "program")
    folder = drawn_program(service, sha256)
    if chunk < 0:
        raise ApiError(404, "Not found", f"there is no chunk {chunk}", "the track lists them, from 0 on")
    return _answer(folder / chunk_file(chunk), sha256, of, if_none_match)


@router.get("/proof/surface", response_class=FileResponse, responses=BINARY)
def get_surface(_person: Viewer, service: ServiceOf, job_id: str, of: Of = None, if_none_match: IfNoneMatch = None) -> Response:
    """The part as built in the twin, as triangles with the deviation at each corner."""
    job = _job(service, job_id)
    sha256 = _sha256(job, job.proof_sha256, "proof")
    path = service.store.blobs.surface(sha256)
    if not path.is_file():
        raise ApiError(404, "Not there", "this proof was made before surfaces were kept", "submit the part again to prove it anew")
    return _answer(path, sha256, of, if_none_match)
