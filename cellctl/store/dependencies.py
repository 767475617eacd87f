"""What a job may not start before: other jobs, completed or cleared from the table. No job waits for itself, however many stand between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from sqlalchemy import Connection, delete, insert, select, update

from cellctl.domain.jobs import ENDED, JobState
from cellctl.store import jobs
from cellctl.store.job_tables import job_dependencies
from cellctl.store.schema import jobs as job_table


class Until(StrEnum):
    """What has to have become of the other job."""

    COMPLETED = "completed"
    CLEARED = "cleared"


class CycleError(Exception):
    """A job that would wait for itself."""

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__("a job would wait for itself: " + " waits for ".join(names))


@dataclass(frozen=True)
class Dependency:
    """job_id may not start before on_job is `until`. name, state, cleared : of that other job; is_met, is_blocked : as things stand

    is_blocked : the other ended otherwise, so that it never will be
    """

    job_id: str
    on_job: str
    until: Until
    name: str
    state: JobState
    is_cleared: bool
    has_run: bool

    @property
    def is_met(self) -> bool:
        """Whether it hinders no more."""
        if self.until is Until.COMPLETED:
            return self.state is JobState.COMPLETED
        return self.is_cleared or (self.state in ENDED and not self.has_run)

    @property
    def is_blocked(self) -> bool:
        """Whether it will never be met by itself."""
        return self.until is Until.COMPLETED and self.state in ENDED and self.state is not JobState.COMPLETED


def of_jobs(connection: Connection, job_ids: Sequence[str]) -> dict[str, list[Dependency]]:
    """The dependencies of several jobs, by job."""
    found: dict[str, list[Dependency]] = {job_id: [] for job_id in job_ids}
    if not job_ids:
        return found
    link, other = job_dependencies.c, job_table.c
    query = (
        select(link.job_id, link.on_job, link.until, other.name, other.state, other.cleared_at, other.timestamps)
        .join(job_table, other.id == link.on_job)
        .where(link.job_id.in_(list(job_ids)))
        .order_by(other.seq, link.until.desc())
    )
    for row in connection.execute(query):
        has_run = f'"{JobState.RUNNING.value}"' in row.timestamps
        found[row.job_id].append(
            Dependency(row.job_id, row.on_job, Until(row.until), row.name, JobState(row.state), row.cleared_at is not None, has_run)
        )
    return found


def dependents_of(connection: Connection, job_id: str) -> list[str]:
    """Jobs that wait, or waited, for this one."""
    return sorted(connection.execute(select(job_dependencies.c.job_id).distinct().where(job_dependencies.c.on_job == job_id)).scalars())


def replace(connection: Connection, job_id: str, wanted: Sequence[tuple[str, Until]]) -> None:
    """Give a job these dependencies instead of those that it has. Raises NotFoundError, CycleError."""
    connection.execute(delete(job_dependencies).where(job_dependencies.c.job_id == job_id))
    for on_job, until in dict.fromkeys(wanted):
        way = _way(connection, on_job, job_id)
        if way is not None:
            raise CycleError([jobs.get(connection, one).name for one in (job_id, *way)])
        connection.execute(insert(job_dependencies).values(job_id=job_id, on_job=jobs.get(connection, on_job).id, until=until.value))


def hand_over(connection: Connection, job_id: str, to: str) -> list[str]:
    """Whoever waits for a job waits for another from here on; those jobs."""
    waiting = dependents_of(connection, job_id)
    connection.execute(update(job_dependencies).where(job_dependencies.c.on_job == job_id).values(on_job=to))
    return waiting


def _way(connection: Connection, start: str, goal: str) -> list[str] | None:
    """Jobs on the way along dependencies from one to another, both included; None if there is none."""
    came_from: dict[str, str] = {start: ""}
    edge = [start]
    while edge and goal not in came_from:
        query = select(job_dependencies.c.job_id, job_dependencies.c.on_job).where(job_dependencies.c.job_id.in_(edge))
        edge = []
        for job_id, on_job in connection.execute(query):
            if on_job not in came_from:
                came_from[on_job] = job_id
                edge.append(on_job)
    if goal not in came_from:
        return None
    way = [goal]
    while came_from[way[0]]:
        way.insert(0, came_from[way[0]])
    return way
