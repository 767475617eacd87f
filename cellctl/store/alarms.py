"""Alarms by incident: what was latched between two resets, its first cause, what followed, who saw it and who reset it.

Derived from the events, which the cell process has on the disk before anybody is told: there is no second account that could differ from
them, and what earlier versions wrote down is there as well.
"""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import Connection, Row, func, select

from cellctl.store.parts import NotFoundError
from cellctl.store.schema import events

PAGE_ROWS = 500  # events looked through at a time


@dataclass(frozen=True)
class Told:
    """One alarm of an incident. seq : of its event; at : Unix s; line, layer : where the job was, None if none ran or nobody wrote it down

    instead_of : codes of reports that it explained and took the place of
    """

    seq: int
    at: float
    code: str
    cause: str
    remedy: str
    line: int | None = None
    layer: int | None = None
    instead_of: tuple[str, ...] = ()
    acknowledged_by: str = ""
    acknowledged_at: float | None = None


@dataclass(frozen=True)
class Incident:
    """What was latched together. id : number of its first event; first : its first cause; followed : the others, as they came

    ended_at : Unix s of the reset, None while it is latched; because : why it was reset
    """

    id: int
    job: str
    first: Told
    followed: tuple[Told, ...] = ()
    ended_at: float | None = None
    reset_by: str = ""
    because: str = ""

    @property
    def at(self) -> float:
        """When it began (Unix, s)."""
        return self.first.at

    @property
    def codes(self) -> list[str]:
        """Of all its alarms."""
        return [self.first.code, *(told.code for told in self.followed)]


@dataclass
class _Open:
    """Rows of one incident, oldest first."""

    alarms: list[Any] = field(default_factory=list)
    seen: list[Any] = field(default_factory=list)


def incidents(
    rows: Connection, before: int | None, limit: int, code: str = "", job: str = "", from_at: float = 0.0, to_at: float = 0.0
) -> list[Incident]:
    """Up to `limit` incidents that began before event number `before`, newest first.

    code : only those in which this alarm was; job : only of this job; from_at, to_at : only those that began in this time (0: no bound)
    """
    found: list[Incident] = []
    for one in _newest_first(rows, before):
        if from_at and one.at < from_at:
            break
        if (not code or code in one.codes) and (not job or one.job == job) and (not to_at or one.at < to_at):
            found.append(one)
        if len(found) == limit:
            break
    return found


def incident(rows: Connection, ident: int) -> Incident:
    """The incident in which alarm event number `ident` was. Raises NotFoundError."""
    e = events.c
    kind = rows.execute(select(e.kind).where(e.seq == ident)).scalar_one_or_none()
    if kind != "alarm":
        raise NotFoundError("alarm", str(ident))
    start = rows.execute(select(func.coalesce(func.max(e.seq), 0)).where(e.kind == "reset", e.seq < ident)).scalar_one()
    end = rows.execute(select(func.min(e.seq)).where(e.kind == "reset", e.seq > ident)).scalar_one()
    return _incident(rows, _between(rows, int(start), end), end)


def active(rows: Connection) -> Incident | None:
    """What is latched and not reset since, by what was written down."""
    first = next(_newest_first(rows, None), None)
    return first if first is not None and first.ended_at is None else None


def _newest_first(rows: Connection, before: int | None) -> Iterator[Incident]:
    """Whole incidents, newest first; those whose first event is older than number `before`."""
    e = events.c
    while True:
        query = select(e.seq).where(e.kind == "alarm").order_by(e.seq.desc()).limit(PAGE_ROWS)
        seqs = [int(seq) for (seq,) in rows.execute(query if before is None else query.where(e.seq < before))]
        if not seqs:
            return
        resets = [int(seq) for (seq,) in rows.execute(select(e.seq).where(e.kind == "reset", e.seq > seqs[-1]).order_by(e.seq))]
        begin = rows.execute(select(func.coalesce(func.max(e.seq), 0)).where(e.kind == "reset", e.seq < seqs[-1])).scalar_one()
        bounds = [int(begin), *resets]
        for at in sorted({bisect_right(bounds, seq) for seq in seqs}, reverse=True):
            end = bounds[at] if at < len(bounds) else None
            one = _incident(rows, _between(rows, bounds[at - 1], end), end)
            if before is None or one.id < before:
                yield one
                before = one.id


def _between(rows: Connection, start: int, end: int | None) -> _Open:
    """Alarms and acknowledgements between two resets."""
    e = events.c
    query = select(e.seq, e.at, e.kind, e.text, e.job, e.data).where(e.kind.in_(("alarm", "acknowledge")), e.seq > start).order_by(e.seq)
    found = rows.execute(query if end is None else query.where(e.seq < end)).all()
    return _Open([row for row in found if row.kind == "alarm"], [row for row in found if row.kind == "acknowledge"])


def _incident(rows: Connection, found: _Open, reset_seq: int | None) -> Incident:
    told: dict[str, Told] = {}
    for row in found.alarms:
        _take(told, row)
    for row in found.seen:
        data = json.loads(row.data)
        for code in data["codes"]:
            if code in told and not told[code].acknowledged_by and told[code].seq < row.seq:
                told[code] = _seen(told[code], str(data["who"]), row.at)
    first, *others = sorted(told.values(), key=lambda one: (one.at, one.seq))
    job = next((row.job for row in found.alarms if row.job), "")
    ident = int(found.alarms[0].seq)
    if reset_seq is None:
        return Incident(ident, job, first, tuple(others))
    ended_at, who, because = _reset(rows, reset_seq)
    return Incident(ident, job, first, tuple(others), ended_at, who, because)


def _take(told: dict[str, Told], row: Row[Any]) -> None:
    """One alarm in place of those that it explains: it began with the earliest of them. The same again, after a restart, is no news."""
    data = json.loads(row.data)
    code = str(data.get("code", ""))
    if code in told and code not in data.get("instead_of", ()):
        return
    replaced = [told.pop(known) for known in data.get("instead_of", ()) if known in told]
    at = min([row.at, *(one.at for one in replaced)])
    line, layer = data.get("line"), data.get("layer")
    names = tuple(name for name in dict.fromkeys(name for one in replaced for name in (one.code, *one.instead_of)) if name != code)
    told[code] = Told(int(row.seq), at, code, row.text, str(data.get("shown_remedy") or data.get("remedy") or ""), line, layer, names)


def _seen(one: Told, who: str, at: float) -> Told:
    return Told(one.seq, one.at, one.code, one.cause, one.remedy, one.line, one.layer, one.instead_of, who, at)


def _reset(rows: Connection, seq: int) -> tuple[float, str, str]:
    """When, who and why; before the reset's own event held the reason, the state that it led to did."""
    e = events.c
    found = rows.execute(select(e.at, e.data).where(e.seq == seq)).one()
    data = json.loads(found.data)
    because = data.get("because")
    if because is None:
        following = rows.execute(select(e.data).where(e.seq > seq, e.kind == "state").order_by(e.seq).limit(1)).scalar_one_or_none()
        because = json.loads(following).get("because", "") if following else ""
    return float(found.at), str(data.get("who", "")), str(because)
