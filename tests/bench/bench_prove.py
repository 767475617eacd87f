"""Proof of every example part: build time against proof time, peak memory, cells per second, and growth with the part's size."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import planner
from config import load_cell
from planner.mesh import load
from planner.mesh.mesh import Mesh
from planner.recipe import Recipe, load_recipe
from tests.bench.table import Cell, Table

ROOT = Path(__file__).resolve().parents[2]
PARTS = ROOT / "config" / "parts"
CELL = "trunnion_tcp"
GRIDS_MM = (0.25, 0.1)
GROWN = "pipe"
SIZES = (0.5, 1.0, 2.0)  # of the grown part's own size: one to four
UNNAMED = {"build_direction": "auto", "tolerance_mm": 0.15, "cusp_mm": 0.08, "layer_height_mm": 0.8, "small_cutter_diameter_mm": 4.0}
"""Recipe of parts that have none of their own."""
COLUMNS = (
    "part", "size", "grid mm", "lines", "path m", "build min", "proof s", "CPU s", "build / proof", "peak MB", "cells changed / s",
    "p99 mm", "missing %", "verdict",
)  # fmt: skip


def scaled(part: str, size: float) -> Mesh:
    """A shipped part, larger or smaller."""
    return load(PARTS / f"{part}.stl", "mm").transformed(np.diag([size, size, size, 1.0]))


def recipe_of(part: str) -> Recipe:
    """The recipe beside the part, or the one for parts without."""
    own = PARTS / f"{part}.toml"
    return load_recipe(own) if own.exists() else Recipe(**UNNAMED)


def written(part: str, size: float, folder: Path) -> Path:
    """Plan and post a part; where mesh, Program and length of the path were put."""
    mesh = scaled(part, size)
    plan = planner.plan(mesh, recipe_of(part), part_name=part)
    metres = sum(step.tip.length for operation in plan.operations for step in operation.passes if not step.is_link) / 1000.0
    path = folder / f"{part}_{size:g}.pickle"
    path.write_bytes(pickle.dumps((mesh, planner.post(plan, load_cell(CELL)), metres)))
    return path


def measured(job: Path, grid_mm: float) -> dict[str, float | str]:
    """Prove in a process of its own, so that time and peak memory are the proof's."""
    words = [sys.executable, "-m", "tests.bench.bench_prove", str(job), str(grid_mm)]
    return dict(json.loads(subprocess.run(words, cwd=ROOT, check=True, capture_output=True, text=True).stdout.splitlines()[-1]))


def row(part: str, size: float, grid_mm: float, job: Path) -> tuple[Cell, ...]:
    """One line of a table."""
    seen = measured(job, grid_mm)
    figures = [seen[key] for key in ("lines", "metres", "build_min", "proof_s", "cpu_s", "ratio", "peak_mb", "cells_s", "p99", "missing")]
    return (part, f"x {size:g}", grid_mm, *figures, str(seen["verdict"]))


def run() -> list[Table]:
    """Every part on a usual and a fine grid, and one part in three sizes."""
    names = sorted(path.stem for path in PARTS.glob("*.stl"))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        jobs = {(name, 1.0): written(name, 1.0, folder) for name in names}
        jobs |= {(GROWN, size): written(GROWN, size, folder) for size in SIZES}
        parts = [row(name, 1.0, grid, jobs[name, 1.0]) for name in names for grid in GRIDS_MM]
        growth = [row(GROWN, size, GRIDS_MM[0], jobs[GROWN, size]) for size in SIZES]
    note = (
        f"hybrid, {CELL}; each proof in a process of its own, kernels compiled; path: cut and deposited, without links; "
        f"cells changed: filled or emptied; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    )
    return [Table("Proof of parts", COLUMNS, parts, note), Table("Growth of proofs", COLUMNS, growth, note)]


def peak_mb() -> float:
    """Peak resident memory of this process, MB; what a parent held before does not count."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(float(line.split()[1]) / 1024.0 for line in lines if line.startswith("VmHWM"))


def main(job: Path, grid_mm: float) -> None:
    """Prove one written job and print the figures as a line of JSON. Kernels are loaded before the clock starts."""
    from sim import prove

    mesh, program, metres = pickle.loads(job.read_bytes())
    cell = load_cell(CELL)
    chip = Mesh(*_chip())
    prove(planner.post(planner.plan(chip, Recipe(layer_height_mm=0.8)), cell), cell, chip, cell_mm=0.5)
    start, start_cpu = time.perf_counter(), time.process_time()
    proof = prove(program, cell, mesh, cell_mm=grid_mm)
    seconds, seen = time.perf_counter() - start, proof.deviation
    figures = {
        "lines": proof.lines,
        "metres": metres,
        "build_min": proof.duration_s / 60.0,
        "proof_s": seconds,
        "cpu_s": time.process_time() - start_cpu,
        "ratio": proof.duration_s / seconds,
        "peak_mb": peak_mb(),
        "cells_s": (proof.deposited_mm3 + proof.removed_mm3) / grid_mm**3 / seconds,
        "p99": seen.p99_mm,
        "missing": 100.0 * seen.missing_mm3 / seen.part_mm3,
        "verdict": "passed" if proof.passed else _short(proof.reasons),
    }
    print(json.dumps(figures))


def _short(reasons: tuple[str, ...]) -> str:
    """The kinds of reasons and how many of each."""
    kinds = [reason.partition(":")[0] for reason in reasons]
    return ", ".join(f"{kind} x{kinds.count(kind)}" for kind in dict.fromkeys(kinds))


def _chip() -> tuple[np.ndarray, np.ndarray]:
    """A small box: vertices and facets."""
    import trimesh

    box = trimesh.creation.box((8.0, 8.0, 1.6))
    return np.asarray(box.vertices), np.asarray(box.faces)


if __name__ == "__main__":
    main(Path(sys.argv[1]), float(sys.argv[2]))
