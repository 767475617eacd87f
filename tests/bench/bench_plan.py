"""How long planning takes, stage by stage, and what the plan file costs."""

from __future__ import annotations

import time
from pathlib import Path

from planner.files.plan_file import plan_bytes, plan_from_bytes
from planner.mesh import load
from planner.pipeline import plan
from planner.recipe import Recipe, load_recipe
from tests.bench.table import Table

PARTS = Path(__file__).resolve().parents[2] / "config" / "parts"


def run() -> list[Table]:
    """CPU time of planning the shipped parts, and of writing and reading their plans."""
    rows = []
    recipes = {"pipe": load_recipe(PARTS / "pipe.toml"), "bearing": Recipe(layer_height_mm=0.8)}
    for name, recipe in recipes.items():
        mesh = load(PARTS / f"{name}.stl")
        plan(mesh, recipe)  # compiles the kernels
        stages: list[tuple[str, float]] = []
        started = time.process_time()
        made = plan(mesh, recipe, progress=lambda stage, share: stages.append((stage, time.process_time())))  # noqa: B023
        planned = time.process_time()
        data = plan_bytes(made)
        written = time.process_time()
        plan_from_bytes(data)
        read = time.process_time()
        sections = next(at for stage, at in stages if stage == "contours") - started
        passes = sum(len(operation.passes) for operation in made.operations)
        rows.append(
            [name, len(made.layers), passes, planned - started, sections, written - planned, read - written, len(data) / 1e6]
        )
    columns = ["part", "layers", "passes", "plan s", "of it sections s", "write s", "read s", "file MB"]
    return [Table("Planning", columns, rows, "CPU time of one process, kernels compiled.")]
