"""Parts interrupted at chosen and at random instants and resumed in the twin: the joint beside the part made in one go, and the time it costs."""

from __future__ import annotations

import os
import resource
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import planner
from config import load_cell
from planner.errors import ResumeError
from planner.mesh import load
from planner.mesh.mesh import Mesh
from planner.plan import Plan
from planner.post.reread import read
from planner.program import LineKind, Program
from planner.recipe import Recipe, load_recipe
from planner.resume import ResumePoint
from planner.resume.stretch import lit_lines
from tests.bench.long_bead import long_bead
from tests.bench.table import Cell, Table
from tests.unit.planner.joints import joint_at, made_of
from tests.unit.planner.small_parts import box, frustum, tube
from tests.unit.planner.test_resume import leaning_ring

PARTS = Path(__file__).resolve().parents[2] / "config" / "parts"
CELL = load_cell("trunnion_tcp")
RANDOM = 4  # instants of each part, by chance in time
SEED = 7
LINES = int(os.environ.get("BENCH_RESUME_LINES", "5000000"))
CPU_US_A_LINE, MEMORY_MB = 4.0, 4096.0
COLUMNS = (
    "part", "instant", "line", "share", "overlap mm", "joint high mm", "joint low mm", "elsewhere mm", "more metal mm3", "p99 whole mm",
    "p99 resumed mm", "findings", "extra s",
)  # fmt: skip


@dataclass(frozen=True)
class Job:
    """A part with its Plan, its Program and the grid of its stock."""

    name: str
    mesh: Mesh
    plan: Plan
    program: Program
    cell_mm: float


def jobs() -> Iterator[Job]:
    """Small parts that hold every kind of pass, and the shipped pipe on a coarse grid."""
    pipe = load(PARTS / "pipe.stl", "mm")
    ring = leaning_ring()
    yield Job("leaning ring", box(28.0, 28.0, 0.8), ring, planner.post(ring, CELL), 0.3)
    for name, mesh, recipe, cell_mm in (
        ("wall", box(20.0, 2.4, 1.6), Recipe(process="deposit"), 0.2),
        ("cup", tube(3.0, 5.4, 1.6), Recipe(process="deposit"), 0.2),
        ("block", box(12.0, 7.0, 1.6), Recipe(process="deposit"), 0.2),
        ("milled block", box(10.0, 6.0, 1.6), Recipe(process="hybrid"), 0.2),
        ("milled cone", frustum(4.0, 5.6, 1.6), Recipe(process="hybrid"), 0.25),
        ("pipe", pipe, load_recipe(PARTS / "pipe.toml"), 0.5),
    ):
        plan = planner.plan(mesh, recipe, part_name=name)
        yield Job(name, mesh, plan, planner.post(plan, CELL), cell_mm)


def instants(job: Job) -> Iterator[tuple[str, int, float]]:
    """A name, a line and a share of it: one of every kind that the Program has, then some by chance."""
    program, reading = job.program, read(job.program)
    table, lit = program.table, lit_lines(program, reading)
    length = table["arc_end_mm"] - table["arc_start_mm"]
    processes = np.array(["", *(item.process.value for item in job.plan.operations)])[table["operation"] + 1]
    cuts = (table["kind"] == LineKind.PROCESS) & reading.is_motion & (reading.tool != 1)
    turns = np.append(False, np.abs(np.diff(table["joints_end"][:, 3:], axis=0)).max(axis=1) > 1e-6)
    bent = table["bulge"] != 0.0
    wanted = {
        "long bead": lit & (length >= length[lit].max(initial=0.0)), "bead, corner": lit & np.roll(lit, 1) & (length > 1.0),
        "bead, arc": lit & bent, "fill": lit & (processes == "deposit_fill"), "leaning bead": lit & turns,
        "link": (table["kind"] == LineKind.LINK) & (table["pass_"] >= 0), "wait": table["kind"] == LineKind.DWELL,
        "cut": cuts & ~bent & ~turns, "cut, arc": cuts & bent, "leaning cut": cuts & turns,
    }  # fmt: skip
    for name, fits in wanted.items():
        lines = np.flatnonzero(fits)
        if lines.size:
            yield name, int(lines[len(lines) // 2]), 0.0 if "corner" in name else 0.45
    rng = np.random.default_rng(SEED)
    for _ in range(RANDOM):
        line = int(np.searchsorted(table["time_end_s"], rng.uniform(0.0, program.duration_s)))
        yield "by chance", line, float(rng.random())


def rows(job: Job) -> Iterator[tuple[Cell, ...]]:
    """A row of the table for every instant at which something is left to do."""
    whole = made_of(job.program, CELL, job.mesh, job.cell_mm)
    for name, line, share in instants(job):
        try:
            joint = joint_at(job.program, CELL, job.mesh, whole, line, share, job.plan)
        except ResumeError:
            continue
        found = sorted({item.kind for item in joint.made.proof.findings})
        far = max(joint.far_high_mm, -joint.far_low_mm)
        yield (
            job.name, name, line + 1, round(share, 2), joint.overlap_mm, round(joint.high_mm, 3), round(joint.low_mm, 3), round(far, 3),
            round(joint.volume_mm3, 2), whole.proof.deviation.p99_mm, joint.made.proof.deviation.p99_mm, ", ".join(found) or "none",
            round(joint.extra_s, 1),
        )  # fmt: skip


def rest_of_a_long_program() -> Table:
    """What it takes to make the rest of a Program that was interrupted in its middle."""
    program = long_bead(CELL, LINES)
    before_mb, began, cpu = resident_mb(), time.monotonic(), time.process_time()
    rest = planner.resume(program, CELL, ResumePoint.at(len(program.lines) // 2, 0.5), program_sha256="0" * 64)
    took_s, cpu_s = time.monotonic() - began, time.process_time() - cpu
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 - before_mb
    count = len(program.lines)
    made: list[Cell] = [count, len(rest.lines), round(took_s, 1), round(cpu_s, 1), round(1e6 * cpu_s / count, 2), round(peak_mb)]
    columns = ("lines", "lines of the rest", "s", "CPU s", "CPU us a line", "memory more MB")
    return Table("Resume: the rest of a long program", columns, [made], f"bounds: {CPU_US_A_LINE:g} us a line, {MEMORY_MB:g} MB")


def resident_mb() -> float:
    """Memory of this process, MB."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


def run() -> list[Table]:
    """Table of all joints, and what a long program costs."""
    long = rest_of_a_long_program()
    found = [row for job in jobs() for row in rows(job)]
    note = (
        "Stopped at a share of a line, cooled, resumed with the usual overlap and lead-in, in the twin. High and low: greatest distance of the "
        "surfaces within the overlap and 2.5 mm of the place (resumed beyond whole > 0); elsewhere: the greatest either way. Parts that are "
        "milled are compared when finished. Extra time: time until the stop and of the resumed program, less that of the whole."
    )
    return [long, Table("Resume: the joint in the twin", COLUMNS, found, note)]
