"""What the cell process wrote: events, runs and the journal. Read only, by `Store.read_cell`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, RowMapping, func, select

from cellctl.domain.messages import Event
from cellctl.store.schema import cell_runs, events, journal

RECENT_RUNS = 50  # among them is every run whose start was not yet followed: the cell runs one at a time


@dataclass(frozen=True)
class Run:
    """One job on the cell. outcome is empty while it runs. Times: Unix, s."""

    job: str
    program_sha256: str
    started_at: float
    ended_at: float | None
    outcome: str
    last_line: int
    total_lines: int


@dataclass(frozen=True)
class LayerFigures:
    """Set-points and read-backs of one layer as sampled while it ran."""

    layer: int
    samples: int
    from_at: float
    to_at: float
    laser_setpoint_max_w: float
    laser_readback_max_w: float
    laser_readback_mean_w: float
    powder_setpoint_max_g_min: float
    powder_readback_max_g_min: float
    powder_readback_mean_g_min: float


def event_of(row: RowMapping) -> Event:
    """An event from its row."""
    return Event(
        seq=row["seq"], at=row["at"], kind=row["kind"], text=row["text"], job=row["job"], data=json.loads(row["data"])
    )


def events_after(connection: Connection, seq: int, limit: int = 500) -> list[Event]:
    """The next events after number `seq`, in order."""
    rows = connection.execute(select(events).where(events.c.seq > seq).order_by(events.c.seq).limit(limit)).mappings()
    return [event_of(row) for row in rows]


def events_before(
    connection: Connection,
    seq: int | None,
    limit: int,
    job: str | None = None,
    kind: str | None = None,
    since: float | None = None,
    until: float | None = None,
) -> list[Event]:
    """The newest events (older than number `seq`), newest first. since, until : Unix s"""
    query = select(events).order_by(events.c.seq.desc()).limit(limit)
    if seq is not None:
        query = query.where(events.c.seq < seq)
    if job is not None:
        query = query.where(events.c.job == job)
    if kind is not None:
        query = query.where(events.c.kind == kind)
    if since is not None:
        query = query.where(events.c.at >= since)
    if until is not None:
        query = query.where(events.c.at < until)
    return [event_of(row) for row in connection.execute(query).mappings()]


def events_of(connection: Connection, job: str) -> list[Event]:
    """All events of a job, in order."""
    return [
        event_of(row)
        for row in connection.execute(select(events).where(events.c.job == job).order_by(events.c.seq)).mappings()
    ]


def last_seq(connection: Connection) -> int:
    """Number of the newest event, 0 if there is none."""
    return int(connection.execute(select(func.coalesce(func.max(events.c.seq), 0))).scalar_one())


def run_of(connection: Connection, job: str) -> Run | None:
    """The run of a job, if it was ever started."""
    return runs_of(connection, [job]).get(job)


def _run(row: RowMapping) -> Run:
    return Run(
        job=row["job"],
        program_sha256=row["program_sha256"] or "",
        started_at=row["started_at"] or 0.0,
        ended_at=row["ended_at"],
        outcome=row["outcome"] or "",
        last_line=row["last_line"] or 0,
        total_lines=row["total_lines"] or 0,
    )


def recent_runs(connection: Connection) -> list[str]:
    """Jobs that were started last, the newest first."""
    return list(connection.execute(select(cell_runs.c.job).order_by(cell_runs.c.started_at.desc()).limit(RECENT_RUNS)).scalars())


def runs_of(connection: Connection, jobs: Sequence[str]) -> dict[str, Run]:
    """The runs of those jobs that were ever started."""
    return {row["job"]: _run(row) for row in connection.execute(select(cell_runs).where(cell_runs.c.job.in_(list(jobs)))).mappings()}


def ended_runs(connection: Connection, until: float) -> list[str]:
    """Jobs whose run had ended by then (Unix time, s), in the order of their ends."""
    query = select(cell_runs.c.job).where(cell_runs.c.outcome != "", cell_runs.c.ended_at <= until).order_by(cell_runs.c.ended_at)
    return list(connection.execute(query).scalars())


def layers_of(connection: Connection, job: str) -> list[LayerFigures]:
    """Per layer, what was commanded and what was read back."""
    c = journal.c
    query = (
        select(
            c.layer,
            func.count().label("samples"),
            func.min(c.at).label("from_at"),
            func.max(c.at).label("to_at"),
            func.max(c.laser_setpoint_w).label("laser_setpoint_max_w"),
            func.max(c.laser_readback_w).label("laser_readback_max_w"),
            func.avg(c.laser_readback_w).label("laser_readback_mean_w"),
            func.max(c.powder_setpoint_g_min).label("powder_setpoint_max_g_min"),
            func.max(c.powder_readback_g_min).label("powder_readback_max_g_min"),
            func.avg(c.powder_readback_g_min).label("powder_readback_mean_g_min"),
        )
        .where(c.job == job)
        .group_by(c.layer)
        .order_by(c.layer)
    )
    rows = connection.execute(query).mappings()
    return [LayerFigures(**{name: value or 0 for name, value in row.items()}) for row in rows]


def samples_of(connection: Connection, job: str, every: int = 1) -> list[dict[str, Any]]:
    """Rows of the journal of a job in order, each `every`-th."""
    query = select(journal).where(journal.c.job == job, journal.c.id % every == 0).order_by(journal.c.id)
    return [dict(row) for row in connection.execute(query).mappings()]


def count_samples(connection: Connection, job: str) -> int:
    """How many rows the journal has of a job."""
    return int(connection.execute(select(func.count()).select_from(journal).where(journal.c.job == job)).scalar_one())
