"""Jobs: rows whose state moves along `domain.jobs.STEPS` only."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import Connection, RowMapping, func, insert, select, update

from cellctl.domain.jobs import JobState, step
from cellctl.store.pages import page
from cellctl.store.parts import NotFoundError
from cellctl.store.schema import jobs

DOCUMENTS = ("error", "proof", "timestamps", "resume_point", "resumption")


@dataclass(frozen=True)
class JobRow:
    """One job.

    why : what it waits for, in words; error : {title, detail, hint} of a failed one; proof : figures of the Proof
    timestamps : Unix time at which each state was entered
    table_clear : a person vouches for the table: it is clear, or, of a job that continues another, its part stands untouched
    confirmed_by, confirmed_client : who vouched for it last, or started it by hand, and at which client: the start acts for that one
    continues_job : whose part it goes on with; resume_point : from where, as asked for; resumption : figures of the generated program
    """

    id: str
    name: str
    part_id: str
    cell: str
    recipe_toml: str
    material: str
    created_at: float
    created_by: str
    state: JobState = JobState.SUBMITTED
    why: str = ""
    error: dict[str, Any] | None = None
    plan_sha256: str | None = None
    program_sha256: str | None = None
    proof_sha256: str | None = None
    proof: dict[str, Any] | None = None
    layers: int = 0
    lines_total: int = 0
    lines_executed: int = 0
    duration_s: float = 0.0
    approved_by: str = ""
    approve_because: str = ""
    override_reason: str = ""
    table_clear: bool = False
    timestamps: dict[str, float] = field(default_factory=dict)
    continues_job: str | None = None
    resume_point: dict[str, Any] | None = None
    resumption: dict[str, Any] | None = None
    confirmed_by: str = ""
    confirmed_client: str = ""


def _row(values: RowMapping) -> JobRow:
    fields = {name: values[name] for name in JobRow.__dataclass_fields__}
    for name in DOCUMENTS:
        fields[name] = json.loads(fields[name]) if fields[name] is not None else None
    fields["state"] = JobState(fields["state"])
    return JobRow(**fields)


def _columns(changes: dict[str, Any]) -> dict[str, Any]:
    return {
        name: json.dumps(value) if name in DOCUMENTS and value is not None else value for name, value in changes.items()
    }


def add(connection: Connection, job: JobRow) -> JobRow:
    """Add a submitted job."""
    job = JobRow(**{**job.__dict__, "timestamps": {job.state.value: job.created_at}})
    connection.execute(insert(jobs).values(**_columns({**job.__dict__, "state": job.state.value})))
    return job


def get(connection: Connection, job_id: str) -> JobRow:
    """One job. Raises NotFoundError."""
    row = connection.execute(select(jobs).where(jobs.c.id == job_id)).mappings().first()
    if row is None:
        raise NotFoundError("job", job_id)
    return _row(row)


def find_page(
    connection: Connection, cursor: str | None, limit: int, states: Sequence[JobState] = ()
) -> tuple[list[JobRow], str | None]:
    """Newest first, of some states or all. Raises CursorError."""
    query = select(jobs)
    if states:
        query = query.where(jobs.c.state.in_([state.value for state in states]))
    rows, following = page(connection, jobs, query, cursor, limit)
    return [_row(row) for row in rows], following


def oldest_in(connection: Connection, states: Sequence[JobState]) -> list[JobRow]:
    """All jobs of these states, oldest first: the order in which they are worked on."""
    query = select(jobs).where(jobs.c.state.in_([state.value for state in states])).order_by(jobs.c.seq)
    return [_row(row) for row in connection.execute(query).mappings()]


def change(connection: Connection, job_id: str, **changes: Any) -> JobRow:
    """Change columns other than the state. Raises NotFoundError."""
    connection.execute(update(jobs).where(jobs.c.id == job_id).values(**_columns(changes)))
    return get(connection, job_id)


def move(connection: Connection, job_id: str, *targets: JobState, at: float, **changes: Any) -> JobRow:
    """Move a job through one state or several, in one transaction of the caller.

    Raises NotFoundError, and WrongJobStateError if the table has no such step (the caller's transaction then changes nothing).
    """
    job = get(connection, job_id)
    state, times = job.state, dict(job.timestamps)
    for target in targets:
        state = step(state, target)
        times[state.value] = at
    values = _columns({**changes, "timestamps": times})
    connection.execute(update(jobs).where(jobs.c.id == job_id).values(state=state.value, **values))
    return get(connection, job_id)


def confirm_table(connection: Connection, job_id: str, at: float, who: str, client: str) -> JobRow:
    """A person looked: the table is clear for this job, or the part that it goes on with stands untouched.

    who, client : for whom the start will act. Raises NotFoundError.
    """
    job = get(connection, job_id)
    times = {**job.timestamps, "table_clear": at}
    return change(connection, job_id, table_clear=True, why="", timestamps=times, confirmed_by=who, confirmed_client=client)


def count_by_state(connection: Connection) -> dict[str, int]:
    """How many jobs are in each state that has any."""
    rows = connection.execute(select(jobs.c.state, func.count()).group_by(jobs.c.state))
    return {state: count for state, count in rows}


def forget_clear_tables(connection: Connection) -> None:
    """A job starts: whoever confirmed that the table is clear has to look again."""
    connection.execute(update(jobs).where(jobs.c.state == JobState.QUEUED.value).values(table_clear=False))
