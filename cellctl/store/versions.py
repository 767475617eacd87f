"""Versions of materials and cells: rows that are added and never changed, each with its hash, who made it, when and why."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, RowMapping, Select, func, insert, select, update

from cellctl.store.pages import page
from cellctl.store.parts import NotFoundError
from cellctl.store.schema import cell_versions, material_versions

SHIPPED = "shipped"  # who made the versions that come with the software


@dataclass(frozen=True)
class MaterialVersion:
    """One version of a material. version : from 1; sha256 : of the validated facts; toml : the facts"""

    name: str
    version: int
    sha256: str
    toml: str
    because: str
    created_at: float
    created_by: str


@dataclass(frozen=True)
class CellVersion:
    """A cell file as it was seen at starts of the service. file : its path then; starts : how often. Times: Unix s"""

    name: str
    version: int
    sha256: str
    facts: dict[str, Any]
    file: str
    first_seen_at: float
    last_seen_at: float
    starts: int


def _material(values: RowMapping) -> MaterialVersion:
    return MaterialVersion(**{name: values[name] for name in MaterialVersion.__dataclass_fields__})


def _cell(values: RowMapping) -> CellVersion:
    fields = {name: values[name] for name in CellVersion.__dataclass_fields__}
    return CellVersion(**{**fields, "facts": json.loads(fields["facts"])})


def material(connection: Connection, name: str, version: int | None = None, sha256: str = "") -> MaterialVersion:
    """One version of a material: by number, by hash, or else the newest. Raises NotFoundError."""
    c = material_versions.c
    query = select(material_versions).where(c.name == name).order_by(c.version.desc()).limit(1)
    if version is not None:
        query = query.where(c.version == version)
    if sha256:
        query = query.where(c.sha256 == sha256)
    row = connection.execute(query).mappings().first()
    if row is None:
        raise NotFoundError("material" if version is None and not sha256 else f"version {sha256[:12] or version} of material", name)
    return _material(row)


def materials(connection: Connection) -> list[MaterialVersion]:
    """The newest version of every material, by name."""
    c = material_versions.c
    newest = select(func.max(c.seq)).group_by(c.name)
    found = connection.execute(select(material_versions).where(c.seq.in_(newest))).mappings()
    return sorted((_material(row) for row in found), key=lambda row: row.name)  # in every locale alike


def material_page(connection: Connection, name: str, cursor: str | None, limit: int) -> tuple[list[MaterialVersion], str | None]:
    """Versions of a material, newest first. Raises CursorError."""
    query: Select[Any] = select(material_versions).where(material_versions.c.name == name)
    rows, following = page(connection, material_versions, query, cursor, limit)
    return [_material(row) for row in rows], following


def add_material(connection: Connection, name: str, sha256: str, toml: str, because: str, who: str, at: float) -> MaterialVersion:
    """The next version of a material."""
    highest = select(func.coalesce(func.max(material_versions.c.version), 0)).where(material_versions.c.name == name)
    row = MaterialVersion(name, int(connection.execute(highest).scalar_one()) + 1, sha256, toml, because, at, who)
    connection.execute(insert(material_versions).values(**row.__dict__))
    return row


def see_shipped(connection: Connection, name: str, sha256: str, toml: str, at: float, because: str) -> None:
    """A material that comes with the software: its first version, or the next one as long as the shop made none of its own."""
    try:
        newest = material(connection, name)
    except NotFoundError:
        add_material(connection, name, sha256, toml, because, SHIPPED, at)
        return
    if newest.created_by == SHIPPED and newest.sha256 != sha256:
        add_material(connection, name, sha256, toml, because, SHIPPED, at)


def see_cell(connection: Connection, name: str, sha256: str, facts: dict[str, Any], file: str, at: float) -> CellVersion:
    """The service starts with this cell file: another one than the last gives a new version."""
    c = cell_versions.c
    query = select(cell_versions).where(c.name == name).order_by(c.version.desc()).limit(1)
    row = connection.execute(query).mappings().first()
    if row is not None and row["sha256"] == sha256:
        seen = update(cell_versions).where(c.seq == row["seq"]).values(last_seen_at=at, starts=c.starts + 1, file=file)
        connection.execute(seen)
        return cell(connection, name, int(row["version"]))
    version = 1 if row is None else int(row["version"]) + 1
    values = {"name": name, "version": version, "sha256": sha256, "facts": json.dumps(facts), "file": file}
    connection.execute(insert(cell_versions).values(**values, first_seen_at=at, last_seen_at=at, starts=1))
    return cell(connection, name, version)


def cell(connection: Connection, name: str, version: int | None = None) -> CellVersion:
    """One version of a cell, else the newest. Raises NotFoundError."""
    c = cell_versions.c
    query = select(cell_versions).where(c.name == name).order_by(c.version.desc()).limit(1)
    row = connection.execute(query if version is None else query.where(c.version == version)).mappings().first()
    if row is None:
        raise NotFoundError("cell" if version is None else f"version {version} of cell", name)
    return _cell(row)


def cells(connection: Connection) -> list[CellVersion]:
    """The newest version of every cell that a service on this store ran, by name."""
    c = cell_versions.c
    newest = select(func.max(c.seq)).group_by(c.name)
    found = connection.execute(select(cell_versions).where(c.seq.in_(newest))).mappings()
    return sorted((_cell(row) for row in found), key=lambda row: row.name)


def cell_page(connection: Connection, name: str, cursor: str | None, limit: int) -> tuple[list[CellVersion], str | None]:
    """Versions of a cell, newest first. Raises CursorError."""
    query: Select[Any] = select(cell_versions).where(cell_versions.c.name == name)
    rows, following = page(connection, cell_versions, query, cursor, limit)
    return [_cell(row) for row in rows], following
