"""Webhooks: who is told of what, how far each was told, and what is to be told next.

Two rows of numbers are followed, each in its own order: steps of jobs, which all hosts share, and events of the cell, which each host has
for itself, with how far each receiver was told of them. A host takes a receiver for itself while it tells it.

rows : of the shared tables; cell_rows : of the cell's own
"""

from __future__ import annotations

import base64
import json
import secrets
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, RowMapping, delete, func, insert, select, update

from cellctl.domain.jobs import JobState
from cellctl.store.ids import new_id
from cellctl.store.job_tables import job_steps
from cellctl.store.parts import NotFoundError
from cellctl.store.schema import events, hook_places, jobs, webhooks

SECRET_PREFIX = "whsec_"  # of the Standard Webhooks specification
SECRET_BYTES = 32
CELL_KINDS = ("alarm", "reset", "held", "state", "layer")
"""Kinds of the cell's events that are told."""
TOPICS = (*(f"job.{state.value}" for state in JobState), *(f"cell.{kind}" for kind in CELL_KINDS), "job.*", "cell.*")


@dataclass(frozen=True)
class Hook:
    """One receiver. topics : of TOPICS; step_seq : the last step that it was told; event_seq : the newest event when it was added

    failing_since : Unix time (s) of the first refusal since it last took something, None if it takes; paused : why it is told nothing more
    """

    id: str
    url: str
    topics: tuple[str, ...]
    created_at: float
    created_by: str
    step_seq: int
    event_seq: int
    delivered_at: float | None
    failing_since: float | None
    failures: int
    next_at: float
    last_error: str
    paused: str

    def wants(self, topic: str) -> bool:
        """Whether it is told of this."""
        return topic in self.topics or f"{topic.partition('.')[0]}.*" in self.topics


@dataclass(frozen=True)
class Letter:
    """One thing to be told. id : the same whenever it is told again; at : Unix time (s); step_seq, event_seq : how far it brings the receiver"""

    id: str
    topic: str
    at: float
    data: dict[str, Any]
    step_seq: int = 0
    event_seq: int = 0


def _hook(row: RowMapping) -> Hook:
    fields = {name: row[name] for name in Hook.__dataclass_fields__}
    return Hook(**{**fields, "topics": tuple(json.loads(fields["topics"]))})


def create(connection: Connection, url: str, topics: tuple[str, ...], at: float, by: str, event_seq: int) -> tuple[Hook, str]:
    """A new receiver, told of what happens from now on; and the secret that its letters are signed with. event_seq : of the newest event"""
    secret = SECRET_PREFIX + base64.b64encode(secrets.token_bytes(SECRET_BYTES)).decode()
    values = {
        "id": new_id("hook", at), "url": url, "topics": json.dumps(topics), "secret": secret, "created_at": at, "created_by": by,
        "step_seq": int(connection.execute(select(func.coalesce(func.max(job_steps.c.seq), 0))).scalar_one()), "event_seq": event_seq,
    }  # fmt: skip
    connection.execute(insert(webhooks).values(**values))
    return get(connection, str(values["id"])), secret


def get(connection: Connection, hook_id: str) -> Hook:
    """One. Raises NotFoundError."""
    row = connection.execute(select(webhooks).where(webhooks.c.id == hook_id)).mappings().first()
    if row is None:
        raise NotFoundError("webhook", hook_id)
    return _hook(row)


def secret_of(connection: Connection, hook_id: str) -> str:
    """What its letters are signed with."""
    return str(connection.execute(select(webhooks.c.secret).where(webhooks.c.id == hook_id)).scalar_one())


def every(connection: Connection) -> list[Hook]:
    """All, oldest first."""
    return [_hook(row) for row in connection.execute(select(webhooks).order_by(webhooks.c.created_at, webhooks.c.id)).mappings()]


def remove(connection: Connection, hook_id: str) -> None:
    """Tell it nothing more. Raises NotFoundError."""
    if connection.execute(delete(webhooks).where(webhooks.c.id == hook_id)).rowcount == 0:
        raise NotFoundError("webhook", hook_id)


def change(connection: Connection, hook_id: str, **values: Any) -> None:
    """Write down how far it is, or why it refuses; of one that was removed meanwhile nothing is kept."""
    connection.execute(update(webhooks).where(webhooks.c.id == hook_id).values(**values))


def take(connection: Connection, hook_id: str, now: float, until: float) -> Hook | None:
    """The receiver, for one host alone until then (Unix time, s); None if it is not due, or another host has it."""
    due = (webhooks.c.id == hook_id, webhooks.c.next_at <= now, webhooks.c.paused == "")
    taken = connection.execute(update(webhooks).where(*due).values(next_at=until)).rowcount
    return get(connection, hook_id) if taken else None


def event_place(cell_rows: Connection, hook: Hook, is_shared: bool) -> int:
    """Number of the last event of this host that it was told of; at first, of what happened before it was added, here or at another host."""
    known = cell_rows.execute(select(hook_places.c.event_seq).where(hook_places.c.hook == hook.id)).scalar()
    if known is not None:
        return int(known)
    if not is_shared:
        return hook.event_seq
    return int(cell_rows.execute(select(func.coalesce(func.max(events.c.seq), 0)).where(events.c.at <= hook.created_at)).scalar_one())


def set_event_place(cell_rows: Connection, hook_id: str, event_seq: int) -> None:
    """It was told of the events of this host up to that number."""
    here = hook_places.c.hook == hook_id
    if cell_rows.execute(update(hook_places).where(here).values(event_seq=event_seq)).rowcount == 0:
        cell_rows.execute(insert(hook_places).values(hook=hook_id, event_seq=event_seq))


def resume(connection: Connection, hook_id: str) -> Hook:
    """Tell one that was paused, or that refuses, again: now, and from where it stopped. Raises NotFoundError."""
    change(connection, hook_id, paused="", failing_since=None, failures=0, next_at=0.0)
    return get(connection, hook_id)


def letters(rows: Connection, cell_rows: Connection, hook: Hook, event_seq: int, limit: int, cell: str = "") -> list[Letter]:
    """What it has not been told yet, in the order of time, each row of numbers in its own order; those that it does not want only move the number.

    event_seq : up to which it knows the events of this host; cell : whose they are, where there are others
    """
    steps = select(job_steps, jobs.c.name).join(jobs, jobs.c.id == job_steps.c.job_id).where(job_steps.c.seq > hook.step_seq)
    found = [
        Letter(f"step-{row['seq']}", f"job.{row['state']}", row["at"], {
            "job": row["job_id"], "name": row["name"], "left": row["left"], "state": row["state"], "why": row["why"], "who": row["who"],
        }, step_seq=row["seq"])
        for row in rows.execute(steps.order_by(job_steps.c.seq).limit(limit)).mappings()
    ]  # fmt: skip
    told = select(events).where(events.c.seq > event_seq, events.c.kind.in_(CELL_KINDS)).order_by(events.c.seq).limit(limit)
    found += [
        Letter(f"event-{cell}-{row['seq']}" if cell else f"event-{row['seq']}", f"cell.{row['kind']}", row["at"], {
            "seq": row["seq"], "job": row["job"], "text": row["text"], "data": json.loads(row["data"]), **({"cell": cell} if cell else {}),
        }, event_seq=row["seq"])
        for row in cell_rows.execute(told).mappings()
    ]  # fmt: skip
    return sorted(found, key=lambda letter: letter.at)
