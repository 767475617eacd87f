"""What a job waits for, in words and as data, as things stand now."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

from sqlalchemy import Connection

from cellctl.api.models_jobs import Wait
from cellctl.api.table import found_of
from cellctl.domain.jobs import ENDED, ON_CELL, JobState
from cellctl.store import dependencies
from cellctl.store.dependencies import Dependency, Until
from cellctl.store.jobs import JobRow

J = JobState


def in_words(dependency: Dependency) -> str:
    """A dependency that is not met."""
    state = dependency.state.value.replace("_", " ")
    other = f"{dependency.name} ({dependency.on_job})"
    if dependency.is_blocked:
        return f"{other} is {state} and will not be completed: run it again, or take the dependency away"
    if dependency.until is Until.CLEARED:
        return f"waits until the part of {other} is cleared from the table (it is {state})"
    return f"waits until {other} is completed (it is {state})"


def time_in_words(at: float) -> str:
    """An instant as people read it everywhere."""
    return datetime.fromtimestamp(at, UTC).strftime("%Y-%m-%d %H:%M UTC")


def hindrances(job: JobRow, found: Sequence[Dependency], now: float) -> list[Wait]:
    """What other jobs and the clock have against its start."""
    waits = [
        Wait(kind="job", text=in_words(one), job=one.on_job, until=one.until.value, blocked=one.is_blocked) for one in found if not one.is_met
    ]
    if job.not_before is not None and now < job.not_before:
        waits.append(Wait(kind="time", text=f"waits until {time_in_words(job.not_before)}", at=job.not_before))
    return waits


def waits_of(job: JobRow, found: Sequence[Dependency], now: float, silence: str = "") -> list[Wait]:
    """All that a job waits for, what is told first at the front.  silence : why it stays with a cell that is not heard"""
    if silence and job.state not in ENDED:
        return [Wait(kind="cell", text=silence), *waits_of(job, found, now)]
    if job.state in ENDED or job.state is J.RUNNING:
        return []
    if job.state in ON_CELL:
        return [Wait(kind="person", text=job.why or "waits until a person resumes or aborts it")]
    waits = hindrances(job, found, now)
    if job.state is J.SUBMITTED:
        planner = Wait(kind="planner", text=job.why or "waits for its turn with the planner")
        waits.insert(0, planner if job.cell else Wait(kind="cell", text=job.why or "waits for a cell that takes it"))
    elif job.state is J.WAITING_FOR_APPROVAL:
        waits.insert(0, Wait(kind="approval", text=job.why or "a person has to approve it"))
    elif job.state is J.QUEUED:
        kind, told = ("cell", job.why or "waits for the cell") if job.table_clear else ("table", job.why or found_of(job).missing)
        waits.append(Wait(kind="cell" if kind == "cell" else "table", text=told))
    return waits


def why_of(job: JobRow, waits: Sequence[Wait]) -> str:
    """The one line that says why a job is where it is."""
    return waits[0].text if waits and (not job.why or job.state is J.QUEUED) else job.why


def why_not_yet(connection: Connection, job: JobRow, now: float) -> str:
    """Why a queued job may not start whatever the cell and the table are like; empty if nothing is against it."""
    waits = hindrances(job, dependencies.of_jobs(connection, [job.id])[job.id], now)
    return waits[0].text if waits else ""
