"""The audit trail: who did what, from where and why. Rows are added, nothing else; each holds the hash of itself and all before it."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, RowMapping, func, insert, select, text

from cellctl.store.pages import page
from cellctl.store.schema import audit

HASHED = ("at", "who", "role", "origin", "verb", "target", "because", "outcome")
NUL = "\N{SYMBOL FOR NULL}"  # in place of a character that PostgreSQL keeps in no text: a deed is written down whatever was typed
COUNTER = text("SELECT seq FROM sqlite_sequence WHERE name = 'audit'")


@dataclass(frozen=True)
class Deed:
    """One command. origin : address that it came from; target : the job, part, token or cell that it was for."""

    who: str
    role: str
    origin: str
    verb: str
    target: str
    because: str


@dataclass(frozen=True)
class Wanted:
    """What is looked for in the trail; None means any. since, until : Unix seconds, from the first to before the second"""

    who: str | None = None
    verb: str | None = None
    target: str | None = None
    since: float | None = None
    until: float | None = None


@dataclass(frozen=True)
class Verdict:
    """What a look through the whole trail found. head : hash of the last row; fault : what does not fit, "" if all does"""

    rows: int
    head: str
    fault: str = ""


def _sha256(before: str, seq: int, values: dict[str, Any] | RowMapping) -> str:
    told = json.dumps([before, seq, *(values[name] for name in HASHED)], ensure_ascii=True)
    return hashlib.sha256(told.encode()).hexdigest()


def add(connection: Connection, deed: Deed, at: float, outcome: str) -> int:
    """Write down a deed and what came of it; returns its number. The transaction must be one that writes: of those there is one at a time."""
    last = connection.execute(select(audit.c.seq, audit.c.sha256).order_by(audit.c.seq.desc()).limit(1)).first()
    seq, before = (int(last.seq) + 1, str(last.sha256)) if last is not None else (1, "")
    values = {"at": at, "outcome": outcome, **deed.__dict__}
    values |= {name: text.replace("\0", NUL) for name, text in values.items() if isinstance(text, str)}
    connection.execute(insert(audit).values(seq=seq, sha256=_sha256(before, seq, values), **values))
    return seq


def of_target(connection: Connection, target: str) -> list[dict[str, Any]]:
    """All deeds for one target, in order."""
    rows = connection.execute(select(audit).where(audit.c.target == target).order_by(audit.c.seq)).mappings()
    return [dict(row) for row in rows]


def find_page(connection: Connection, wanted: Wanted, cursor: str | None, limit: int) -> tuple[list[RowMapping], str | None]:
    """Rows, newest first, and the cursor of the rest. Raises CursorError."""
    query = select(audit)
    for name in ("who", "verb", "target"):
        value = getattr(wanted, name)
        if value is not None:
            query = query.where(audit.c[name] == value)
    if wanted.since is not None:
        query = query.where(audit.c.at >= wanted.since)
    if wanted.until is not None:
        query = query.where(audit.c.at < wanted.until)
    return page(connection, audit, query, cursor, limit)


def verify(connection: Connection, anchor: str = "") -> Verdict:
    """Look through the whole trail.

    anchor : hash of a row that was noted elsewhere, which must still be in it: who can write the whole file could
    otherwise make a new chain of it
    """
    count, before, has_anchor = 0, "", not anchor
    rows = connection.execution_options(yield_per=1000).execute(select(audit).order_by(audit.c.seq)).mappings()
    for row in rows:
        count += 1
        if row["seq"] != count:
            return Verdict(count - 1, before, f"row {count} is missing")
        if row["sha256"] != _sha256(before, count, row):
            return Verdict(count - 1, before, f"row {count} is not what was written, or one before it is missing")
        before = str(row["sha256"])
        has_anchor = has_anchor or before == anchor
    fault = _missing_end(connection, count)
    if not fault and not has_anchor:
        fault = f"no row has the hash {anchor}: the trail was written anew, or the hash is of another store"
    return Verdict(count, before, fault)


def _missing_end(connection: Connection, count: int) -> str:
    if connection.dialect.name != "sqlite":
        return ""
    counted = connection.execute(COUNTER).scalar()
    return f"rows {count + 1} to {counted} are missing" if counted is not None and counted > count else ""


def count(connection: Connection) -> int:
    """How many rows there are."""
    return int(connection.execute(select(func.count()).select_from(audit)).scalar_one())
