"""Interrupted at an instant and resumed: in the twin the part becomes what it would have been, but for one bead's overlap at the joint."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import planner
import sim
from config import load_cell, load_material
from planner.mesh.mesh import Mesh
from planner.program import LineKind, Program
from planner.recipe import Recipe
from planner.resume import ResumePoint
from sim.dryrun import DryRun
from tests.unit.planner.joints import Made, joint_at, made_of, tip_at
from tests.unit.planner.small_parts import box
from tests.unit.planner.test_resume import leaning_ring, lit_lines, middle_of_a_bead

CELL = load_cell("trunnion_tcp")
CELL_MM = 0.3
WALL = box(14.0, 2.4, 1.6)
CREST_MM = 1.1  # of one bead
SAME_MM = 0.1  # of two surfaces that the grid resolves to a third of a cell


@cache
def wall() -> tuple[Program, Made]:
    """Two single beads on each other."""
    program = planner.post(planner.plan(WALL, Recipe(process="deposit")), CELL)
    return program, made_of(program, CELL, WALL, CELL_MM)


@cache
def block() -> tuple[Program, Mesh, Made]:
    """One layer of contour and fill, then a face and a wall milled."""
    mesh = box(7.0, 4.0, 0.8)
    program = planner.post(planner.plan(mesh, Recipe(process="hybrid")), CELL)
    return program, mesh, made_of(program, CELL, mesh, CELL_MM)


def operation_lines(program: Program, tool_change: int) -> list[int]:
    """Lines that cut, behind a tool change."""
    does = (program.table["kind"] == LineKind.PROCESS) & (np.arange(len(program.lines)) > tool_change) & (program.table["bulge"] != 0.0)
    return [int(line) for line in np.flatnonzero(does)]


def test_stock_at_the_end_of_a_program_is_that_of_its_proof() -> None:
    program, whole = wall()
    state = sim.stock_after(program, CELL, WALL, len(program.lines) - 1, 1.0, cell_mm=CELL_MM)
    again = DryRun(program, CELL, WALL, load_material("316L"), None, CELL_MM, state)
    assert np.abs(again.stock.distance(whole.surface) - whole.run.stock.distance(whole.surface)).max() < 1e-6
    assert again.stock.deposited_mm3 == pytest.approx(whole.run.stock.deposited_mm3, abs=1e-6)


def test_stock_ends_where_the_laser_went_dark_and_is_cold() -> None:
    program, whole = wall()
    line, share = middle_of_a_bead(program)
    state = sim.stock_after(program, CELL, WALL, line, share, cell_mm=CELL_MM)
    stood = DryRun(program, CELL, WALL, load_material("316L"), None, CELL_MM, state)
    end = tip_at(program, line, share)
    before = tip_at(program, line, share - 0.25)
    ahead = tip_at(program, line, share + 0.25)
    up = np.array([0.0, 0.0, 0.3])
    assert stood.stock.distance(np.array([before + up]))[0] < 0.0 < stood.stock.distance(np.array([ahead + up]))[0]
    lit = [k for k in lit_lines(program) if k <= line]
    table = program.table
    way = [float(table["arc_end_mm"][k] - table["arc_start_mm"][k]) for k in lit_lines(program)]
    done = sum(way[: len(lit)]) - (1.0 - share) * way[len(lit) - 1]
    assert stood.stock.deposited_mm3 / whole.run.stock.deposited_mm3 == pytest.approx(done / sum(way), abs=0.03)
    assert stood.metal.base_k == pytest.approx(load_material("316L").part_heat.ambient_k, abs=0.1)
    assert np.linalg.norm(end - tip_at(program, line, share)) == 0.0


def test_bead_interrupted_in_its_middle_stands_out_less_than_half_a_bead_at_the_joint() -> None:
    program, whole = wall()
    joint = joint_at(program, CELL, WALL, whole, lit_lines(program)[-1], 0.6)
    assert not joint.made.proof.findings
    assert joint.high_mm < 0.5 * CREST_MM and joint.low_mm > -SAME_MM
    assert max(joint.far_high_mm, -joint.far_low_mm) < SAME_MM
    assert 0.0 < joint.volume_mm3 < joint.overlap_mm * CREST_MM * 2.0  # less than one bead's overlap


def test_part_interrupted_in_the_wait_between_layers_is_the_same() -> None:
    program, whole = wall()
    line = int(np.flatnonzero(program.table["kind"] == LineKind.DWELL)[0])
    joint = joint_at(program, CELL, WALL, whole, line, 0.5)
    assert not joint.made.proof.findings and joint.overlap_mm == 0.0
    assert joint.made.proof.to_json() == sim.prove(joint.resumed, CELL, WALL, start=joint.start).to_json()
    assert max(joint.high_mm, -joint.low_mm, joint.far_high_mm, -joint.far_low_mm) < SAME_MM


def test_milling_interrupted_on_an_arc_leaves_no_mark() -> None:
    program, mesh, whole = block()
    change = max(k for k, text in enumerate(program.lines) if "M6 T2" in text)
    joint = joint_at(program, CELL, mesh, whole, operation_lines(program, change)[2], 0.5)
    assert not joint.made.proof.findings and joint.made.proof.passed == whole.proof.passed
    assert max(joint.high_mm, -joint.low_mm, joint.far_high_mm, -joint.far_low_mm) < 0.02


def test_layer_of_beads_interrupted_before_it_is_milled_becomes_the_same_part() -> None:
    program, mesh, whole = block()
    joint = joint_at(program, CELL, mesh, whole, *middle_of_a_bead(program))
    assert not joint.made.proof.findings and joint.made.proof.passed == whole.proof.passed
    assert joint.made.proof.deviation.p99_mm == pytest.approx(whole.proof.deviation.p99_mm, abs=0.02)
    assert joint.made.proof.removed_mm3 > whole.proof.removed_mm3  # the overlap is cut off again


def test_leaning_bead_with_a_turning_axis_is_resumed_within_one_bead() -> None:
    plan = leaning_ring()
    program, mesh = planner.post(plan, CELL), box(28.0, 28.0, 0.8)
    whole = made_of(program, CELL, mesh, 0.4)
    line = lit_lines(program)[0]
    joint = joint_at(program, CELL, mesh, whole, line, 0.45, plan)
    assert not [found for found in joint.made.proof.findings if found.severity == "error"]
    assert joint.high_mm < CREST_MM and joint.far_high_mm < 2.0 * SAME_MM


def test_rest_proved_on_a_bare_plate_lacks_the_metal_and_meets_none_of_it() -> None:
    program, _, _ = block()
    mesh = block()[1]
    change = max(k for k, text in enumerate(program.lines) if "M6 T2" in text)
    line = operation_lines(program, change)[0]
    rest = planner.resume(program, CELL, ResumePoint.at(line, 0.5), program_sha256="0" * 64)
    bare = sim.prove(rest, CELL, mesh, cell_mm=CELL_MM)
    state = sim.stock_after(program, CELL, mesh, line, 0.5, cell_mm=CELL_MM)
    there = sim.prove(rest, CELL, mesh, start=state)
    assert not bare.passed and bare.removed_mm3 == 0.0
    assert there.passed, there.reasons


def test_rapid_through_what_stands_is_found_on_the_stock_as_it_stands() -> None:
    program, mesh, _ = block()
    change = max(k for k, text in enumerate(program.lines) if "M6 T2" in text)
    line = operation_lines(program, change)[0]
    rest = planner.resume(program, CELL, ResumePoint.at(line, 0.5), program_sha256="0" * 64)
    assert rest.continues is not None
    z = CELL.letters.index("Z")
    low = float(rest.table["joints_end"][rest.continues.head_lines - 1][z] - program.work_offset[z])
    lines = list(rest.lines)
    over = next(k for k, text in enumerate(lines) if "over the place" in text) + 1
    across = re.search(r"X[-.\d]+Y[-.\d]+", lines[over])
    assert across is not None
    lines[over] = f"N{over + 1}X0Y20Z{low:.3f}A0C0"  # beside the part, as low as the cut
    lines[over + 2] = f"N{over + 3}{across[0]}"
    broken = replace(rest, lines=tuple(lines))
    state = sim.stock_after(program, CELL, mesh, line, 0.5, cell_mm=CELL_MM)
    kinds = {found.kind for found in sim.prove(broken, CELL, mesh, start=state).findings}
    assert "rapid in metal" in kinds
    assert not kinds & {found.kind for found in sim.prove(broken, CELL, mesh, cell_mm=CELL_MM).findings}


def test_point_that_the_program_has_not_is_refused() -> None:
    program, _ = wall()
    with pytest.raises(ValueError, match="the program has lines 0 to"):
        sim.stock_after(program, CELL, WALL, len(program.lines), 0.0, cell_mm=CELL_MM)
