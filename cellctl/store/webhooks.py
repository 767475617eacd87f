"""Webhooks: who is told of what, how far each was told, and what is to be told next.

Two rows of numbers are followed, each in its own order: steps of jobs, and events of the cell.
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
from cellctl.store.schema import events, jobs, webhooks

SECRET_PREFIX = "whsec_"  # of the Standard Webhooks specification
SECRET_BYTES = 32
CELL_KINDS = ("alarm", "reset", "held", "state", "layer")
"""Kinds of the cell's events that are told."""
TOPICS = (*(f"job.{state.value}" for state in JobState), *(f"cell.{kind}" for kind in CELL_KINDS), "job.*", "cell.*")


@dataclass(frozen=True)
class Hook:
    """One receiver. topics : of TOPICS; step_seq, event_seq : the last of each that it was told

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


def create(connection: Connection, url: str, topics: tuple[str, ...], at: float, by: str) -> tuple[Hook, str]:
    """A new receiver, told of what happens from now on; and the secret that its letters are signed with."""
    secret = SECRET_PREFIX + base64.b64encode(secrets.token_bytes(SECRET_BYTES)).decode()
    values = {
        "id": new_id("hook", at), "url": url, "topics": json.dumps(topics), "secret": secret, "created_at": at, "created_by": by,
        "step_seq": _last(connection, job_steps), "event_seq": _last(connection, events),
    }  # fmt: skip
    connection.execute(insert(webhooks).values(**values))
    return get(connection, str(values["id"])), secret


def _last(connection: Connection, table: Any) -> int:
    return int(connection.execute(select(func.coalesce(func.max(table.c.seq), 0))).scalar_one())


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


def resume(connection: Connection, hook_id: str) -> Hook:
    """Tell one that was paused, or that refuses, again: now, and from where it stopped. Raises NotFoundError."""
    change(connection, hook_id, paused="", failing_since=None, failures=0, next_at=0.0)
    return get(connection, hook_id)


def letters(connection: Connection, hook: Hook, limit: int) -> list[Letter]:
    """What it has not been told yet, in the order of time, each row of numbers in its own order; those that it does not want only move the number."""
    steps = select(job_steps, jobs.c.name).join(jobs, jobs.c.id == job_steps.c.job_id).where(job_steps.c.seq > hook.step_seq)
    found = [
        Letter(f"step-{row['seq']}", f"job.{row['state']}", row["at"], {
            "job": row["job_id"], "name": row["name"], "left": row["left"], "state": row["state"], "why": row["why"], "who": row["who"],
        }, step_seq=row["seq"])
        for row in connection.execute(steps.order_by(job_steps.c.seq).limit(limit)).mappings()
    ]  # fmt: skip
    told = select(events).where(events.c.seq > hook.event_seq, events.c.kind.in_(CELL_KINDS)).order_by(events.c.seq).limit(limit)
    found += [
        Letter(f"event-{row['seq']}", f"cell.{row['kind']}", row["at"], {
            "seq": row["seq"], "job": row["job"], "text": row["text"], "data": json.loads(row["data"]),
        }, event_seq=row["seq"])
        for row in connection.execute(told).mappings()
    ]  # fmt: skip
    return sorted(found, key=lambda letter: letter.at)
