"""What people leave at a job: notes and attachments, which are only ever added, and the tags that are in use."""

from __future__ import annotations

import asyncio
import re
from pathlib import PurePosixPath
from typing import Annotated, Any

from fastapi import APIRouter, File, Query, UploadFile
from fastapi.responses import FileResponse

from cellctl.api.context import Service
from cellctl.api.models_jobs import Attachment, Attachments, NewNote, Note, Notes, Tags
from cellctl.api.parts import IdempotencyKey
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import Operator, Person, ServiceOf, Viewer
from cellctl.store import audit, blobs, idempotency, jobs, threads
from cellctl.store.ids import new_id

router = APIRouter(prefix="/api/v1", tags=["notes and attachments"], responses=DOCUMENTED)
NOTES_MAX, ATTACHMENTS_MAX = 1000, 50  # of one job
BYTES_MAX = 20_000_000
NAME_MAX = 120
OTHER = "application/octet-stream"
IMAGES = ((b"\x89PNG\r\n\x1a\n", "image/png"), (b"\xff\xd8\xff", "image/jpeg"), (b"GIF87a", "image/gif"), (b"GIF89a", "image/gif"))
HARMLESS = {"X-Content-Type-Options": "nosniff", "Content-Security-Policy": "default-src 'none'; sandbox", "Cache-Control": "private, max-age=3600"}


def kind_of(head: bytes) -> str:
    """The media type of an image that browsers draw and never run, by its first bytes; of all else the one that says nothing."""
    if head[:4] == b"RIFF" and head[8:12] == b"WEBP":
        return "image/webp"
    return next((kind for mark, kind in IMAGES if head.startswith(mark)), OTHER)


def safe_name(filename: str | None) -> str:
    """A file name from outside that is safe to show and to save: no folders, no control characters, nothing hidden."""
    base = PurePosixPath((filename or "").replace("\\", "/")).name
    kept = re.sub(r"[^\w.+ ()-]+", "_", base).strip(" ._")
    stem, dot, suffix = kept.rpartition(".")
    return (f"{stem[: NAME_MAX - 20]}.{suffix[:16]}" if dot else kept[:NAME_MAX]) or "attachment"


@router.get("/jobs/{job_id}/notes")
def list_notes(_person: Viewer, service: ServiceOf, job_id: str) -> Notes:
    """The notes of a job, in order."""
    with service.store.read() as rows:
        jobs.get(rows, job_id)
        return Notes(items=[Note(**one.__dict__) for one in threads.notes_of(rows, job_id)])


@router.post("/jobs/{job_id}/notes", status_code=201)
async def add_note(person: Operator, service: ServiceOf, job_id: str, body: NewNote, idempotency_key: IdempotencyKey = None) -> Note:
    """Add a note to a job, in whatever state it is. Notes stay: none is changed or taken away."""
    digest = idempotency.request_digest("note", job_id, body.text)

    def write() -> dict[str, Any]:
        now = service.store.clock()
        with service.store.write() as rows:
            earlier = idempotency.answered(rows, person.name, idempotency_key, digest)
            if earlier is not None:
                return earlier
            job = jobs.get(rows, job_id)
            if len(threads.notes_of(rows, job_id)) >= NOTES_MAX:
                raise ApiError(409, "Too many notes", f"{job.name} has {NOTES_MAX} notes", "attach a file instead")
            answer = dict(threads.add_note(rows, job_id, now, person.name, body.text).__dict__)
            idempotency.remember(rows, person.name, idempotency_key, digest, answer, now)
            audit.add(rows, person.deed("note", job_id), now, "ok")
            return answer

    answer = await asyncio.to_thread(write)
    service.feed.take_job(job_id)
    return Note(**answer)


def _document(one: threads.Attachment) -> Attachment:
    return Attachment(**one.__dict__, is_image=one.kind != OTHER)


@router.get("/jobs/{job_id}/attachments")
def list_attachments(_person: Viewer, service: ServiceOf, job_id: str) -> Attachments:
    """The attachments of a job, in order."""
    with service.store.read() as rows:
        jobs.get(rows, job_id)
        return Attachments(items=[_document(one) for one in threads.attachments_of(rows, job_id)])


def _keep(service: Service, person: Person, job_id: str, file: UploadFile, key: str | None) -> dict[str, Any]:
    """The file in its place first, then its row: a row never names a missing file. Raises ApiError, NotFoundError."""
    with service.store.read() as rows:
        jobs.get(rows, job_id)
    with service.store.blobs.staging() as folder:
        path = folder / "attachment"
        sha256, size = blobs.copy_hashed(file.file, path)
        if size > BYTES_MAX:
            raise ApiError(413, "Too large", f"an attachment has at most {BYTES_MAX // 10**6} MB, this one {size / 1e6:.1f} MB", "attach less")
        if size == 0:
            raise ApiError(422, "Nothing in it", "the file is empty", "choose another")
        name = safe_name(file.filename)
        digest = idempotency.request_digest("attachment", job_id, sha256, name)
        with path.open("rb") as begin:
            kind = kind_of(begin.read(16))
        blobs.place(path, service.store.blobs.attachment(sha256))
    now = service.store.clock()
    with service.store.write() as rows:
        earlier = idempotency.answered(rows, person.name, key, digest)
        if earlier is not None:
            return earlier
        if len(threads.attachments_of(rows, job_id)) >= ATTACHMENTS_MAX:
            raise ApiError(409, "Too many attachments", f"{jobs.get(rows, job_id).name} has {ATTACHMENTS_MAX}", "put several files into one archive")
        row = threads.Attachment(new_id("file", now), now, person.name, name, kind, size, sha256)
        threads.attach(rows, job_id, row)
        answer = _document(row).model_dump()
        idempotency.remember(rows, person.name, key, digest, answer, now)
        audit.add(rows, person.deed("attach", job_id), now, f"ok: {name}, {size} bytes, sha256 {sha256}")
    return answer


@router.post("/jobs/{job_id}/attachments", status_code=201)
async def attach(
    person: Operator,
    service: ServiceOf,
    job_id: str,
    file: Annotated[UploadFile, File(description=f"any file of at most {BYTES_MAX // 10**6} MB")],
    idempotency_key: IdempotencyKey = None,
) -> Attachment:
    """Attach a file to a job. It stays, under its hash, and is never run or shown as a page."""
    answer = await asyncio.to_thread(_keep, service, person, job_id, file, idempotency_key)
    service.feed.take_job(job_id)
    return Attachment(**answer)


@router.get(
    "/jobs/{job_id}/attachments/{attachment_id}",
    response_class=FileResponse,
    responses={200: {"content": {OTHER: {}, "image/*": {}}, "description": "The file, to be saved; with show an image, to be looked at"}},
)
def get_attachment(
    _person: Viewer, service: ServiceOf, job_id: str, attachment_id: str, show: Annotated[bool, Query(description="an image: inline")] = False
) -> FileResponse:
    """The bytes of an attachment, to be saved; an image may be shown. Nothing else is ever served as what a browser would run."""
    with service.store.read() as rows:
        one = threads.attachment(rows, job_id, attachment_id)
    path = service.store.blobs.attachment(one.sha256)
    is_shown = show and one.kind != OTHER
    return FileResponse(
        path, media_type=one.kind, filename=one.name, headers=HARMLESS, content_disposition_type="inline" if is_shown else "attachment"
    )


@router.get("/tags")
def list_tags(_person: Viewer, service: ServiceOf) -> Tags:
    """Every tag in use, and at how many jobs."""
    with service.store.read() as rows:
        return Tags(items=threads.all_tags(rows))
