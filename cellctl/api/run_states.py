"""Where a job that was started stands, from the run that the cell process wrote down and from what it does now."""

from __future__ import annotations

from cellctl.domain.jobs import ENDED, JobState
from cellctl.domain.snapshot import Snapshot
from cellctl.store.history import Run
from cellctl.store.jobs import JobRow

J = JobState
OUTCOMES = {"completed": J.COMPLETED, "aborted": J.ABORTED, "failed": J.FAILED, "interrupted": J.INTERRUPTED}
MOVING = frozenset({"PREPARING", "RUNNING", "RESUMING"})


def is_job_of(snapshot: Snapshot, job_id: str) -> bool:
    """Whether the cell shows this job."""
    return snapshot.job is not None and snapshot.job.id == job_id


def target_of(job: JobRow, run: Run, snapshot: Snapshot | None) -> tuple[JobState, str]:
    """Where a job that was started stands, and why: the end that was written down, or what the cell does with it now."""
    if run.outcome:
        outcome = OUTCOMES.get(run.outcome, J.INTERRUPTED)
        why = "" if outcome is J.COMPLETED else f"ended at line {run.last_line} of {run.total_lines}"
        return outcome, why
    if snapshot is None or not is_job_of(snapshot, job.id):
        return (J.RUNNING if job.state is J.QUEUED else job.state), job.why if job.state is not J.QUEUED else ""
    if snapshot.state in MOVING:
        return J.RUNNING, snapshot.waiting
    causes = "; ".join(alarm.cause for alarm in snapshot.alarms)
    return J.HELD, causes or snapshot.because


def path_to(state: JobState, target: JobState) -> list[JobState]:
    """The steps from one state to another by way of RUNNING, where a step was not seen."""
    if state is target or state in ENDED:
        return []
    if target is J.RUNNING or (state is J.RUNNING) or (state is J.HELD and target is not J.COMPLETED):
        return [target]
    return [J.RUNNING, target]
