"""What was made already: plans, programs and proofs by the key of what they were made from."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, Literal

from sqlalchemy import Connection, Table, select
from sqlalchemy.dialects import postgresql, sqlite

from cellctl.store.schema import plans, programs, proofs

Kind = Literal["plan", "program", "proof"]
TABLES: dict[Kind, Table] = {"plan": plans, "program": programs, "proof": proofs}


@dataclass(frozen=True)
class Made:
    """A finished file. sha256 : names it; summary : its figures for the job."""

    sha256: str
    summary: dict[str, Any]


def find(connection: Connection, kind: Kind, key: str) -> Made | None:
    """What was made for this key, if anything."""
    table = TABLES[kind]
    row = connection.execute(select(table.c.sha256, table.c.summary).where(table.c.key == key)).first()
    return Made(row.sha256, json.loads(row.summary)) if row else None


def add(connection: Connection, kind: Kind, key: str, made: Made, at: float) -> None:
    """Remember it; a second one for the same key takes its place."""
    values = {"sha256": made.sha256, "summary": json.dumps(made.summary), "created_at": at}
    insert = postgresql.insert if connection.dialect.name == "postgresql" else sqlite.insert
    connection.execute(insert(TABLES[kind]).values(key=key, **values).on_conflict_do_update(index_elements=["key"], set_=values))
