"""Compiles the numeric kernels and keeps the machine code: small parts planned in each layer rule and along a bend, posted, one proved."""

from __future__ import annotations

import sys
import time

import numpy as np
import trimesh
from shapely import Polygon

import planner
from config.cell import load_cell
from planner.mesh.mesh import Mesh
from planner.recipe import Recipe
from sim.dryrun import prove


def cone_with_bore() -> Mesh:
    """A frustum 24 to 20 mm wide, 3 mm high, with a bore of 8 mm: leaning, round and straight walls, a hole."""
    profile = np.array([[4.0, 0.0], [12.0, 0.0], [10.0, 3.0], [4.0, 3.0], [4.0, 0.0]])
    return Mesh.from_trimesh(trimesh.creation.revolve(profile, sections=32))


def elbow() -> Mesh:
    """A rod of 10 mm that bends through 90 degrees about (16, 0, 0): layers that turn with its axis, passes with the head tilted."""
    turn, around = np.linspace(0.0, 0.5 * np.pi, 13), np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    path = 16.0 * np.column_stack([1.0 - np.cos(turn), np.zeros_like(turn), np.sin(turn)])
    outline = Polygon(5.0 * np.column_stack([np.cos(around), np.sin(around)]))
    return Mesh.from_trimesh(trimesh.creation.sweep_polygon(outline, path))


def main() -> None:
    """Do it, and say how long it took."""
    started = time.monotonic()
    cell = load_cell("trunnion_tcp")
    body = cone_with_bore()
    made = planner.plan(body, Recipe(tolerance_mm=0.2, layer_height_mm=0.8))
    prove(planner.post(made, cell), cell, body, cell_mm=0.5)
    block = Mesh.from_trimesh(trimesh.creation.box((12.0, 8.0, 2.0)))
    for rule in ("extruded", "ruled"):
        planner.plan(block, Recipe(process="deposit", layer_rule=rule, fit="facets"))
    bent = planner.plan(elbow(), Recipe(process="deposit"))
    for dialect in ("grblhal", "linuxcnc", "siemens"):
        planner.post(bent, cell, dialect=dialect)
    planner.plan(body, Recipe(tolerance_mm=0.2, layer_height_mm=0.8, ball_cutter_diameter_mm=6.0))
    print(f"setup: kernels compiled in {time.monotonic() - started:.0f} s")


if __name__ == "__main__":
    sys.exit(main())
