"""The rest of an interrupted job, in a worker: its program generated, and the stock as it stands, for the proof of it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cellctl.planning.task import PROGRAM_FOLDER, Task

if TYPE_CHECKING:
    from config.cell import Cell
    from planner.mesh import Mesh
    from planner.program import Program
    from sim.standing import Standing

Report = Callable[[str, float], None]


def resume(task: Task, report: Report) -> dict[str, Any]:
    """Generate what is left of a program from the task's point on; writes its folder and form as `post` does. Raises PlannerError, ConfigError."""
    from cellctl.cell.program_form import form_beside, write_form
    from cellctl.planning.track import track_beside, write_track
    from config import load_cell
    from planner.files import read_plan, read_program, write_program
    from planner.resume import ResumePoint
    from planner.resume import resume as make_rest

    report("generating the rest of the program", 0.0)
    cell, point = load_cell(task.cell), task.point
    program = read_program(Path(task.program))
    place = ResumePoint.at(int(point["line"]), float(point["fraction"]))
    if point["from"] == "layer":
        place = ResumePoint.of_layer(int(point["layer"]))
    elif point["from"] == "operation":
        place = ResumePoint.of_operation(int(point["operation"]))
    overlap = point.get("overlap_mm")
    plan = replace(read_plan(Path(task.plan)), stock_file=task.stock) if task.plan else None
    made = make_rest(program, cell, place, overlap_mm=overlap, plan=plan, program_sha256=Path(task.program).name)
    folder = Path(task.folder) / PROGRAM_FOLDER
    write_program(made, folder)
    write_track(made, track_beside(folder))
    write_form(made, cell, form_beside(folder), hashlib.sha256((folder / "program.json").read_bytes()).hexdigest())
    return {"lines": len(made.lines), "duration_s": float(made.duration_s), "resumption": figures(made, program, cell)}


def figures(made: Program, program: Program, cell: Cell) -> dict[str, Any]:
    """What a person wants to know of a generated program: joint, way back, extra time, what remains. Lengths mm, times s."""
    note = made.continues
    assert note is not None
    head_s = float(made.table["time_end_s"][note.head_lines - 1]) if note.head_lines else 0.0
    rest_s = float(program.duration_s - program.table["time_start_s"][note.resumed_line])
    left = made.table["layer"][note.head_lines :]
    operations = made.table["operation"][note.head_lines :]
    return {
        "layer": note.layer,
        "operation": note.operation,
        "pass": note.pass_,
        "arc_mm": round(note.arc_mm + note.lead_in_mm + note.overlap_mm, 3),
        "overlap_mm": round(note.overlap_mm, 3),
        "lead_in_mm": round(note.lead_in_mm, 3),
        "clearance_mm": cell.rapid_clearance_mm,
        "head_lines": note.head_lines,
        "resumed_line": note.resumed_line + 1,
        "head_s": round(head_s, 1),
        "extra_s": round(max(made.duration_s - rest_s, 0.0), 1),
        "remaining_s": round(made.duration_s, 1),
        "remaining_lines": len(made.lines) - note.head_lines,
        "remaining_layers": len(set(left[left >= 0].tolist())),
        "remaining_operations": len(set(operations[operations >= 0].tolist())),
    }


def standing_of(task: Task, cell: Cell, mesh: Mesh, stock: Mesh | None, report: Report) -> Standing | None:
    """The stock on which the task's program begins: what the jobs before it left, one after another. None for the first program of a part.

    Raises ResumeError for a place that the twin does not reach; PlannerError.
    """
    from planner.errors import ResumeError
    from planner.files import read_program
    from sim.standing import stock_after

    standing: Standing | None = None
    for number, link in enumerate(task.links, 1):
        say = partial(_say, report, f"the part as it stands, {number} of {len(task.links)}")
        kept = Path(task.checkpoints) if task.checkpoints else None
        program = read_program(Path(link.program))
        try:
            standing = stock_after(
                program, cell, mesh, link.line, link.fraction, stock=stock, start=standing, progress=say, checkpoints=kept
            )
        except ValueError as error:
            raise ResumeError(f"the twin does not come to where metal ended: {error}", "submit the part again") from None
    return standing


def _say(report: Report, what: str, fraction: float, word: str) -> None:
    report(f"{what}: {word}", fraction)
