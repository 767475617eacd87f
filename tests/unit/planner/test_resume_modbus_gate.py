"""A cell whose laser has no wired gate, interrupted and resumed: light is the schedule's, and the joint is as with a gate."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import planner
from config import load_cell
from planner.post.reread import read
from planner.program import Program
from planner.recipe import Recipe
from planner.resume.stretch import lit_lines
from tests.unit.planner.joints import Made, joint_at, made_of
from tests.unit.planner.small_parts import box

CELL = load_cell("trunnion_rtu")
CELL_MM = 0.3
WALL = box(14.0, 2.4, 1.6)
CREST_MM = 1.1  # of one bead
SAME_MM = 0.1


@cache
def wall() -> tuple[Program, Made]:
    """Two single beads on each other."""
    program = planner.post(planner.plan(WALL, Recipe(process="deposit")), CELL)
    return program, made_of(program, CELL, WALL, CELL_MM)


@pytest.mark.parametrize("bead", [0, -1])
def test_bead_lit_by_modbus_is_resumed_within_half_a_bead(bead: int) -> None:
    program, whole = wall()
    assert program.gate == "modbus" and not any("M62" in line for line in program.lines)
    line = int(np.flatnonzero(lit_lines(program, read(program)))[bead])
    joint = joint_at(program, CELL, WALL, whole, line, 0.6)
    assert not joint.made.proof.findings
    assert joint.high_mm < 0.5 * CREST_MM and joint.low_mm > -SAME_MM
    assert max(joint.far_high_mm, -joint.far_low_mm) < SAME_MM
    assert 0.0 < joint.volume_mm3 < joint.overlap_mm * CREST_MM * 2.0

