"""Parts: uploaded meshes as they were inspected."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, RowMapping, insert, select

from cellctl.store.pages import page
from cellctl.store.schema import parts


class NotFoundError(Exception):
    """No row of this kind has this name."""

    def __init__(self, kind: str, name: str) -> None:
        super().__init__(f"there is no {kind} {name[:60]!r}")
        self.kind = kind
        self.name = name


@dataclass(frozen=True)
class Inspection:
    """What was found in a mesh file. bbox_mm : lowest and highest corner; findings : one document each."""

    mesh_sha256: str
    bbox_mm: list[list[float]]
    facets: int
    volume_mm3: float
    findings: list[dict[str, Any]]


@dataclass(frozen=True)
class PartRow:
    """One part. `sha256` names its file, `inspection.mesh_sha256` its mended mesh."""

    id: str
    name: str
    suffix: str
    units: str
    sha256: str
    bytes: int
    created_at: float
    created_by: str
    inspection: Inspection


def _row(values: RowMapping) -> PartRow:
    return PartRow(
        **{
            name: values[name]
            for name in ("id", "name", "suffix", "units", "sha256", "bytes", "created_at", "created_by")
        },
        inspection=Inspection(
            values["mesh_sha256"],
            json.loads(values["bbox_mm"]),
            values["facets"],
            values["volume_mm3"],
            json.loads(values["findings"]),
        ),
    )


def add(connection: Connection, part: PartRow) -> None:
    """Add a part; its files are in place already."""
    seen = part.inspection
    connection.execute(
        insert(parts).values(
            id=part.id,
            name=part.name,
            suffix=part.suffix,
            units=part.units,
            sha256=part.sha256,
            mesh_sha256=seen.mesh_sha256,
            bytes=part.bytes,
            bbox_mm=json.dumps(seen.bbox_mm),
            facets=seen.facets,
            volume_mm3=seen.volume_mm3,
            findings=json.dumps(seen.findings),
            created_at=part.created_at,
            created_by=part.created_by,
        )
    )


def get(connection: Connection, part_id: str) -> PartRow:
    """One part. Raises NotFoundError."""
    row = connection.execute(select(parts).where(parts.c.id == part_id)).mappings().first()
    if row is None:
        raise NotFoundError("part", part_id)
    return _row(row)


def find_page(
    connection: Connection,
    cursor: str | None,
    limit: int,
    text: str | None = None,
    by: str | None = None,
    since: float | None = None,
    until: float | None = None,
) -> tuple[list[PartRow], str | None]:
    """Newest first. text : in the name; by : who uploaded it; since, until : Unix s. Raises CursorError."""
    query = select(parts)
    if text:
        query = query.where(parts.c.name.icontains(text, autoescape=True))
    if by is not None:
        query = query.where(parts.c.created_by == by)
    if since is not None:
        query = query.where(parts.c.created_at >= since)
    if until is not None:
        query = query.where(parts.c.created_at < until)
    rows, following = page(connection, parts, query, cursor, limit)
    return [_row(row) for row in rows], following
