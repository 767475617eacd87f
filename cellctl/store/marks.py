"""Marks on the axis of time: alarms, holds, resets, begins and ends of jobs, begins of layers; from the events."""

from __future__ import annotations

import json

from sqlalchemy import Connection, and_, or_, select

from cellctl.domain.messages import Event
from cellctl.store.schema import events

KINDS = ("alarm", "held", "reset", "acknowledge", "job", "layer")
HOLDS = ("HELD", "HOLDING")


def marks(rows: Connection, from_at: float, to_at: float, limit: int, job: str = "", with_layers: bool = False) -> list[Event]:
    """Up to `limit` events between two times (Unix, s) that stand on the axis of time, in order. job : only its own"""
    e = events.c
    kinds = [kind for kind in KINDS if with_layers or kind != "layer"]
    is_hold = and_(e.kind == "state", or_(*(e.text.startswith(f"{state}:") for state in HOLDS)))
    query = select(e.seq, e.at, e.kind, e.text, e.job, e.data).where(e.at >= from_at, e.at < to_at, or_(e.kind.in_(kinds), is_hold))
    if job:
        query = query.where(e.job == job)
    found = rows.execute(query.order_by(e.seq).limit(limit))
    return [Event(row.seq, row.at, row.kind, row.text, row.job, json.loads(row.data)) for row in found]
