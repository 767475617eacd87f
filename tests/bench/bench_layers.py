"""How many layers the rules need beside the exact optimum, how far their measured walls lie off, and what planning takes."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import trimesh

from planner.mesh import Mesh, load
from planner.pipeline import plan
from planner.plan import Layer
from planner.recipe import Recipe
from planner.slicing.confirm import Wanted
from planner.slicing.cusp import LayerRule
from planner.slicing.thickness import confirmed_layers, layer_heights
from tests.bench.table import Cell, Table

PARTS = Path(__file__).resolve().parents[2] / "config" / "parts"
UP = (0.0, 0.0, 1.0)
OPTIMA: dict[tuple[float, LayerRule], int] = {
    (23.0, "ruled"): 27,
    (23.0, "extruded"): 576,
    (20.0, "ruled"): 18,
    (20.0, "extruded"): 252,
}
"""Layers that the exact sphere needs with δ = 0.04 (R 23) and 0.08 (R 20)."""
RULES: tuple[LayerRule, LayerRule] = ("ruled", "extruded")


def run() -> list[Table]:
    """Counts on spheres and on the shipped parts, and when layers are handed out."""
    return [_spheres(), _parts(), _handed_out()]


def _measured(mesh: Mesh, wanted: Wanted) -> list[Cell]:
    """Layers, greatest and mean deviation over the cusp, mean of those that only the cusp limits, layers beyond it, CPU seconds."""
    started = time.process_time()
    found = confirmed_layers(mesh, UP, wanted)
    spent = time.process_time() - started
    share = found.deviation_mm / wanted.cusp_mm
    free, beyond = found.mean_share(wanted.cusp_mm), int((share > 1.0 + 1e-9).sum())
    return [len(share), float(share.max()), float(share.mean()), free, beyond, spent]


def _spheres() -> Table:
    rows: list[list[Cell]] = []
    for radius, delta in ((23.0, 0.04), (20.0, 0.08)):
        fine = Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=6, radius=radius))
        coarse = Mesh.from_trimesh(trimesh.creation.uv_sphere(radius=radius, count=[24, 48]))
        for name, mesh in (("icosphere 6", fine), ("UV 48x24", coarse)):
            for rule in RULES:
                wanted = Wanted(delta, 1e-3, 5.0, rule, "both", 35.0)
                figures = _measured(mesh, wanted)
                rows.append([f"R {radius:g}, {delta:g} mm", name, rule, OPTIMA[radius, rule], *figures])
        flat = layer_heights(fine, UP, delta, 1e-3, 5.0)
        rows.append(
            [
                f"R {radius:g}, {delta:g} mm",
                "icosphere 6",
                "facet",
                int(radius / delta),
                len(flat) - 1,
                *[float("nan")] * 3,
                0,
                0.0,
            ]
        )
    columns = [
        "sphere, cusp",
        "mesh",
        "rule",
        "optimum",
        "layers",
        "max / cusp",
        "mean / cusp",
        "free mean / cusp",
        "beyond",
        "CPU s",
    ]
    note = "Optimum of the true sphere. On the coarse mesh the facets are the surface: their bends count, not the sphere's."
    return Table("Layers of spheres", columns, rows, note)


def _parts() -> Table:
    rows: list[list[Cell]] = []
    for name, delta in (("pipe", 0.04), ("bearing", 0.08), ("hinge", 0.08), ("double_arc", 0.08)):
        mesh = load(PARTS / f"{name}.stl")
        for rule in RULES:
            rows.append([name, delta, rule, *_measured(mesh, Wanted(delta, 0.02, 5.0, rule, "both", 35.0))])
    columns = ["part", "cusp mm", "rule", "layers", "max / cusp", "mean / cusp", "free mean / cusp", "beyond", "CPU s"]
    note = (
        "Measured: points of the walls to the nearest facet. Layers of 0.02 to 5 mm; beyond: those that the least thickness keeps "
        "from the cusp. Prismatic stretches, whose layers end at 5 mm or a level face, draw the mean down."
    )
    return Table("Layers of parts", columns, rows, note)


def _handed_out() -> Table:
    rows: list[list[Cell]] = []
    for name in ("pipe", "bearing"):
        mesh = load(PARTS / f"{name}.stl")
        plan(mesh, Recipe(layer_height_mm=0.8))  # compiles the kernels
        ready: list[float] = []

        def note(_: Layer, ready: list[float] = ready) -> None:
            ready.append(time.process_time())

        started = time.process_time()
        made = plan(mesh, Recipe(), on_layer=note)
        done = time.process_time() - started
        at = np.array(ready) - started
        rows.append([name, len(made.layers), float(at[0]), float(at[len(at) // 2]), done])
    columns = ["part", "layers", "first layer s", "half of them s", "all s"]
    return Table("Layers handed out", columns, rows, "CPU time of one process from the loaded mesh, kernels compiled.")
