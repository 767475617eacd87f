"""How long planning takes, stage by stage, what the plan file costs, and how both grow with the mesh."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import trimesh

from planner.files.plan_file import plan_bytes, plan_from_bytes
from planner.mesh import load
from planner.pipeline import plan
from planner.recipe import Recipe, load_recipe
from tests.bench.table import Table

ROOT = Path(__file__).resolve().parents[2]
PARTS = ROOT / "config" / "parts"
MILLION = 1_000_000


def run() -> list[Table]:
    """CPU time of planning the shipped parts and a million triangles, and of writing and reading plans."""
    return [_files(), _costs()]


def _files() -> Table:
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
            [
                name,
                len(made.layers),
                passes,
                planned - started,
                sections,
                written - planned,
                read - written,
                len(data) / 1e6,
            ]
        )
    columns = ["part", "layers", "passes", "plan s", "of it sections s", "write s", "read s", "file MB"]
    return Table("Planning", columns, rows, "CPU time of one process, kernels compiled.")


def _costs() -> Table:
    """Every part in a fresh process; the last is the bearing with each facet cut in 1,024."""
    rows = []
    with tempfile.TemporaryDirectory() as place:
        usual = Path(place) / "usual.toml"
        usual.write_text("schema_version = 1\n")
        for name in ("pipe", "bearing", "hinge", "double_arc"):
            recipe = PARTS / "pipe.toml" if name == "pipe" else usual
            limits = [10.0, 2.0, None] if name in ("pipe", "bearing") else [None] * 3
            rows.append(_row(name, _cost(PARTS / f"{name}.stl", recipe), limits))
        rows.append(_row("pipe, +z", _cost(PARTS / "pipe.stl", usual), [10.0, 2.0, None]))
        fine = trimesh.load_mesh(PARTS / "bearing.stl")
        while len(fine.faces) < MILLION:
            fine = fine.subdivide()
        path = Path(place) / "fine.stl"
        fine.export(path)
        rows.append(_row("bearing, fine", _cost(path, usual), [60.0, None, 2000.0]))
    columns = [
        "part", "facets", "layers", "deviation mm", "load s", "first layer s", "limit", "plan s", "load + plan s", "limit",
        "wall s", "peak MB", "limit",
    ]  # fmt: skip
    note = "CPU time of a fresh process each, kernels read from their cache; deviation of contours from the facets' section."
    return Table("Planning: growth and memory", columns, rows, note)


def _cost(part: Path, recipe: Path) -> dict[str, Any]:
    command = [sys.executable, "-m", "tests.bench.plan_cost", str(part), str(recipe)]
    answer = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    found: dict[str, Any] = json.loads(answer.stdout)
    return found


def _row(name: str, cost: dict[str, Any], limits: list[float | None]) -> list[Any]:
    whole, first, memory = ("" if limit is None else limit for limit in limits)
    return [
        name, cost["facets"], cost["layers"], cost["deviation_mm"], cost["load_s"], cost["first_s"], first, cost["plan_s"],
        cost["load_s"] + cost["plan_s"], whole, cost["wall_s"], cost["peak_mb"], memory,
    ]  # fmt: skip
