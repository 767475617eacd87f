"""What of one plan and of one proof could be done on more processes than one: the share of it that no earlier layer has to be finished for."""

from __future__ import annotations

import pickle
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any

import numpy as np

import planner
import planner.compose.straight as straight
import planner.pipeline as pipeline
import planner.toolpath.order as order
import sim.dryrun as dryrun
from config import load_cell
from config.base import FACTS_DIR
from planner.mesh import load
from planner.recipe import load_recipe
from tests.bench.table import Cell, Table

PARTS = FACTS_DIR / "parts"
SIZES = (("pipe", 1.0), ("bearing", 1.0), ("bearing", 2.0))  # of a part's own size
PROVEN = "pipe"
WORKERS = 2
CELL = "trunnion_tcp"
OF_LAYERS = (
    (straight, "layer_regions"), (order, "deposit_operations"), (order, "side_operations"), (order, "faced"), (pipeline, "engagement_findings"),
)  # fmt: skip
"""What works on a layer or a band with its neighbours alone. The rest (division, levels, links, balance, gouges) needs what is before it, or all."""
OF_PROOF = ((dryrun, "check"), (dryrun, "measure"), (dryrun, "picture"))
"""What needs no stock that is still being made: the text's limits before the run, measuring and drawing after it."""


@contextmanager
def timed(functions: tuple[tuple[Any, str], ...]) -> Iterator[dict[str, float]]:
    """CPU seconds spent within these functions, by name."""
    spent: dict[str, float] = {name: 0.0 for _, name in functions}
    whole = [(module, name, getattr(module, name)) for module, name in functions]

    def clocked(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(function)
        def call(*args: Any, **kwargs: Any) -> Any:
            started = time.process_time()
            try:
                return function(*args, **kwargs)
            finally:
                spent[name] += time.process_time() - started

        return call

    try:
        for module, name, function in whole:
            setattr(module, name, clocked(name, function))
        yield spent
    finally:
        for module, name, function in whole:
            setattr(module, name, function)


def inside() -> list[Table]:
    """Shares, the bound that follows (Amdahl), and what a process costs before it does the first of it."""
    start_s = _start_s()
    rows = [_plan(name, size, start_s) for name, size in SIZES]
    rows.append(_proof(PROVEN, start_s))
    columns = ["work", "whole s", "divisible s", "share %", "bound on 2", "saved s at most", "start of a process s", "layers pickled ms"]
    note = (
        f"CPU time, kernels loaded. Divisible: {', '.join(name for _, name in OF_LAYERS)}; of a proof {', '.join(name for _, name in OF_PROOF)}. "
        f"Bound: all of it spread evenly over {WORKERS} processes that are there already, nothing moved."
    )
    return [Table("What of one plan or proof could be split", columns, rows, note)]


def _row(work: str, whole_s: float, spent: dict[str, float], start_s: float, pickled_ms: float) -> list[Cell]:
    divisible = sum(spent.values())
    saved = divisible * (1.0 - 1.0 / WORKERS)
    return [work, whole_s, divisible, 100.0 * divisible / whole_s, whole_s / (whole_s - saved), saved, start_s, pickled_ms]


def _plan(name: str, size: float, start_s: float) -> list[Cell]:
    recipe = load_recipe(PARTS / f"{name}.toml")
    mesh = load(PARTS / f"{name}.stl", "mm").transformed(np.diag([size, size, size, 1.0]))
    if size == 1.0:
        pipeline.plan(mesh, recipe)  # loads kernels
    with timed(OF_LAYERS) as spent:
        started = time.process_time()
        made = pipeline.plan(mesh, recipe)
        whole = time.process_time() - started
    started = time.process_time()
    pickle.loads(pickle.dumps(made.layers))
    return _row(f"plan of the {name} x {size:g}", whole, spent, start_s, 1000.0 * (time.process_time() - started))


def _proof(name: str, start_s: float) -> list[Cell]:
    mesh, cell = load(PARTS / f"{name}.stl"), load_cell(CELL)
    program = planner.post(planner.plan(mesh, load_recipe(PARTS / f"{name}.toml")), cell)
    with timed(OF_PROOF) as spent:
        started = time.process_time()
        dryrun.prove(program, cell, mesh)
        whole = time.process_time() - started
    return _row(f"proof of the {name}", whole, spent, start_s, 0.0)


def _start_s() -> float:
    """CPU time of a fresh process until it could plan its first layer: imports, kernels from their cache, the smallest plan."""
    code = (
        "import time, trimesh; from planner.mesh import Mesh; import numpy as np; from planner import plan; from planner.recipe import Recipe; "
        "box = trimesh.creation.box((8.0, 8.0, 1.6)); plan(box, Recipe(layer_height_mm=0.8)); print(time.process_time())"
    )
    return float(subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout)
