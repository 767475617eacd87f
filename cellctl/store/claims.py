"""The claim on a job that is about to be started: while it stands the job leaves neither its cell nor the queue."""

from __future__ import annotations

from sqlalchemy import Connection, update

from cellctl.domain.jobs import JobState, WrongJobStateError
from cellctl.store import jobs
from cellctl.store.fleet import Seat, check_seat
from cellctl.store.schema import fleet
from cellctl.store.schema import jobs as job_table


class ClaimedError(Exception):
    """Another service of this cell claimed the job. `message` and `hint` are one line each."""

    def __init__(self, job: jobs.JobRow) -> None:
        self.message = f"{job.name} was about to be started by another service of {job.cell}: whether it was, nobody here knows"
        self.hint = "look at the machine and its table; then cancel this job and submit the part again, or go on with what stands"
        super().__init__(self.message)


def claim(connection: Connection, job_id: str, seat: Seat, now: float) -> None:
    """Say that this service starts the job next; once more is harmless. It is a heartbeat as well: who claims is there.

    Raises WrongJobStateError unless it is queued, WrongCellError if it or the cell is another's by now, ClaimedError, NotFoundError.
    """
    job = jobs.get(connection, job_id)
    check_seat(connection, job_id, job.cell, seat)
    if job.state is not JobState.QUEUED:
        raise WrongJobStateError(job.state, JobState.RUNNING)
    if job.claimed_by not in ("", _name(seat)):
        raise ClaimedError(job)
    connection.execute(update(job_table).where(job_table.c.id == job_id).values(claimed_by=_name(seat), claimed_at=now))
    if seat.owner:
        connection.execute(update(fleet).where(fleet.c.cell == seat.cell, fleet.c.owner == seat.owner).values(heard_at=now))


def withdraw(connection: Connection, job_id: str, seat: Seat) -> None:
    """It was not started. Of a job that this service did not claim nothing is changed."""
    own = (job_table.c.id == job_id, job_table.c.claimed_by == _name(seat))
    connection.execute(update(job_table).where(*own).values(claimed_by="", claimed_at=None))


def _name(seat: Seat) -> str:
    return seat.owner or seat.cell
