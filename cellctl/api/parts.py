"""Parts: uploads streamed to disk, checked by a worker, kept under their hash; the name that came with them is only shown."""

from __future__ import annotations

import asyncio
import re
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal

from fastapi import APIRouter, File, Form, Query, UploadFile
from fastapi.responses import FileResponse

from cellctl.api.context import Service
from cellctl.api.idempotent import IdempotencyKey as IdempotencyKey
from cellctl.api.models import Finding, Part, Parts
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import Operator, Person, ServiceOf, Viewer
from cellctl.planning.process import WorkerError
from cellctl.planning.task import MESH_FILE, Task
from cellctl.store import audit, blobs, idempotency, parts, uploads
from cellctl.store.ids import new_id
from cellctl.store.parts import Inspection, PartRow

SUFFIXES = (".stl", ".3mf", ".obj", ".ply")
NAME_MAX = 100
Cursor = Annotated[str | None, Query(max_length=200, description="what `next` of the page before said")]
Text = Annotated[str | None, Query(max_length=200, description="in the name, upper or lower case")]
Since = Annotated[float | None, Query(ge=0, le=1e11, allow_inf_nan=False, description="not before this time, Unix s")]
Until = Annotated[float | None, Query(ge=0, le=1e11, allow_inf_nan=False, description="before this time, Unix s")]
Limit = Annotated[int, Query(ge=1, le=200)]
router = APIRouter(prefix="/api/v1/parts", tags=["parts"], responses=DOCUMENTED)


def document(row: PartRow) -> Part:
    """A part as it is told."""
    seen = row.inspection
    return Part(
        id=row.id,
        name=row.name,
        units="inch" if row.units == "inch" else "mm",
        sha256=row.sha256,
        bytes=row.bytes,
        bbox_mm=seen.bbox_mm,
        facets=seen.facets,
        volume_mm3=seen.volume_mm3,
        findings=[Finding(**finding) for finding in seen.findings],
        created_at=row.created_at,
        created_by=row.created_by,
    )


def safe_name(filename: str | None) -> tuple[str, str]:
    """(stem, suffix) of a file name from outside: no folders, plain characters. Raises ApiError 422 for an unknown kind of file."""
    base = PurePosixPath((filename or "").replace("\\", "/")).name
    suffix = PurePosixPath(base).suffix.lower()
    if suffix not in SUFFIXES:
        raise ApiError(
            422,
            "Not a mesh file",
            f"{base[:60]!r} is none of {', '.join(SUFFIXES)}",
            "export the model as binary STL or 3MF",
        )
    stem = re.sub(r"[^\w.+-]+", "_", base[: -len(suffix)], flags=re.ASCII).strip("._")
    return stem[:NAME_MAX] or "part", suffix


async def _inspect(service: Service, path: Path, folder: Path, name: str, units: str) -> Inspection:
    """Check the mesh in a worker. Raises ApiError with the worker's words."""
    task = Task(
        kind="inspect", folder=str(folder), parent=0, memory_bytes=0, part_name=name, mesh=str(path), units=units
    )
    try:
        async with service.inspections:
            summary = await service.workers.run(task, lambda _stage, _fraction: None)
    except WorkerError as error:
        failed = error.failed
        raise ApiError(failed.status, failed.title, failed.detail, failed.hint) from None
    return Inspection(**summary)


@dataclass(frozen=True)
class Sent:
    """A file that came whole. digest : of the request, for its key; upload_id : it came by, empty if by one request"""

    path: Path
    sha256: str
    bytes: int
    units: str
    key: str | None = None
    digest: str = ""
    upload_id: str = ""


def _keep(service: Service, person: Person, row: PartRow, folder: Path, sent: Sent) -> dict[str, Any]:
    """Put the files in their places, then the row, in this order: a row never names a missing file."""
    blobs.place(folder / MESH_FILE, service.store.blobs.mesh(row.inspection.mesh_sha256))
    blobs.place(sent.path, service.store.blobs.part(row.sha256, row.suffix))
    with service.store.write() as rows:
        earlier = idempotency.answered(rows, person.name, sent.key, sent.digest)
        if earlier is not None:
            return earlier
        parts.add(rows, row)
        if sent.upload_id:
            uploads.became(rows, sent.upload_id, row.id)
        answer = document(row).model_dump()
        idempotency.remember(rows, person.name, sent.key, sent.digest, answer, row.created_at)
        audit.add(rows, person.deed("upload", row.id), row.created_at, "ok")
    return answer


async def accept(service: Service, person: Person, folder: Path, sent: Sent) -> Part:
    """Inspect a file that came whole and keep it as a part. folder : of one's own, on the store's file system. Raises ApiError."""
    name, suffix = sent.path.stem, sent.path.suffix
    inspection = await _inspect(service, sent.path, folder, name, sent.units)
    now = service.store.clock()
    row = PartRow(new_id("part", now), name, suffix, sent.units, sent.sha256, sent.bytes, now, person.name, inspection)
    return Part(**await asyncio.to_thread(_keep, service, person, row, folder, sent))


def _earlier(service: Service, person: Person, key: str | None, digest: str) -> dict[str, Any] | None:
    with service.store.read() as rows:
        return idempotency.answered(rows, person.name, key, digest)


@router.post("", status_code=201)
async def upload(
    person: Operator,
    service: ServiceOf,
    file: Annotated[UploadFile, File(description="STL, 3MF, OBJ or PLY")],
    units: Annotated[Literal["mm", "inch"], Form(description="what the file's numbers mean")] = "mm",
    idempotency_key: IdempotencyKey = None,
) -> Part:
    """Upload a mesh. It is checked, mended where that does not change its shape, and kept; what was found is in `findings`."""
    name, suffix = safe_name(file.filename)
    with service.store.blobs.staging() as folder:
        path = folder / f"{name}{suffix}"
        sha256, size = await asyncio.to_thread(blobs.copy_hashed, file.file, path)
        digest = idempotency.request_digest("part", sha256, units, name, suffix)
        answer = await asyncio.to_thread(_earlier, service, person, idempotency_key, digest)
        if answer is not None:
            return Part(**answer)
        return await accept(service, person, folder, Sent(path, sha256, size, units, idempotency_key, digest))


@router.get("")
def list_parts(
    _person: Viewer,
    service: ServiceOf,
    cursor: Cursor = None,
    limit: Limit = 50,
    text: Text = None,
    by: Annotated[str | None, Query(max_length=100, description="who uploaded it")] = None,
    since: Since = None,
    until: Until = None,
) -> Parts:
    """Parts, newest first; those that all given filters let through."""
    with service.store.read() as rows:
        found, following = parts.find_page(rows, cursor, limit, text=text, by=by, since=since, until=until)
    return Parts(items=[document(row) for row in found], next=following)


@router.get("/{part_id}")
def get_part(_person: Viewer, service: ServiceOf, part_id: str) -> Part:
    """One part."""
    with service.store.read() as rows:
        return document(parts.get(rows, part_id))


@router.get(
    "/{part_id}/mesh",
    response_class=FileResponse,
    responses={200: {"content": {"model/stl": {}}, "description": "Binary STL, mm"}},
)
def get_mesh(_person: Viewer, service: ServiceOf, part_id: str) -> FileResponse:
    """The mended mesh as binary STL, mm, in the part's own frame."""
    with service.store.read() as rows:
        part = parts.get(rows, part_id)
    path = service.store.blobs.mesh(part.inspection.mesh_sha256)
    headers = {"ETag": f'"{part.inspection.mesh_sha256}"'}
    return FileResponse(path, media_type="model/stl", filename=f"{part.name}.stl", headers=headers)


@router.get(
    "/{part_id}/file",
    response_class=FileResponse,
    responses={200: {"content": {"application/octet-stream": {}}, "description": "The file as it was sent"}},
)
def get_file(_person: Viewer, service: ServiceOf, part_id: str) -> FileResponse:
    """The file as it was sent, byte for byte."""
    with service.store.read() as rows:
        part = parts.get(rows, part_id)
    path = service.store.blobs.part(part.sha256, part.suffix)
    return FileResponse(path, media_type="application/octet-stream", filename=f"{part.name}{part.suffix}", headers={"ETag": f'"{part.sha256}"'})
