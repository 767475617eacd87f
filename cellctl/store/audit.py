"""The audit trail: who did what, from where and why. Rows are added, and their outcome filled in once; nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, insert, select, update

from cellctl.store.schema import audit


@dataclass(frozen=True)
class Deed:
    """One command. origin : address that it came from; target : the job, part, token or cell that it was for."""

    who: str
    role: str
    origin: str
    verb: str
    target: str
    because: str


def add(connection: Connection, deed: Deed, at: float, outcome: str = "asked") -> int:
    """Write it down; returns the row's number for `conclude`."""
    done = connection.execute(insert(audit).values(at=at, outcome=outcome, **deed.__dict__))
    key = done.inserted_primary_key
    return int(key[0]) if key else 0


def conclude(connection: Connection, seq: int, outcome: str) -> None:
    """Fill in what came of it."""
    connection.execute(update(audit).where(audit.c.seq == seq).values(outcome=outcome))


def of_target(connection: Connection, target: str) -> list[dict[str, Any]]:
    """All deeds for one target, in order."""
    rows = connection.execute(select(audit).where(audit.c.target == target).order_by(audit.c.seq)).mappings()
    return [dict(row) for row in rows]
