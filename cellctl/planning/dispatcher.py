"""Gives jobs for any cell to cells, and takes back what a dead one has not started. Every web process does it; one write transaction each."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

from sqlalchemy import Connection, select

from cellctl.domain.dispatch import (
    GIVEN_BACK,
    Candidate,
    Choice,
    Holding,
    Pending,
    Work,
    choose,
    is_given_back,
    usual_s,
    work_before,
)
from cellctl.domain.fitting import JobNeeds, facts_from
from cellctl.domain.fleet import ANY
from cellctl.domain.jobs import ENDED, JobState
from cellctl.planning.needs import needs_of
from cellctl.store import jobs, parts, versions
from cellctl.store.fleet import Member
from cellctl.store.jobs import JobRow
from cellctl.store.parts import NotFoundError
from cellctl.store.schema import jobs as job_table
from config import Material
from planner.errors import RecipeError
from planner.recipe import Recipe, parse_recipe

J = JobState
OF_THAT_CELL: dict[str, Any] = {
    "approved_by": "", "approve_because": "", "override_reason": "", "table_clear": False, "cell_sha256": "",
    "program_sha256": None, "proof_sha256": None, "proof": None,
}  # fmt: skip
"""What was made and said for the cell that a job leaves: the next one's program is another, and a person looks at its proof."""
AT_ONCE = 50  # jobs given out by one transaction, some tenths of a second: the write lock is everybody's
UNFINISHED = tuple(state.value for state in JobState if state not in ENDED)


@lru_cache(maxsize=64)
def _material(_sha256: str, toml: str) -> Material:
    return Material.model_validate(tomllib.loads(toml))


def needs_of_job(connection: Connection, job: JobRow) -> JobNeeds:
    """What a job asks of a cell. Raises NotFoundError, RecipeError."""
    return needs_of_part(connection, job.part_id, parse_recipe(job.recipe_toml), job.material_sha256)


def needs_of_part(connection: Connection, part_id: str, recipe: Recipe, material_sha256: str = "") -> JobNeeds:
    """What a part asks of a cell with this recipe.  material_sha256 : of its version, empty: the newest. Raises NotFoundError."""
    part = parts.get(connection, part_id)
    row = versions.material(connection, recipe.material, sha256=material_sha256)
    return needs_of(part.inspection.bbox_mm, recipe, _material(row.sha256, row.toml))


def holding_of(job: JobRow) -> Holding:
    """What decides whether a job leaves its cell."""
    return Holding(job.state, job.cell_wanted, bool(job.claimed_by), job.continues_job is not None)


def is_needed(connection: Connection, members: Sequence[Member]) -> bool:
    """Whether `dispatch` would find anything; a read, so that the write lock is taken for work only."""
    waiting = select(job_table.c.seq).where(job_table.c.state == J.SUBMITTED.value, job_table.c.cell == "").limit(1)
    return connection.execute(waiting).first() is not None or bool(_to_free(connection, members, 1))


def _to_free(connection: Connection, members: Sequence[Member], limit: int | None = None) -> list[JobRow]:
    """Jobs for any cell that a cell has which is dead, or is no more."""
    heard = ["", *(member.cell for member in members if not member.is_dead)]
    column = job_table.c
    query = select(column.id).where(
        column.state.in_([state.value for state in GIVEN_BACK]), column.cell_wanted == ANY, column.cell.not_in(heard), column.claimed_by == "",
        column.continues_job.is_(None),
    )  # fmt: skip
    found = connection.execute(query.order_by(column.seq).limit(limit)).scalars()
    return [job for one in found if is_given_back(holding_of(job := jobs.get(connection, one)))]


def free(connection: Connection, members: Sequence[Member], now: float) -> list[str]:
    """Take back from dead cells what they have not started; the ids. What was made for that cell is not the next one's."""
    freed = []
    for job in _to_free(connection, members):
        reason = f"{job.cell} is not heard: it waits for another cell"
        if job.state is J.SUBMITTED:
            jobs.note(connection, job.id, now, reason)
            jobs.change(connection, job.id, cell="", why="")
        else:
            jobs.move(connection, job.id, J.SUBMITTED, at=now, reason=reason, cell="", why="", **OF_THAT_CELL)
        freed.append(job.id)
    return freed


def _pending(connection: Connection) -> list[Pending]:
    column = job_table.c
    query = select(column.cell, column.duration_s, column.lines_executed, column.lines_total)
    rows = connection.execute(query.where(column.state.in_(UNFINISHED), column.cell != ""))
    return [Pending(row.cell, row.duration_s, row.lines_executed / row.lines_total if row.lines_total else 0.0) for row in rows]


def candidates_of(members: Sequence[Member], pending: Sequence[Pending]) -> list[Candidate]:
    """The cells that are heard, with what each has to do; those that tell of themselves in another version's words are left out."""
    work = work_before(pending)
    heard = [(member, facts_from(member.facts)) for member in members if member.is_living and member.owner]
    return [Candidate(facts, work.get(member.cell, Work()), bool(member.state)) for member, facts in heard if facts is not None]


def dispatch(connection: Connection, members: Sequence[Member], now: float) -> list[str]:
    """Give what waits for a cell to the fitting one with the least work before it; ids of the jobs that changed."""
    waiting = jobs.first_in(connection, J.SUBMITTED, AT_ONCE, cell="")
    pending = _pending(connection) if waiting else []
    candidates, usual = candidates_of(members, pending), usual_s(pending)
    changed = []
    for job in waiting:
        choice = _choice(connection, job, candidates)
        if choice.cell:
            jobs.note(connection, job.id, now, choice.because)
            jobs.change(connection, job.id, cell=choice.cell, why="")
            candidates = [_with_one_more(one, job.duration_s or usual) if one.facts.cell == choice.cell else one for one in candidates]
        elif choice.because != job.why:
            jobs.change(connection, job.id, why=choice.because)
        else:
            continue
        changed.append(job.id)
    return changed


def _choice(connection: Connection, job: JobRow, candidates: Sequence[Candidate]) -> Choice:
    try:
        return choose(needs_of_job(connection, job), candidates)
    except (NotFoundError, RecipeError) as error:
        return Choice("", f"cannot be given to a cell: {error}")


def _with_one_more(one: Candidate, s: float) -> Candidate:
    return replace(one, work=Work(one.work.jobs + 1, one.work.s + s))
