"""Jobs: rows whose state moves along `domain.jobs.STEPS` only, each step written down with its reason."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import ColumnElement, Connection, RowMapping, func, insert, select, update

from cellctl.domain.fleet import ANY
from cellctl.domain.jobs import STEP_WORDS, JobState, step
from cellctl.store import cell_table, lanes
from cellctl.store.fleet import Seat, check_seat
from cellctl.store.job_tables import job_counts, job_steps
from cellctl.store.pages import page
from cellctl.store.parts import NotFoundError
from cellctl.store.schema import jobs

DOCUMENTS = ("error", "proof", "timestamps", "resume_point", "resumption", "tags", "changes")


@dataclass(frozen=True)
class JobRow:
    """One job.

    why : what it waits for, in words; error : {title, detail, hint} of a failed one; proof : figures of the Proof
    timestamps : Unix time at which each state was entered
    table_clear : a person vouches for the table: it is clear, or, of a job that continues another, its part stands untouched
    confirmed_by, confirmed_client : who vouched for it last, or started it by hand, and at which client: the start acts for that one
    material_sha256, cell_sha256 : versions of material and cell that it is made with; empty: of a job older than versions
    continues_job : whose part it goes on with; resume_point : from where, as asked for; resumption : figures of the generated program
    priority : 1 goes first, 9 last; rank : place among those of one priority; not_before : Unix time, s
    made_from, made_how : the job that it was made from by rerun, clone or retry; changes : [{field, from, to}] of a clone
    cleared_at : when a person found the table cleared of its part; seq : number of the row, given by the store
    cell : whose it is, empty: of none yet; cell_wanted : the one that was asked for, or `any` that it fits
    claimed_by, claimed_at : the service that is about to start it, and since when (Unix s): it does not leave its cell meanwhile
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
    priority: int = 5
    rank: int = 0
    not_before: float | None = None
    tags: list[str] = field(default_factory=list)
    made_from: str | None = None
    made_how: str = ""
    changes: list[dict[str, Any]] | None = None
    cleared_at: float | None = None
    seq: int = 0
    material_sha256: str = ""
    cell_sha256: str = ""
    cell_wanted: str = ""
    claimed_by: str = ""
    claimed_at: float | None = None


@dataclass(frozen=True)
class Step:
    """One step of a job's life. left : the state before, empty at its begin; why : in words; who : whose doing, empty if nobody's"""

    at: float
    left: str
    state: str
    why: str
    who: str


def row_of(values: RowMapping) -> JobRow:
    """A job from its row."""
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
    """Add a submitted job, behind all others of its priority."""
    wanted = job.cell_wanted or job.cell or ANY
    values = {**job.__dict__, "timestamps": {job.state.value: job.created_at}, "rank": lanes.last_rank(connection) + lanes.GAP}
    values |= {"cell_wanted": wanted}
    del values["seq"]
    connection.execute(insert(jobs).values(**_columns({**values, "state": job.state.value})))
    why = {"rerun": "made once more from", "clone": "made with changes from", "retry": "tried again after"}.get(job.made_how, "")
    _note_step(connection, job.id, job.created_at, "", job.state, f"{why} {job.made_from}" if why else "submitted", job.created_by)
    _count(connection, job.state, 1)
    lanes.joined_or_left(connection, job.state)
    return get(connection, job.id)


def get(connection: Connection, job_id: str) -> JobRow:
    """One job. Raises NotFoundError."""
    row = connection.execute(select(jobs).where(jobs.c.id == job_id)).mappings().first()
    if row is None:
        raise NotFoundError("job", job_id)
    return row_of(row)


def find_page(
    connection: Connection, cursor: str | None, limit: int, states: Sequence[JobState] = ()
) -> tuple[list[JobRow], str | None]:
    """Newest first, of some states or all. Raises CursorError."""
    query = select(jobs)
    if states:
        query = query.where(jobs.c.state.in_([state.value for state in states]))
    rows, following = page(connection, jobs, query, cursor, limit)
    return [row_of(row) for row in rows], following


def oldest_in(connection: Connection, states: Sequence[JobState], cell: str | None = None) -> list[JobRow]:
    """All jobs of these states, of one cell or all (None), oldest first."""
    query = select(jobs).where(jobs.c.state.in_([state.value for state in states]), *_of(cell)).order_by(jobs.c.seq)
    return [row_of(row) for row in connection.execute(query).mappings()]


def _of(cell: str | None) -> tuple[ColumnElement[bool], ...]:
    return () if cell is None else (jobs.c.cell == cell,)


def first_in(connection: Connection, state: JobState, limit: int, cell: str | None = None) -> list[JobRow]:
    """The first jobs of a state, of one cell or all (None), in the order in which they are worked on.

    Takes the same time however many there are.
    """
    query = select(jobs).where(jobs.c.state == state.value, *_of(cell)).order_by(jobs.c.priority, jobs.c.rank, jobs.c.seq).limit(limit)
    return [row_of(row) for row in connection.execute(query).mappings()]


def confirmed(connection: Connection, cell: str | None = None) -> list[JobRow]:
    """Queued jobs of one cell, or of all (None), for whose table a person vouches, in the order of the queue.

    Few, as each start takes the others'. The cell may have run one.
    """
    query = select(jobs).where(jobs.c.state == JobState.QUEUED.value, jobs.c.table_clear.is_(True), *_of(cell))
    found = [row_of(row) for row in connection.execute(query).mappings()]  # by their index; sorted here, so that it is that one that is used
    return sorted(found, key=lambda job: (job.priority, job.rank, job.seq))


def on_or_near_cell(connection: Connection, recent: Sequence[str], cell: str | None = None) -> list[JobRow]:
    """Jobs of one cell, or of all (None), that run, are held, or may just have been started, oldest first.

    Takes the same time however many are queued. recent : jobs that the cell started last (`history.recent_runs`)
    """
    queued = jobs.c.state == JobState.QUEUED.value
    conditions = (
        (jobs.c.state == JobState.RUNNING.value,), (jobs.c.state == JobState.HELD.value,),
        (jobs.c.id.in_(list(recent)), queued), (queued, jobs.c.table_clear.is_(True)), (queued, jobs.c.claimed_by != ""),
    )  # fmt: skip
    found = {row["id"]: row_of(row) for one in conditions for row in connection.execute(select(jobs).where(*one, *_of(cell))).mappings()}
    return sorted(found.values(), key=lambda job: job.seq)


def change(connection: Connection, job_id: str, **changes: Any) -> JobRow:
    """Change columns other than the state. Raises NotFoundError."""
    connection.execute(update(jobs).where(jobs.c.id == job_id).values(**_columns(changes)))
    return get(connection, job_id)


def move(
    connection: Connection, job_id: str, *targets: JobState, at: float, by: str = "", reason: str = "", seat: Seat | None = None, **changes: Any
) -> JobRow:
    """Move a job through one state or several, in one transaction of the caller; each step is written down.

    by : who did it, if a person; reason : of the last step, default `why` of the changes, or the table's words
    seat : of the service whose machinery moves it: the job has to be its own still; None: a person's doing, or the fleet's
    Raises NotFoundError; WrongJobStateError if the table has no such step, WrongCellError if the job, or the cell, is another service's by now
    (the caller's transaction then changes nothing).
    """
    job = get(connection, job_id)
    if seat is not None:
        check_seat(connection, job_id, job.cell, seat)
    state, times = job.state, dict(job.timestamps)
    for number, target in enumerate(targets, 1):
        left, state = state, step(state, target)
        times[state.value] = at
        told = (reason or str(changes.get("why") or "")) if number == len(targets) else ""
        _note_step(connection, job_id, at, left.value, state, told or STEP_WORDS[left, state], by)
        if left is JobState.QUEUED and state is JobState.RUNNING:
            cell_table.occupy(connection, job.cell, job_id, at)
    claim = {"claimed_by": "", "claimed_at": None} if job.claimed_by else {}  # for one start only
    values = _columns({**claim, **changes, "timestamps": times})
    connection.execute(update(jobs).where(jobs.c.id == job_id).values(state=state.value, **values))
    _count(connection, job.state, -1)
    _count(connection, state, 1)
    lanes.joined_or_left(connection, job.state, state)
    return get(connection, job_id)


def steps_of(connection: Connection, job_id: str) -> list[Step]:
    """The life of a job so far, in order."""
    columns = [job_steps.c[name] for name in Step.__dataclass_fields__]
    query = select(*columns).where(job_steps.c.job_id == job_id).order_by(job_steps.c.seq)
    return [Step(**row) for row in connection.execute(query).mappings()]


def note(connection: Connection, job_id: str, at: float, why: str) -> None:
    """Write down what became of a job that stays in its state: whose it is."""
    state = get(connection, job_id).state
    _note_step(connection, job_id, at, state.value, state, why, "")


def _note_step(connection: Connection, job_id: str, at: float, left: str, state: JobState, why: str, who: str) -> None:
    connection.execute(insert(job_steps).values(job_id=job_id, at=at, left=left, state=state.value, why=why, who=who))


def confirm_table(connection: Connection, job_id: str, at: float, who: str, client: str) -> JobRow:
    """A person looked: the table is clear for this job, or the part that it goes on with stands untouched.

    who, client : for whom the start will act. Raises NotFoundError.
    """
    job = get(connection, job_id)
    times = {**job.timestamps, "table_clear": at}
    if job.continues_job is None:
        cell_table.clear(connection, job.cell, at, who, f"found clear for {job.name}")
    return change(connection, job_id, table_clear=True, why="", timestamps=times, confirmed_by=who, confirmed_client=client)


def count_by_state(connection: Connection) -> dict[str, int]:
    """How many jobs are in each state that has any; kept beside the jobs, not counted."""
    rows = connection.execute(select(job_counts.c.state, job_counts.c.count).where(job_counts.c.count > 0))
    return {state: count for state, count in rows}


def _count(connection: Connection, state: JobState, by: int) -> None:
    changed = connection.execute(
        update(job_counts).where(job_counts.c.state == state.value).values(count=job_counts.c.count + by)
    )
    if changed.rowcount == 0:
        first = connection.execute(select(func.count()).select_from(jobs).where(jobs.c.state == state.value)).scalar_one()
        connection.execute(insert(job_counts).values(state=state.value, count=first))


def forget_clear_tables(connection: Connection, cell: str | None = None) -> None:
    """A job starts on a cell, or on any (None): whoever confirmed that its table is clear has to look again."""
    is_confirmed = (jobs.c.state == JobState.QUEUED.value, jobs.c.table_clear.is_(True), *_of(cell))
    connection.execute(update(jobs).where(*is_confirmed).values(table_clear=False))
