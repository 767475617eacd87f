"""Versions of what was measured at the machine; the cell process writes them, here they are read."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import msgspec
from sqlalchemy import Connection, select

from cellctl.domain.measured import Measured
from cellctl.store.schema import measured


@dataclass(frozen=True)
class Version:
    """One version. at : Unix time (s); what : in a line; points : what it was made from"""

    seq: int
    at: float
    who: str
    because: str
    what: str
    document: Measured
    points: dict[str, Any]


def newest(connection: Connection, cell: str) -> Version | None:
    """What stands for the cell of this name; None: nothing was measured, the cell file stands."""
    found = versions(connection, cell, 1)
    return found[0] if found else None


def versions(connection: Connection, cell: str, limit: int) -> list[Version]:
    """Newest first."""
    rows = connection.execute(select(measured).where(measured.c.cell == cell).order_by(measured.c.seq.desc()).limit(limit))
    return [
        Version(row.seq, row.at, row.who, row.because, row.what, msgspec.json.decode(row.document, type=Measured), json.loads(row.points))
        for row in rows
    ]
