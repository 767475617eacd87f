"""Proof of the pipe: build time against proof time, memory, and what stands on the table."""

from __future__ import annotations

import os
import resource
import time
from pathlib import Path

import planner
from config import load_cell
from planner.mesh import load
from planner.program import Program
from planner.recipe import load_recipe
from sim import prove
from sim.proof import Proof
from tests.bench.table import Cell, Table

PARTS = Path(__file__).resolve().parents[2] / "config" / "parts"
GRIDS_MM = (0.4, 0.3, 0.2)


def row(proof: Proof, seconds: float, cpu_s: float) -> tuple[Cell, ...]:
    """One line of the table."""
    seen = proof.deviation
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return (
        seen.cell_mm, proof.lines, proof.duration_s / 60.0, seconds, cpu_s, proof.duration_s / cpu_s, peak_mb,
        seen.p50_mm, seen.p99_mm, 100.0 * seen.missing_mm3 / seen.part_mm3, "passed" if proof.passed else "; ".join(proof.reasons),
    )  # fmt: skip


def planned_and_posted() -> tuple[Program, Table]:
    """The pipe's Program, and what planning and posting took (the second time: kernels are compiled)."""
    cell, mesh, recipe = load_cell("trunnion_tcp"), load(PARTS / "pipe.stl", "mm"), load_recipe(PARTS / "pipe.toml")
    planner.post(planner.plan(mesh, recipe, part_name="pipe"), cell)
    at = [time.process_time()]
    plan = planner.plan(mesh, recipe, part_name="pipe")
    at.append(time.process_time())
    program = planner.post(plan, cell)
    at.append(time.process_time())
    figures = [(len(plan.layers), len(program.lines), at[1] - at[0], at[2] - at[1], program.duration_s / 60.0)]
    return program, Table("Pipe from mesh to program", ("layers", "lines", "plan s", "post s", "predicted min"), figures, "CPU time of one process")


def run() -> list[Table]:
    """Plan and post the pipe, then prove it on grids from coarse to fine."""
    cell, mesh = load_cell("trunnion_tcp"), load(PARTS / "pipe.stl", "mm")
    program, made = planned_and_posted()
    prove(program, cell, mesh, cell_mm=GRIDS_MM[0])  # numba compiles, once
    rows = []
    for grid in GRIDS_MM:
        start, start_cpu = time.perf_counter(), time.process_time()
        proof = prove(program, cell, mesh, cell_mm=grid)
        rows.append(row(proof, time.perf_counter() - start, time.process_time() - start_cpu))
    columns = (
        "grid mm", "lines", "build min", "proof s", "CPU s", "build / CPU", "peak MB", "p50 mm", "p99 mm", "missing %", "verdict",
    )  # fmt: skip
    note = f"config/parts/pipe.stl, hybrid, trunnion_tcp, compiled kernels; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    return [made, Table("Proof of the pipe", columns, rows, note)]
