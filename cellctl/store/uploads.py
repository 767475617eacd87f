"""Uploads that can be resumed: who sends what, and how many of its bytes are safe on the disk."""

from __future__ import annotations

from dataclasses import dataclass

from sqlalchemy import Connection, RowMapping, delete, func, insert, select, update

from cellctl.store.parts import NotFoundError
from cellctl.store.schema import uploads


@dataclass(frozen=True)
class UploadRow:
    """One upload. bytes : in all; received : on the disk; sha256 : as the sender said it, empty if not; touched_at : Unix s

    part_id : the part that it became
    """

    id: str
    who: str
    filename: str
    units: str
    sha256: str
    bytes: int
    created_at: float
    touched_at: float
    received: int = 0
    part_id: str | None = None


def _row(values: RowMapping) -> UploadRow:
    return UploadRow(**{name: values[name] for name in UploadRow.__dataclass_fields__})


def add(connection: Connection, row: UploadRow) -> None:
    """Add an upload of which nothing has come."""
    connection.execute(insert(uploads).values(**row.__dict__))


def get(connection: Connection, upload_id: str) -> UploadRow:
    """One upload. Raises NotFoundError."""
    row = connection.execute(select(uploads).where(uploads.c.id == upload_id)).mappings().first()
    if row is None:
        raise NotFoundError("upload", upload_id)
    return _row(row)


def of_person(connection: Connection, who: str) -> list[UploadRow]:
    """All of one person, oldest first."""
    rows = connection.execute(select(uploads).where(uploads.c.who == who).order_by(uploads.c.created_at, uploads.c.id))
    return [_row(row) for row in rows.mappings()]


def open_bytes(connection: Connection) -> int:
    """How many bytes are still to come, of all uploads."""
    query = select(func.coalesce(func.sum(uploads.c.bytes - uploads.c.received), 0)).where(uploads.c.part_id.is_(None))
    return int(connection.execute(query).scalar_one())


def advance(connection: Connection, upload_id: str, received: int, at: float) -> None:
    """So many bytes are safe on the disk now."""
    connection.execute(update(uploads).where(uploads.c.id == upload_id).values(received=received, touched_at=at))


def became(connection: Connection, upload_id: str, part_id: str) -> None:
    """It is a part now."""
    connection.execute(update(uploads).where(uploads.c.id == upload_id).values(part_id=part_id))


def remove(connection: Connection, upload_id: str) -> None:
    """Forget it."""
    connection.execute(delete(uploads).where(uploads.c.id == upload_id))


def untouched_since(connection: Connection, at: float) -> list[UploadRow]:
    """Those of which nothing was heard since."""
    return [_row(row) for row in connection.execute(select(uploads).where(uploads.c.touched_at < at)).mappings()]


def every_id(connection: Connection) -> set[str]:
    """The ids of all."""
    return {row.id for row in connection.execute(select(uploads.c.id))}
