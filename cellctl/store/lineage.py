"""Jobs that go on with one part: what continues what, and what the cell ran in between.

rows : of the shared tables; cell_rows : of what the cell process wrote
"""

from __future__ import annotations

from dataclasses import dataclass

from sqlalchemy import Connection, select

from cellctl.domain.messages import Event
from cellctl.store import history, jobs
from cellctl.store.history import Run
from cellctl.store.jobs import JobRow
from cellctl.store.schema import cell_runs
from cellctl.store.schema import jobs as job_table


@dataclass(frozen=True)
class Between:
    """Another job that was on the cell since. outcome : "" while it runs"""

    job: str
    name: str
    outcome: str


def chain_of(rows: Connection, job: JobRow) -> list[JobRow]:
    """The jobs that worked on this job's part, the first one first, this one last. Raises NotFoundError."""
    chain = [job]
    while chain[0].continues_job is not None:
        chain.insert(0, jobs.get(rows, chain[0].continues_job))
    return chain


def continued_by(rows: Connection, job_id: str) -> list[JobRow]:
    """Jobs that go on with the part of this one, oldest first."""
    query = select(job_table.c.id).where(job_table.c.continues_job == job_id).order_by(job_table.c.seq)
    return [jobs.get(rows, name) for (name,) in rows.execute(query)]


def end_of(cell_rows: Connection, job_id: str) -> Event | None:
    """The event by which the cell process told how the run of a job ended, None if it did not."""
    ends = [event for event in history.events_of(cell_rows, job_id) if event.kind == "job" and event.data.get("outcome")]
    return ends[-1] if ends else None


def ran_since(cell_rows: Connection, run: Run, own: list[str]) -> list[Between]:
    """Jobs other than `own` that were started after a run, in order."""
    query = (
        select(cell_runs.c.job, cell_runs.c.name, cell_runs.c.outcome)
        .where(cell_runs.c.started_at > run.started_at, cell_runs.c.job.not_in(own))
        .order_by(cell_runs.c.started_at)
    )
    return [Between(row.job, row.name or row.job, row.outcome or "") for row in cell_rows.execute(query)]


def why_part_is_gone(rows: Connection, cell_rows: Connection, job: JobRow) -> str:
    """Why the part of an interrupted job (or of one that continues it) cannot stand on the table any more; empty if it may."""
    chain = chain_of(rows, job)
    known = history.runs_of(cell_rows, [one.id for one in chain])
    runs = [known[one.id] for one in chain if one.id in known]
    if not runs:
        return ""
    done = next((one for one in ran_since(cell_rows, runs[-1], [one.id for one in chain]) if one.outcome == "completed"), None)
    return f"{done.name} ({done.job}) was completed since: the plate was cleared for it" if done is not None else ""
