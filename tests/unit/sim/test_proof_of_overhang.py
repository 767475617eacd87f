"""Walls that lean beyond what a material holds, proved in the twin: they stand with the head tilted along them, and fall without."""

from __future__ import annotations

from functools import cache

import numpy as np
import shapely
import trimesh

import planner
from config import load_cell, load_material
from planner.mesh.mesh import Mesh
from planner.recipe import Recipe
from sim.dryrun import DryRun
from sim.proof import Proof

CELL = load_cell("trunnion_tcp")
LAYER_MM = 0.8
LEAN_DEG = 60.0


def leaning_wall(thick_mm: float = 3.0, length_mm: float = 10.0, height_mm: float = 7.2) -> Mesh:
    """A wall along y that leans towards +x."""
    out, wide = np.tan(np.radians(LEAN_DEG)), thick_mm / np.cos(np.radians(LEAN_DEG))
    outline = [(0.0, 0.0), (wide, 0.0), (wide + out * height_mm, height_mm), (out * height_mm, height_mm)]
    body = trimesh.creation.extrude_polygon(shapely.Polygon(outline), length_mm)
    turn = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    body.apply_transform(turn)
    return Mesh.from_trimesh(body)


@cache
def proved(overhang: str) -> Proof:
    mesh = leaning_wall()
    recipe = Recipe(
        process="deposit", overhang=overhang, layer_height_mm=LAYER_MM, tolerance_mm=0.5,
        build_direction=(0.0, 0.0, 1.0), decompose="never", axis_layers="never", support="never",
    )  # fmt: skip
    program = planner.post(planner.plan(mesh, recipe), CELL)
    run = DryRun(program, CELL, mesh, load_material("316L"), None, 0.4)
    run.execute()
    return run.conclude()


def missing_share(proof: Proof) -> float:
    return proof.deviation.missing_mm3 / proof.deviation.part_mm3


def test_wall_that_leans_sixty_degrees_stands_with_the_head_along_it_and_falls_with_the_head_upright() -> None:
    tilted, upright = proved("tilt"), proved("upright")
    assert missing_share(tilted) < 0.3  # of a short wall, whose ends are round and whose top is square to the tool axis
    assert missing_share(upright) > 2.0 * missing_share(tilted)
    assert upright.deviation.p99_mm > 2.0 * tilted.deviation.p99_mm


def test_tilted_head_meets_neither_plate_nor_part_nor_machine() -> None:
    assert not [reason for reason in proved("tilt").reasons if reason.startswith("collision")]
