"""Passes and programs: what each part's passes come to, and what each control's text of them is worth, read back.

`make bench ARGS="programs [parts]"`: names of `tests.parts` and of the shipped parts; none: pipe and bearing.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from config.cell import Cell, load_cell
from planner.compose.engaging import engagement_of
from planner.compose.gouging import checked
from planner.compose.plate import on_plate
from planner.decompose.division import divide
from planner.errors import PlannerError
from planner.kinematics.chain import Chain
from planner.kinematics.limits import excess
from planner.kinematics.rotary_travel import followed_axes, pointwise_joints, rotary_travel_deg
from planner.mesh.mesh import Mesh
from planner.plan import Plan
from planner.post import assemble as assembling
from planner.post import post_with_report, tcp
from planner.post.dialect import DIALECTS, JOINT_DIALECTS, joint_dialect
from planner.post.posting import PostReport
from planner.process import Settings
from planner.program import LineKind, Program
from planner.recipe import Recipe
from planner.show.books import books, books_figures
from sim.dryrun import prove
from tests.bench.part_run import names, part_of, planned
from tests.bench.table import Table
from tests.unit.planner.impossible import CASES

CELL = "trunnion_tcp"
GRID_MM = 0.5  # coarse: the twin is here for the time that it takes
LOOK_MM = 0.05
USUAL = ("pipe", "bearing")


def run() -> list[Table]:
    """Passes, programs and refusals."""
    asked = [word for word in sys.argv[1:] if word in names()] or list(USUAL)
    cell = load_cell(CELL)
    passes, programs = [], []
    for name in asked:
        mesh, recipe = part_of(name)
        plan, _ = planned(mesh, recipe, name)
        try:
            made = {dialect: _posted(plan, cell, dialect) for dialect in DIALECTS}
        except PlannerError as error:
            passes.append([name, *[""] * 11, error.message])
            continue
        program, report, _ = made["grblhal"]
        simulated_s = prove(program, cell, mesh, cell_mm=GRID_MM).duration_s
        passes.append(_passes_row(name, mesh, recipe, plan, cell, program, report))
        programs += [_program_row(name, cell, dialect, *made[dialect], simulated_s) for dialect in DIALECTS]
    return [_passes(passes), _programs(programs), _refusals()]


def _posted(plan: Plan, cell: Cell, dialect: str) -> tuple[Program, PostReport, dict[str, float]]:
    """A program, the report, and CPU seconds: of the whole post, of writing the text."""
    spent = {"text": 0.0, "read": 0.0}
    with _timed(dialect, spent):
        started = time.process_time()
        program, report = post_with_report(plan, cell, dialect=dialect)
        spent["post"] = time.process_time() - started
    return program, report, spent


@contextmanager
def _timed(dialect: str, spent: dict[str, float]) -> Iterator[None]:
    """Adds up the CPU seconds of what writes the text of a dialect, and of what reads it."""
    joint = dialect in JOINT_DIALECTS
    language: Any = joint_dialect(dialect) if joint else tcp.WRITERS[dialect]
    readers: Any = tcp.READERS
    writing: tuple[Any, str] = (assembling, "_lines") if joint else (language, "texts")
    kept = getattr(*writing), language.read if joint else readers[dialect]

    def clocked(what: str, work: Any) -> Any:
        def run(*args: Any, **named: Any) -> Any:
            started = time.process_time()
            try:
                return work(*args, **named)
            finally:
                spent[what] += time.process_time() - started

        return run

    setattr(*writing, clocked("text", kept[0]))
    if joint:
        language.read = clocked("read", kept[1])
    else:
        readers[dialect] = clocked("read", kept[1])
    try:
        yield
    finally:
        setattr(*writing, kept[0])
        if joint:
            language.read = kept[1]
        else:
            readers[dialect] = kept[1]


def _passes_row(
    name: str, mesh: Mesh, recipe: Recipe, plan: Plan, cell: Cell, program: Program, report: PostReport
) -> list[str | int | float]:
    settings = Settings.from_recipe(recipe)
    division, _ = on_plate(divide(mesh, recipe, settings), recipe)
    part = mesh.transformed(plan.build_from_part)
    cuts = list(checked(division.pieces, plan.layers, part, look_mm=LOOK_MM, from_block=plan.process == "mill"))
    engaged = max((found.angle_deg for found in engagement_of(plan.layers, settings)), default=float("nan"))
    gouge = max((-found.worst_mm for found in cuts), default=float("nan"))
    metal: dict[str, Any] = books_figures(books(plan)) or {}
    chain = Chain.from_cell(cell)
    rows = program.table[program.table["kind"] != LineKind.SETUP]
    joints = np.asarray(rows["joints_end"])
    travel = rotary_travel_deg(chain, joints)
    followed = followed_axes(chain, joints, np.asarray(rows["kind"][1:] == LineKind.PROCESS))
    pointwise = pointwise_joints(chain, followed, joints[0])
    alone, beyond = rotary_travel_deg(chain, pointwise), float(excess(cell.axes, pointwise).max())
    least = report.least[0] if report.least else None
    return [
        name,
        len(plan.layers),
        sum(len(item.passes) for item in plan.operations),
        float(metal.get("ratio", float("nan"))),
        float(metal.get("void_beads", float("nan"))),
        100.0 * float(metal.get("double_share", float("nan"))),
        gouge,
        engaged,
        least.mm if least else "> 2",
        travel,
        alone,
        beyond,
        least.why if least else "nothing nearer than looked for",
    ]


def _program_row(
    name: str,
    cell: Cell,
    dialect: str,
    program: Program,
    report: PostReport,
    spent: dict[str, float],
    simulated_s: float,
) -> list[str | int | float]:
    process = program.table[program.table["kind"] == LineKind.PROCESS]
    length = float((process["arc_end_mm"] - process["arc_start_mm"]).sum())
    size = sum(len(program.lines[n - 1]) + 1 for n in process["n"])
    count = len(program.lines)
    simulated = simulated_s if dialect == "grblhal" else float("nan")
    return [
        name, dialect, count, size / length, report.reread.max_tip_mm, report.reread.max_axis_deg,
        report.speed.total_s, simulated, report.speed.total_s / simulated if simulated == simulated else float("nan"),
        count / spent["post"], count / spent["text"], count / spent["read"], sum(map(len, program.lines)) / 1e6,
    ]  # fmt: skip


def _passes(rows: list[list[str | int | float]]) -> Table:
    columns = [
        "part", "layers", "passes", "deposited / wanted at worst", "widest void, beads", "laid double %", "deepest gouge mm",
        "greatest engagement deg", "least clearance mm", "rotary travel deg", "point by point deg",
        "leaves its travel by deg", "what is nearest",
    ]  # fmt: skip
    note = (
        f"On {CELL}. Balance and voids: of level layers by their beads. Gouge: swept cutters against the part as built by then, looked to {LOOK_MM} "
        "mm; less than 0: air. Point by point: nearest branch every 5 deg along the passes "
        "and at the ends of links, no looking ahead, no limits: what it leaves an axis' travel by, ours has to unwind."
    )
    return Table("Passes", columns, rows, note)


def _programs(rows: list[list[str | int | float]]) -> Table:
    columns = [
        "part", "dialect", "blocks", "bytes/mm", "tip mm", "axis deg", "predicted s", "simulated s", "ratio", "post blocks/s", "text blocks/s",
        "read blocks/s", "MB",
    ]  # fmt: skip
    note = (
        "bytes/mm: of process lines. tip, axis: largest difference of the text read back from the plan as posted. simulated: the twin's firmware, "
        "which reads grblHAL. Rates by CPU time; post: everything, text: writing alone."
    )
    return Table("Programs", columns, rows, note)


def _refusals() -> Table:
    rows: list[list[str | int | float]] = []
    for case in CASES:
        try:
            case.run()
            rows.append([case.name, "was done", ""])
        except PlannerError as error:
            rows.append([case.name, error.message, error.hint])
    return Table("What cannot be done", ["asked", "reason", "what to do"], rows)
