"""Uploads that can be resumed, for files of up to 1 GB: the protocol tus 1.0.0 (https://tus.io/protocols/resumable-upload).

Why tus and not the IETF draft (draft-ietf-httpbis-resumable-upload): tus is finished and has clients in every language; the draft
still changes its version number and rests on interim answers (104) that servers of Python cannot send. Extensions: creation,
checksum (sha256), expiration, termination. Every request but OPTIONS and GET carries `Tus-Resumable: 1.0.0` and a sign-in.

1. `POST /api/v1/uploads` with `Upload-Length: BYTES` and `Upload-Metadata: filename B64,units B64,sha256 B64` (values in Base64;
   units: mm or inch, mm if left out; sha256: hex digest of the whole file, optional; an Idempotency-Key is honoured)
   -> 201, `Location: /api/v1/uploads/ID`, `Upload-Expires`. 413 above the limit, 429 too many of one person, 507 no room.
2. `PATCH /api/v1/uploads/ID` with `Content-Type: application/offset+octet-stream`, `Upload-Offset: N` and the bytes from N on, as
   many as one likes (pieces of 8 MB give a fair progress bar); optional `Upload-Checksum: sha256 B64` of this piece: all of it then
   counts or nothing -> 204, `Upload-Offset: N2`. 409 another offset, 423 another request sends it, 460 checksum, 503 too many at once.
3. Whatever broke: `HEAD /api/v1/uploads/ID` -> 200, `Upload-Offset`, `Upload-Length`; go on with 2. It may be another process, days
   later: `GET /api/v1/uploads` lists one's own with filename, sha256, bytes and received.
4. `POST /api/v1/uploads/ID/part` -> 201 and the Part, checked like one of `POST /api/v1/parts`; the whole file's sha256 is compared
   first. Twice gives the same part. 409 if bytes are missing, 422 if it is no mesh (the upload stays until it expires or is deleted).
`DELETE /api/v1/uploads/ID` gives it up. One of which nothing is heard for KEPT_S is forgotten.
"""

from __future__ import annotations

import asyncio
import base64
import binascii
import os
import re
import shutil
from email.utils import formatdate
from typing import Annotated, Any

import structlog
from fastapi import APIRouter, Header, Request, Response
from sqlalchemy import Connection
from sqlalchemy.exc import SQLAlchemyError

from cellctl.api import parts as part_routes
from cellctl.api.context import Service
from cellctl.api.idempotent import IdempotencyKey, once
from cellctl.api.incoming import Incoming, path_of, receive
from cellctl.api.models import Part
from cellctl.api.models_uploads import Upload, Uploads
from cellctl.api.problems import DOCUMENTED, ApiError
from cellctl.api.sign_in import Operator, Person, ServiceOf
from cellctl.store import audit, blobs, parts, uploads
from cellctl.store.ids import new_id
from cellctl.store.parts import NotFoundError
from cellctl.store.uploads import UploadRow

VERSION = "1.0.0"
OF_PERSON_MAX = 5  # uploads of one person that are not finished
KEPT_S = 86_400.0  # since the last byte
SWEEP_S = 600.0
ROOM_KEPT_BYTES = 500_000_000  # of the disk, for the cell's own journal: an upload never takes it
OFFSET_TYPE = "application/offset+octet-stream"
HEX = re.compile(r"[0-9a-f]{64}")
TUS = {"Tus-Resumable": VERSION}
DIGITS = re.compile(r"[0-9]{1,15}")

TusVersion = Annotated[str | None, Header(alias="Tus-Resumable", description=VERSION)]
log = structlog.get_logger(__name__)
router = APIRouter(prefix="/api/v1/uploads", tags=["uploads"], responses=DOCUMENTED)


def document(row: UploadRow) -> Upload:
    """An upload as it is told."""
    return Upload(
        id=row.id,
        filename=row.filename,
        units="inch" if row.units == "inch" else "mm",
        sha256=row.sha256,
        bytes=row.bytes,
        received=row.received,
        created_at=row.created_at,
        expires_at=row.touched_at + KEPT_S,
        part_id=row.part_id,
    )


def _check_version(version: str | None) -> None:
    if version != VERSION:
        raise ApiError(
            412,
            "Another protocol",
            f"this is tus {VERSION}, the request says {version or 'nothing'}",
            f"send Tus-Resumable: {VERSION}",
            {"Tus-Version": VERSION},
        )


def number_of(name: str, text: str | None) -> int:
    """A header's number of bytes. Raises ApiError 400."""
    if text is None or not DIGITS.fullmatch(text):
        raise ApiError(400, "Bad request", f"{name} is {'missing' if text is None else 'not a number of bytes'}", f"send {name}: BYTES")
    return int(text)


def metadata_of(text: str) -> dict[str, str]:
    """Keys and decoded values of Upload-Metadata. Raises ApiError 400."""
    found: dict[str, str] = {}
    for pair in filter(None, (item.strip() for item in text.split(","))):
        key, _, value = pair.partition(" ")
        try:
            found[key] = base64.b64decode(value.strip(), validate=True).decode("utf-8")
        except (binascii.Error, ValueError):
            raise ApiError(400, "Bad request", f"Upload-Metadata: {key[:40]} is not Base64 of UTF-8", "encode every value") from None
    return found


def checksum_of(text: str | None) -> bytes | None:
    """The SHA-256 in Upload-Checksum. Raises ApiError 400."""
    if text is None:
        return None
    algorithm, _, value = text.partition(" ")
    try:
        digest = base64.b64decode(value, validate=True)
    except (binascii.Error, ValueError):
        digest = b""
    if algorithm != "sha256" or len(digest) != 32:
        raise ApiError(400, "Bad request", "Upload-Checksum is not `sha256 BASE64`", "send the SHA-256 of this piece in Base64")
    return digest


def _own(rows: Connection, person: Person, upload_id: str) -> UploadRow:
    """An upload of this person; that of another one is none. Raises NotFoundError."""
    row = uploads.get(rows, upload_id)
    if row.who != person.name:
        raise NotFoundError("upload", upload_id)
    return row


def check_room(service: Service, rows: Connection, person: Person, size: int) -> None:
    """Raise ApiError 413, 429 or 507 unless an upload of this size may begin."""
    limit = service.settings.resumable_limit_bytes
    if size > limit:
        raise ApiError(413, "Too large", f"{size} bytes; the limit is {limit}", "export with a coarser tolerance, or raise the limit")
    mine = [row for row in uploads.of_person(rows, person.name) if row.part_id is None]
    if len(mine) >= OF_PERSON_MAX:
        raise ApiError(
            429,
            "Too many uploads",
            f"{person.name} has {len(mine)} unfinished uploads, {OF_PERSON_MAX} are allowed",
            "finish or delete one of GET /api/v1/uploads",
            {"Retry-After": "60"},
        )
    free = shutil.disk_usage(service.store.blobs.uploads).free - uploads.open_bytes(rows) - ROOM_KEPT_BYTES
    if size > free:
        raise ApiError(
            507,
            "The disk is full",
            f"{size / 1e6:.0f} MB are announced, {max(free, 0) / 1e6:.0f} MB are free for uploads",
            "make room on the disk of the store, or give up other uploads",
        )


def expires(row: UploadRow) -> dict[str, str]:
    """The headers that every answer about an upload has."""
    return {**TUS, "Upload-Expires": formatdate(row.touched_at + KEPT_S, usegmt=True)}


@router.options("", status_code=204, operation_id="describe_uploads")
def options(service: ServiceOf) -> Response:
    """Which version and extensions of tus are spoken here, and the largest size."""
    return Response(
        status_code=204,
        headers={
            **TUS,
            "Tus-Version": VERSION,
            "Tus-Extension": "creation,checksum,expiration,termination",
            "Tus-Checksum-Algorithm": "sha256",
            "Tus-Max-Size": str(service.settings.resumable_limit_bytes),
        },
    )


@router.post("", status_code=201, operation_id="create_upload", response_model=None, responses={201: {"model": Upload}})
def create(
    person: Operator,
    service: ServiceOf,
    tus: TusVersion = None,
    length: Annotated[str | None, Header(alias="Upload-Length", description="size of the file, bytes")] = None,
    metadata: Annotated[str, Header(alias="Upload-Metadata", max_length=4000, description="filename, units, sha256; values in Base64")] = "",
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Announce a file. Its bytes follow by PATCH to the Location of the answer."""
    _check_version(tus)
    size = number_of("Upload-Length", length)
    told = metadata_of(metadata)
    filename, units, sha256 = told.get("filename", ""), told.get("units", "mm"), told.get("sha256", "").lower()
    name, suffix = part_routes.safe_name(filename)
    if units not in ("mm", "inch") or (sha256 and not HEX.fullmatch(sha256)):
        raise ApiError(422, "The request does not fit", "Upload-Metadata: units is mm or inch, sha256 is 64 hex digits", "correct it")
    now = service.store.clock()
    row = UploadRow(new_id("upload", now), person.name, f"{name}{suffix}", units, sha256, size, now, now)

    def make(rows: Connection) -> dict[str, Any]:
        check_room(service, rows, person, size)
        path_of(service.store, row.id).touch(mode=0o600, exist_ok=False)
        uploads.add(rows, row)
        audit.add(rows, person.deed("announce upload", row.id), now, "ok")
        return document(row).model_dump()

    answer, _ = once(service, person, idempotency_key, ("upload", filename, units, sha256, size), make)
    made = Upload(**answer)
    headers = {**expires(row), "Location": f"/api/v1/uploads/{made.id}"}
    return Response(made.model_dump_json(), 201, headers, media_type="application/json")


@router.get("", operation_id="list_uploads")
def list_uploads(person: Operator, service: ServiceOf) -> Uploads:
    """One's own uploads: what to go on with."""
    with service.store.read() as rows:
        return Uploads(items=[document(row) for row in uploads.of_person(rows, person.name)])


@router.get("/{upload_id}", operation_id="get_upload")
def get_upload(person: Operator, service: ServiceOf, upload_id: str) -> Upload:
    """One of one's own uploads."""
    with service.store.read() as rows:
        return document(_own(rows, person, upload_id))


@router.head("/{upload_id}", operation_id="get_upload_offset", status_code=200, response_class=Response)
def offset(person: Operator, service: ServiceOf, upload_id: str, tus: TusVersion = None) -> Response:
    """From which byte to go on: Upload-Offset."""
    _check_version(tus)
    with service.store.read() as rows:
        row = _own(rows, person, upload_id)
    headers = {**expires(row), "Upload-Offset": str(row.received), "Upload-Length": str(row.bytes), "Cache-Control": "no-store"}
    return Response(status_code=200, headers=headers)


@router.patch(
    "/{upload_id}",
    status_code=204,
    operation_id="send_upload",
    openapi_extra={"requestBody": {"required": True, "content": {OFFSET_TYPE: {"schema": {"type": "string", "format": "binary"}}}}},
)
async def send(
    person: Operator,
    service: ServiceOf,
    request: Request,
    upload_id: str,
    tus: TusVersion = None,
    start: Annotated[str | None, Header(alias="Upload-Offset", description="byte that this piece begins with")] = None,
    checksum: Annotated[str | None, Header(alias="Upload-Checksum", description="`sha256 BASE64` of this piece")] = None,
) -> Response:
    """Send bytes from an offset on. They are on the disk when this is answered."""
    _check_version(tus)
    if request.headers.get("content-type", "").partition(";")[0].strip() != OFFSET_TYPE:
        raise ApiError(415, "Another content", "a piece of an upload is no document", f"send Content-Type: {OFFSET_TYPE}")
    begin, digest = number_of("Upload-Offset", start), checksum_of(checksum)

    def opened() -> tuple[UploadRow, Incoming]:
        with service.store.read() as rows:
            row = _own(rows, person, upload_id)
        if row.part_id is not None or begin != row.received:
            raise ApiError(
                409, "Another offset", f"{row.received} of {row.bytes} bytes are here, not {begin}", "ask for the offset by HEAD"
            )
        return row, Incoming(service.store, row, digest)

    with service.receiving.one(upload_id):
        row, incoming = await asyncio.to_thread(opened)
        reached = await receive(incoming, request.stream())
    return Response(status_code=204, headers={**expires(row), "Upload-Offset": str(reached)})


@router.post("/{upload_id}/part", status_code=201, operation_id="finish_upload")
async def finish(person: Operator, service: ServiceOf, upload_id: str) -> Part:
    """Make a part of an upload that is complete: checked, mended where that does not change its shape, and kept."""
    with service.receiving.one(upload_id):
        row, made = await asyncio.to_thread(_complete, service, person, upload_id)
        if made is not None:
            return made
        with service.store.blobs.staging() as folder:
            path = folder / row.filename
            sha256 = await asyncio.to_thread(_verified, service, row)
            os.link(path_of(service.store, row.id), path)
            sent = part_routes.Sent(path, sha256, row.bytes, row.units, upload_id=row.id)
            part = await part_routes.accept(service, person, folder, sent)
        path_of(service.store, row.id).unlink(missing_ok=True)
    return part


def _complete(service: Service, person: Person, upload_id: str) -> tuple[UploadRow, Part | None]:
    """The upload, and the part that it became already. Raises ApiError 409 if bytes are missing."""
    with service.store.read() as rows:
        row = _own(rows, person, upload_id)
        if row.part_id is not None:
            return row, part_routes.document(parts.get(rows, row.part_id))
    if row.received < row.bytes:
        raise ApiError(409, "Not complete", f"{row.received} of {row.bytes} bytes are here", "send the rest by PATCH")
    return row, None


def _verified(service: Service, row: UploadRow) -> str:
    """SHA-256 of the whole file. Raises ApiError 422 if it is not what the sender said."""
    sha256 = blobs.sha256_of(path_of(service.store, row.id))
    if row.sha256 and sha256 != row.sha256:
        raise ApiError(
            422, "Checksum mismatch", f"{row.filename}: arrived with SHA-256 {sha256}, announced was {row.sha256}", "send the file again"
        )
    return sha256


@router.delete("/{upload_id}", status_code=204, operation_id="delete_upload")
async def terminate(person: Operator, service: ServiceOf, upload_id: str, tus: TusVersion = None) -> Response:
    """Give an upload up."""
    _check_version(tus)

    def remove() -> None:
        with service.store.write() as rows:
            _own(rows, person, upload_id)
            uploads.remove(rows, upload_id)
            audit.add(rows, person.deed("give upload up", upload_id), service.store.clock(), "ok")
        path_of(service.store, upload_id).unlink(missing_ok=True)

    with service.receiving.one(upload_id):
        await asyncio.to_thread(remove)
    return Response(status_code=204, headers=TUS)


def sweep(service: Service) -> list[str]:
    """Forget uploads of which nothing was heard for KEPT_S, and files that belong to none; the ids of the forgotten."""
    with service.store.write() as rows:
        quiet = uploads.untouched_since(rows, service.store.clock() - KEPT_S)
        old = [row.id for row in quiet if not service.receiving.is_under_way(row.id)]
        for upload_id in old:
            uploads.remove(rows, upload_id)
        known = uploads.every_id(rows)
        for path in service.store.blobs.uploads.iterdir():
            if path.name not in known:
                path.unlink(missing_ok=True)
    return old


async def sweep_now_and_then(service: Service) -> None:
    """`sweep`, for as long as the service lives. Call as one task."""
    while True:
        try:
            await asyncio.to_thread(sweep, service)
        except (SQLAlchemyError, OSError) as error:
            log.error("uploads are not swept", error=str(getattr(error, "orig", error)))
        await asyncio.sleep(SWEEP_S)
