"""What people leave at a job: tags, notes and attachments. Notes and attachments are only ever added."""

from __future__ import annotations

import json
from dataclasses import dataclass

from sqlalchemy import Connection, delete, func, insert, select, update

from cellctl.store.job_tables import job_attachments, job_notes, job_tags
from cellctl.store.parts import NotFoundError
from cellctl.store.schema import jobs


@dataclass(frozen=True)
class Note:
    """A remark. at : Unix time, s"""

    seq: int
    at: float
    who: str
    text: str


@dataclass(frozen=True)
class Attachment:
    """A file at a job, kept under its hash. name : safe to show and to save; kind : its media type, as its bytes tell"""

    id: str
    at: float
    who: str
    name: str
    kind: str
    bytes: int
    sha256: str


def set_tags(connection: Connection, job_id: str, tags: list[str]) -> None:
    """Give a job these tags instead of those that it has."""
    kept = sorted(set(tags))
    connection.execute(delete(job_tags).where(job_tags.c.job_id == job_id))
    for tag in kept:
        connection.execute(insert(job_tags).values(tag=tag, job_id=job_id))
    connection.execute(update(jobs).where(jobs.c.id == job_id).values(tags=json.dumps(kept, ensure_ascii=False)))


def all_tags(connection: Connection) -> dict[str, int]:
    """Every tag in use, and at how many jobs."""
    query = select(job_tags.c.tag, func.count()).group_by(job_tags.c.tag)
    return dict(sorted((tag, count) for tag, count in connection.execute(query)))  # in every locale alike


def add_note(connection: Connection, job_id: str, at: float, who: str, text: str) -> Note:
    """Add a note."""
    done = connection.execute(insert(job_notes).values(job_id=job_id, at=at, who=who, text=text))
    key = done.inserted_primary_key
    return Note(int(key[0]) if key else 0, at, who, text)


def notes_of(connection: Connection, job_id: str) -> list[Note]:
    """The notes of a job, in order."""
    query = select(*(job_notes.c[name] for name in Note.__dataclass_fields__)).where(job_notes.c.job_id == job_id)
    return [Note(**row) for row in connection.execute(query.order_by(job_notes.c.seq)).mappings()]


def attach(connection: Connection, job_id: str, attachment: Attachment) -> None:
    """Add an attachment whose file is in its place already."""
    connection.execute(insert(job_attachments).values(job_id=job_id, **attachment.__dict__))


def attachments_of(connection: Connection, job_id: str) -> list[Attachment]:
    """The attachments of a job, in order."""
    columns = [job_attachments.c[name] for name in Attachment.__dataclass_fields__]
    query = select(*columns).where(job_attachments.c.job_id == job_id).order_by(job_attachments.c.seq)
    return [Attachment(**row) for row in connection.execute(query).mappings()]


def attachment(connection: Connection, job_id: str, attachment_id: str) -> Attachment:
    """One attachment of a job. Raises NotFoundError."""
    for one in attachments_of(connection, job_id):
        if one.id == attachment_id:
            return one
    raise NotFoundError("attachment", attachment_id)
