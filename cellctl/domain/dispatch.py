"""Which cell takes a job that may be made on any, and which jobs a dead cell gives back: decisions, without the rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cellctl.domain.fitting import CellFacts, JobNeeds, why_not
from cellctl.domain.fleet import ANY
from cellctl.domain.jobs import ENDED, ON_CELL, JobState

J = JobState
GIVEN_BACK = frozenset({J.SUBMITTED, J.PLANNING, J.POSTING, J.PROVING, J.WAITING_FOR_APPROVAL, J.QUEUED})
"""States in which nothing of a job is on a table yet."""
TOLD_MAX = 4  # cells whose reasons are told of a job that fits none


@dataclass(frozen=True)
class Pending:
    """A job that is not ended. duration_s : 0 while it is not known; done : share that is executed, 0 … 1"""

    cell: str
    duration_s: float
    done: float = 0.0


@dataclass(frozen=True)
class Work:
    """What stands before a job on a cell. s : of all of them together"""

    jobs: int = 0
    s: float = 0.0


@dataclass(frozen=True)
class Candidate:
    """A cell that is heard. answers : whether its cell process does"""

    facts: CellFacts
    work: Work
    answers: bool = True


@dataclass(frozen=True)
class Choice:
    """cell : empty if none takes it; because : one line"""

    cell: str
    because: str


@dataclass(frozen=True)
class Holding:
    """What decides whether a job leaves its cell."""

    state: JobState
    cell_wanted: str
    is_claimed: bool
    continues: bool


def usual_s(pending: Sequence[Pending]) -> float:
    """What a job of unknown duration counts as, s: the mean of those that are known; 1 where none is, so that jobs are counted."""
    known = [job.duration_s for job in pending if job.duration_s > 0.0]
    return sum(known) / len(known) if known else 1.0


def work_before(pending: Sequence[Pending]) -> dict[str, Work]:
    """By cell, all that it still has to do."""
    usual = usual_s(pending)
    found: dict[str, Work] = {}
    for job in pending:
        before = found.get(job.cell, Work())
        left = (job.duration_s or usual) * (1.0 - min(max(job.done, 0.0), 1.0))
        found[job.cell] = Work(before.jobs + 1, before.s + left)
    return found


def choose(needs: JobNeeds, candidates: Sequence[Candidate]) -> Choice:
    """The fitting cell with the least work before it; one that answers before one that does not; then by name, so that all choose the same."""
    reasons = {one.facts.cell: why_not(needs, one.facts) for one in candidates}
    fitting = [one for one in candidates if not reasons[one.facts.cell]]
    if not fitting:
        return Choice("", none_fits(reasons))
    best = min(fitting, key=lambda one: (not one.answers, one.work.s, one.work.jobs, one.facts.cell))
    many = f"{best.work.jobs} job{'' if best.work.jobs == 1 else 's'}"
    least = ", the least of those that it fits" if len(fitting) > 1 else ""
    return Choice(best.facts.cell, f"given to {best.facts.cell}: {many} before it{least}")


def none_fits(reasons: Mapping[str, str]) -> str:
    """Why a job waits that fits no cell that is heard.  reasons : by cell"""
    if not reasons:
        return "waits for a cell: none is heard"
    told = [reason for _, reason in sorted(reasons.items())]
    more = f"; and {len(told) - TOLD_MAX} more" if len(told) > TOLD_MAX else ""
    return f"waits for a cell that it fits: {'; '.join(told[:TOLD_MAX])}{more}"


def is_given_back(job: Holding) -> bool:
    """Whether a job of a dead cell goes to another: it was for any, nothing was started, and no part of it lies on that table."""
    return job.cell_wanted == ANY and job.state in GIVEN_BACK and not job.is_claimed and not job.continues


def why_it_stays(job: Holding, cell: str, since: str) -> str:
    """Why a job stays with a cell that is not heard, in one line.  since : when it was heard last, in words; empty of an ended job"""
    silent = f"{cell} has not been heard since {since}"
    if job.state is J.INTERRUPTED or job.state in ON_CELL:
        return f"{silent}: its part lies on that table"
    if job.state in ENDED:
        return ""
    if job.is_claimed:
        return f"{silent}: it was about to be started there"
    if job.continues:
        return f"{silent}: the part that it goes on with lies on that table"
    return silent if is_given_back(job) else f"{silent}: it was meant for that cell"
