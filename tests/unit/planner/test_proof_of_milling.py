"""Parts cut from a block or a given stock, proved in the twin: what the plan cuts from is what the proof clamps."""

from __future__ import annotations

import planner
from config import load_cell
from planner.plan import Process
from planner.recipe import Recipe
from sim import prove
from tests.unit.planner.small_parts import box, points_of

CELL = load_cell("trunnion_tcp")
CELL_MM = 0.3
PART = box(12.0, 8.0, 1.6)


def test_block_thinner_than_one_cut_is_faced_to_its_height_and_passes_its_proof() -> None:
    made = planner.plan(PART, Recipe(process="mill"))
    faces = [
        points_of(step)[0, 2]
        for operation in made.operations
        if operation.process is Process.MILL_FACE
        for step in operation.passes
        if not step.is_link
    ]
    assert any(abs(z - 1.6) < 1e-9 for z in faces)
    proof = prove(planner.post(made, CELL), CELL, PART, cell_mm=CELL_MM)
    assert proof.passed, proof.reasons
    assert proof.deviation.max_excess_mm < 0.05
