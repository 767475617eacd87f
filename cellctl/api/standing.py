"""Where the part of an interrupted job stands: metal's end on its program, what a person may go on from, and what forbids it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field
from sqlalchemy import Connection

from cellctl.api.problems import ApiError
from cellctl.api.waits import time_in_words
from cellctl.cell.opened_program import arrays_of_form
from cellctl.cell.program_form import form_beside
from cellctl.domain.jobs import ENDED, JobState
from cellctl.domain.resumption import KNOWN_BY, MetalEnd, metal_end_of
from cellctl.planning.view import OVERVIEW
from cellctl.store import Store, history, lineage
from cellctl.store.jobs import JobRow

J = JobState
INTERRUPTED = (J.INTERRUPTED, J.ABORTED, J.FAILED)


class Standpoint(BaseModel):
    """A place on a program. line: index from 0; fraction: of it; arc_mm: along the pass; path_mm: of the tip since the program's
    begin; layer, operation, pass_: -1 where the line belongs to none; tip_mm: build frame; known_by: tick or sample"""

    line: int
    fraction: float
    layer: int
    operation: int
    process: str
    pass_: int = Field(serialization_alias="pass")
    arc_mm: float
    path_mm: float
    tip_mm: list[float]
    known_by: str
    known_by_text: str
    text: str


class Choice(BaseModel):
    """An operation of the plan, by its number over the whole plan, that a job may go on from the begin of."""

    layer: int
    operation: int
    process: str


class ResumptionPoint(BaseModel):
    """Where metal ended in a job that was interrupted. why_not: one line, empty if one can go on; notes: what to look at first;
    continued_by: jobs that go on with it"""

    job: str
    possible: bool
    why_not: str
    metal_end: Standpoint | None
    lines_executed: int
    lines_total: int
    layers: int
    choices: list[Choice]
    notes: list[str]
    continues_job: str | None
    continued_by: list[str]


@dataclass(frozen=True)
class Form:
    """Tables of a program, mapped; rows are read where they are asked for."""

    table: NDArray[np.void]
    arc_mm: NDArray[np.float64]
    is_emitting: NDArray[np.bool_]

    @classmethod
    def of_program(cls, program: Path) -> Form:
        """Raises ApiError if it is not there."""
        folder = form_beside(program)
        try:
            table, arc, lit = arrays_of_form(folder, ("table", "timeline_arc_mm", "timeline_is_emitting"))
        except (OSError, ValueError, LookupError):
            raise ApiError(409, "Not there", "the program of this job is not in the store any more", "submit the part again") from None
        return cls(table, arc, lit)


def operations_of(store: Store, job: JobRow) -> list[Choice]:
    """Operations with passes, of the job's plan, in the order in which they are made."""
    try:
        plan = json.loads((store.blobs.view(job.plan_sha256 or "") / OVERVIEW).read_bytes())
    except (OSError, ValueError):
        return []
    found, number = [], 0
    for layer in plan["layers"]:
        for operation in layer["operations"]:
            if operation["passes"]:
                found.append(Choice(layer=layer["index"], operation=number, process=operation["process"]))
            number += 1
    return found


def why_none(rows: Connection, cell_rows: Connection, job: JobRow) -> str:
    """Why nobody can go on with a job, in one line; empty if one can."""
    if job.state not in INTERRUPTED:
        return f"{job.name} is {job.state.value}: only a job that was interrupted, aborted or has failed on the cell is gone on with"
    if history.run_of(cell_rows, job.id) is None:
        return f"{job.name} never ran: there is no part of it on the table"
    for later in lineage.continued_by(rows, job.id):
        if later.state not in ENDED:
            return f"{later.name} ({later.id}) goes on with it already: it is {later.state.value}"
        if history.run_of(cell_rows, later.id) is not None:
            return f"{later.name} ({later.id}) went on with it: {_then(later)}"
    return lineage.why_part_is_gone(rows, cell_rows, job)


def _then(later: JobRow) -> str:
    return "the part is done" if later.state is J.COMPLETED else "go on with that job"


def notes_of(rows: Connection, cell_rows: Connection, job: JobRow) -> list[str]:
    """What was on the cell since, for a person to look at."""
    run = history.run_of(cell_rows, job.id)
    if run is None:
        return []
    own = [one.id for one in lineage.chain_of(rows, job)]
    seen = f"the table was told clear at {time_in_words(job.cleared_at)}: see that the part of this job still stands on it" if job.cleared_at else ""
    return [seen] * bool(seen) + [
        f"{one.name} ({one.job}) was on the cell since ({one.outcome or 'running'}): see that the part of this job still stands in its place"
        for one in lineage.ran_since(cell_rows, run, own)
    ]


def metal_end(store: Store, cell_rows: Connection, job: JobRow) -> MetalEnd | None:
    """Where metal ended in a job that ran; None if all of it was run. Raises ApiError."""
    run, end = history.run_of(cell_rows, job.id), lineage.end_of(cell_rows, job.id)
    data: dict[str, Any] = dict(end.data) if end is not None else {}
    if run is not None:
        data.setdefault("last_line", run.last_line)
    form = Form.of_program(store.blobs.program(job.program_sha256 or ""))
    return metal_end_of(data, form.arc_mm, form.is_emitting)


def standpoint(store: Store, job: JobRow, end: MetalEnd) -> Standpoint:
    """The place with what it belongs to. Raises ApiError."""
    form = Form.of_program(store.blobs.program(job.program_sha256 or ""))
    row = form.table[end.line]
    processes = {choice.operation: choice.process for choice in operations_of(store, job)}
    layer, operation, pass_ = int(row["layer"]), int(row["operation"]), int(row["pass_"])
    process = processes.get(operation, "")
    arc = float(row["arc_start_mm"] + end.fraction * (row["arc_end_mm"] - row["arc_start_mm"]))
    before = form.table["tip_end"][max(end.line - 1, 0)]
    tip = before + end.fraction * (row["tip_end"] - before)
    path = float(form.arc_mm[end.line] + end.fraction * (form.arc_mm[end.line + 1] - form.arc_mm[end.line]))
    return Standpoint(
        line=end.line, fraction=end.fraction, layer=layer, operation=operation, process=process, pass_=pass_, arc_mm=round(arc, 3),
        path_mm=round(path, 3), tip_mm=[round(float(value), 3) for value in tip], known_by=end.known_by,
        known_by_text=KNOWN_BY[end.known_by], text=_in_words(job, end, (layer, operation, pass_), process, arc),
    )  # fmt: skip


def _in_words(job: JobRow, end: MetalEnd, place: tuple[int, int, int], process: str, arc_mm: float) -> str:
    layer, operation, pass_ = place
    where = f"layer {layer + 1} of {job.layers}" if layer >= 0 else "before the first layer"
    if process:
        where += f", {process.replace('_', ' ')}"
    if pass_ >= 0:
        where += f", {arc_mm:.2f} mm along its pass"
    named = f"layer {layer} op {operation} pass {pass_}, " if pass_ >= 0 else ""
    return f"{where} (in the program: {named}{100 * end.fraction:.0f} % of line N{end.line + 1})"


def resumption_point(store: Store, rows: Connection, cell_rows: Connection, job: JobRow) -> ResumptionPoint:
    """All that is known of going on with a job. Raises ApiError."""
    why = why_none(rows, cell_rows, job)
    run = history.run_of(cell_rows, job.id)
    ran = run is not None and job.state in INTERRUPTED
    end = metal_end(store, cell_rows, job) if ran else None
    if ran and end is None and not why:
        why = f"every line of {job.name} was executed: nothing is left"
    return ResumptionPoint(
        job=job.id,
        possible=not why,
        why_not=why,
        metal_end=standpoint(store, job, end) if end is not None else None,
        lines_executed=run.last_line if run is not None else 0,
        lines_total=job.lines_total,
        layers=job.layers,
        choices=operations_of(store, job),
        notes=notes_of(rows, cell_rows, job) if ran else [],
        continues_job=job.continues_job,
        continued_by=[one.id for one in lineage.continued_by(rows, job.id)],
    )
