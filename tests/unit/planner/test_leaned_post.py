"""A wall beside a clamp that is higher than the nozzle: posted with the head leaning, read back, and built in the twin without a touch."""

from __future__ import annotations

import numpy as np
import trimesh

import planner
from config.cell import Cell, load_cell
from planner.mesh.mesh import Mesh
from planner.post import post_with_report
from planner.recipe import Recipe
from sim.dryrun import prove

SIZE_MM = (12.0, 2.5, 1.6)
BESIDE_MM = 42.0  # off the middle of the plate; the clamp begins at 52


def cell_with_clamps(above_mm: float) -> Cell:
    cell = load_cell("trunnion_tcp")
    assert cell.machine is not None
    clamps = cell.machine.clamps.model_copy(update={"above_mm": above_mm})
    return cell.model_copy(update={"machine": cell.machine.model_copy(update={"clamps": clamps})})


def test_a_wall_beside_a_high_clamp_is_laid_with_the_head_leaning_and_gets_the_same_metal_in_the_twin() -> None:
    box = trimesh.creation.box(SIZE_MM)
    mesh = Mesh(np.asarray(box.vertices), np.asarray(box.faces))
    recipe = Recipe(process="deposit", layer_height_mm=0.8, decompose="never", shift_mm=(0.0, BESIDE_MM))
    plan = planner.plan(mesh, recipe)
    metal = {}
    for above_mm in (8.0, 40.0):
        cell = cell_with_clamps(above_mm)
        program, report = post_with_report(plan, cell)
        assert report.reread.setpoints_ok and report.reread.max_tip_mm <= cell.chord_tolerance_mm
        leaned = [told for told in report.counts.changes if "leaned by up to" in told]
        assert len(leaned) == (0 if above_mm == 8.0 else len(plan.operations))
        assert all("nozzle meets clamp 2" in told for told in leaned)
        proof = prove(program, cell, mesh, cell_mm=0.5)
        assert not [found.kind for found in proof.findings if found.kind in ("collision", "clearance")]
        metal[above_mm] = proof.deviation.part_mm3 - proof.deviation.missing_mm3 + proof.deviation.excess_mm3
    assert abs(metal[40.0] / metal[8.0] - 1.0) < 0.03
