"""The record of a job over REST: sealed once its run has ended, as it stands now before that; and the key that verifies it."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query
from fastapi.responses import FileResponse, JSONResponse, Response
from pydantic import BaseModel, Field

from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.results import REPORT_POLICY
from cellctl.api.sign_in import ServiceOf, Viewer
from cellctl.planning.process import WorkerError
from cellctl.record.gather import record_of
from cellctl.record.keeping import manifest_of, sealed
from cellctl.record.layout import DOCUMENT, PAGE, SAMPLES, SEALING
from cellctl.record.seal import fingerprint_of, open_seal
from cellctl.store import Store, jobs

router = APIRouter(prefix="/api/v1", tags=["record"], responses=DOCUMENTED)
MEDIA_TYPES = {
    ".json": "application/json", ".html": "text/html; charset=utf-8", ".parquet": "application/vnd.apache.parquet",
    ".toml": "application/toml", ".sig": "application/octet-stream", ".pem": "application/x-pem-file",
}  # fmt: skip
FORMATS = {"json": DOCUMENT, "html": PAGE, "parquet": SAMPLES}


class RecordFile(BaseModel):
    """One file of a sealed record."""

    name: str
    bytes: int
    sha256: str | None = Field(description="as in the manifest; null for the manifest, its signature and the key")


class SealedRecord(BaseModel):
    """A record that was sealed. manifest_sha256: of the signed list of its files; key: fingerprint of the key that signed it"""

    job: str
    sealed_at: float
    manifest_sha256: str
    key: str
    files: list[RecordFile]


class RecordKey(BaseModel):
    """The key that verifies records. fingerprint: SHA-256 of its DER form"""

    public_pem: str
    fingerprint: str


def _sealed(store: Store, job_id: str) -> Path | None:
    """The folder, None before it is sealed. Raises NotFoundError."""
    with store.read() as rows:
        jobs.get(rows, job_id)
        return sealed(store, rows, job_id)


def _now(store: Store, job_id: str) -> dict[str, Any]:
    with store.read() as rows, store.read_cell() as cell_rows:
        return record_of(rows, cell_rows, job_id)


def _headers(name: str) -> dict[str, str]:
    return {"Content-Security-Policy": REPORT_POLICY} if name.endswith(".html") else {}


@router.get(
    "/jobs/{job_id}/record",
    response_model=dict[str, Any],
    responses={200: {"content": {"text/html": {}, MEDIA_TYPES[".parquet"]: {}}}},
)
async def get_record(
    _person: Viewer, service: ServiceOf, job_id: str, format: Annotated[Literal["json", "html", "parquet"], Query()] = "json"
) -> Response:
    """What was commanded, read back and done by whom, tied to the hashes of mesh, plan and program.

    `X-Record-Sealed` tells whether it is the signed one, or, while the job goes on, what is known now.
    """
    name = FORMATS[format]
    folder = await asyncio.to_thread(_sealed, service.store, job_id)
    headers = {**_headers(name), "X-Record-Sealed": "false" if folder is None else "true"}
    media = MEDIA_TYPES[Path(name).suffix]
    if folder is not None:
        return FileResponse(folder / name, media_type=media, headers=headers)
    if format == "json":
        return JSONResponse(await asyncio.to_thread(_now, service.store, job_id), headers=headers)
    with service.store.blobs.staging() as staged:
        try:
            await service.keeping.write_now(job_id, staged)
        except WorkerError as error:
            raise ApiError(error.failed.status, error.failed.title, error.failed.detail, error.failed.hint) from None
        return Response((staged / name).read_bytes(), media_type=media, headers=headers)


@router.get("/jobs/{job_id}/record/seal")
def get_seal(_person: Viewer, service: ServiceOf, job_id: str) -> SealedRecord:
    """The files of the sealed record with their hashes. 409 before it is sealed."""
    folder = _sealed_or_409(service.store, job_id)
    manifest = manifest_of(folder)
    files = [
        RecordFile(name=path.name, bytes=path.stat().st_size, sha256=manifest["files"].get(path.name)) for path in sorted(folder.iterdir())
    ]
    return SealedRecord(job=job_id, sealed_at=manifest["sealed_at"], manifest_sha256=folder.name, key=manifest["key"], files=files)


def _sealed_or_409(store: Store, job_id: str) -> Path:
    folder = _sealed(store, job_id)
    if folder is None:
        raise ApiError(409, "Not sealed", "the record of this job is not sealed yet", "it is sealed some seconds after its run has ended")
    return folder


@router.get("/jobs/{job_id}/record/files/{name}", response_class=FileResponse, responses={200: {"content": {"application/octet-stream": {}}}})
def get_record_file(_person: Viewer, service: ServiceOf, job_id: str, name: str) -> FileResponse:
    """One file of the sealed record."""
    folder = _sealed_or_409(service.store, job_id)
    if name not in SEALING | manifest_of(folder)["files"].keys():
        raise ApiError(404, "Not found", f"the record has no file {name[:80]!r}", "see GET /api/v1/jobs/{id}/record/seal")
    media = MEDIA_TYPES.get(Path(name).suffix, "application/octet-stream")
    return FileResponse(folder / name, media_type=media, filename=name, headers=_headers(name))


@router.get("/record-key")
def get_record_key(_person: Viewer, service: ServiceOf) -> RecordKey:
    """The public key that verifies this service's records; note its fingerprint where nobody can change it."""
    pem = open_seal(service.store.folder).public_pem
    return RecordKey(public_pem=pem.decode("ascii"), fingerprint=fingerprint_of(pem))
