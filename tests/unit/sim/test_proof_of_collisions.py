"""Whole Programs in which something meets what it must not: each is told with what, where, how deep and on which line, and does not pass."""

from __future__ import annotations

import numpy as np
import pytest

from config import Cell
from planner.program import Channel, LineKind, Program
from sim.findings import Finding
from sim.proof import Proof
from tests.cell.jobs import Writer
from tests.unit.sim.jobs_by_hand import (
    CELL,
    CELL_MM,
    CUT_MM_S,
    FAST_MM_S,
    HALF_Y,
    PASSES_X,
    RAW_MM,
    SAFE_MM,
    TOLERANCE_MM,
    TOP_MM,
    WALL_HIGH,
    WALL_X,
    faced,
    prove_faced,
    the,
)  # fmt: skip

D8, D4, HEAD = (next(tool for tool in CELL.tools if tool.number == number) for number in (2, 3, 1))
CLEAR_MM = CELL.proof.clearance_mm
LOOK_MM = 0.5  # of motion between two looks at things that are nearly together: nothing goes deeper unseen
PIVOT_Z, TABLE_TOP_Z, TABLE_RADIUS, PART_Z = -450.0, -430.0, 120.0, -420.0  # machine frame, as the cell's file draws them


def out_and_back(w: Writer, *, start: float, to: float, z: float = TOP_MM, kind: LineKind = LineKind.LINK, feed: float = FAST_MM_S) -> int:
    """Down at y = 0, along x to a place and back, up; the N-word of the way there."""
    for height in (SAFE_MM, z):
        w.move(start, 0.0, height, LineKind.LINK, FAST_MM_S)
    n = w.move(to, 0.0, z, kind, feed)
    for height in (z, SAFE_MM):
        w.move(start, 0.0, height, LineKind.LINK, FAST_MM_S)
    return n


def with_d4(w: Writer) -> None:
    w.line("M6 T3", LineKind.TOOL)
    w.tool = 3
    w.line("M3 S6000", LineKind.SETUP)


def with_head(w: Writer) -> None:
    """The deposition head instead of the cutter, out and high over the plate's left half."""
    w.line("M5", LineKind.SETUP)
    w.line("M6 T1", LineKind.TOOL)
    w.tool = 1
    w.at(w.move(-20.0, 0.0, SAFE_MM + 40.0, LineKind.LINK, FAST_MM_S), Channel.MODE, 1, barrier=True)


def collision_of(job: tuple[Program, int], what: str, cell: Cell = CELL) -> tuple[Finding, Proof]:
    """The collision of a Program, which is the only error, says what meets what, stands at its line and fails the proof."""
    program, line = job
    proof = prove_faced(program, cell)
    found = the(proof, "collision")
    assert found.text == f"{what.split(' / ')[0]} and {what.split(' / ')[1]} overlap by {found.depth_mm:.2f} mm"
    assert (found.line, found.first_line, found.operation, found.layer, found.severity) == (line, line, 1, 0, "error")
    assert not proof.passed and any(reason.startswith("collision:") and f"N{line}" in reason for reason in proof.reasons)
    return found, proof


def place(found: Finding) -> np.ndarray:
    assert found.at_mm is not None
    return np.array(found.at_mm)


def only_error(proof: Proof) -> None:
    assert [each.kind for each in proof.findings if each.severity == "error"] == ["collision"]


def test_sound_facing_passes_without_a_finding() -> None:
    proof = prove_faced(faced()[0])
    assert proof.passed and proof.findings == ()
    assert proof.removed_mm3 == pytest.approx((RAW_MM - TOP_MM) * 16.0 * 2.0 * HALF_Y, rel=0.02)
    assert proof.clearance_mm is not None and proof.clearance_mm > CLEAR_MM


def test_nozzle_driven_into_a_standing_wall_is_told_at_the_wall_s_edge_and_as_deep_as_its_cone_goes() -> None:
    shape = HEAD.nozzle
    slope = (0.5 * HEAD.holder_diameter_mm - 0.5 * shape.end_diameter_mm) / shape.cone_length_mm
    wide = 0.5 * shape.end_diameter_mm + slope * (WALL_HIGH - TOP_MM - shape.standoff_mm)  # the cone, at the height of the wall's edge
    across_mm = 1.5

    def drive(w: Writer) -> int:
        with_head(w)
        return out_and_back(w, start=-20.0, to=WALL_X - wide + across_mm)

    found, proof = collision_of(faced(drive), "nozzle / stock")
    only_error(proof)
    assert found.depth_mm == pytest.approx(across_mm / np.hypot(1.0, slope), abs=0.7 * CELL_MM)  # the grid rounds the edge off
    assert place(found) == pytest.approx([WALL_X, 0.0, WALL_HIGH], abs=CELL_MM + across_mm)


def test_holder_that_hits_the_wall_beside_a_low_cut_is_told_by_its_depth_and_height() -> None:
    reach, into_mm = 0.5 * D4.holder_diameter_mm, 2.0

    def drive(w: Writer) -> int:
        with_d4(w)
        return out_and_back(w, start=0.0, to=WALL_X - reach + into_mm)

    found, proof = collision_of(faced(drive), "T3 holder / stock")
    only_error(proof)
    assert found.depth_mm == pytest.approx(into_mm, abs=0.1)
    x, y, z = place(found)
    assert WALL_X - CELL_MM <= x <= WALL_X + into_mm and abs(y) <= HALF_Y
    assert TOP_MM + D4.stickout - CELL_MM <= z <= WALL_HIGH + CELL_MM


def test_shank_that_rubs_above_a_cut_deeper_than_the_flutes_is_told() -> None:
    assert D8.shank_diameter_mm is not None and D8.flute_length_mm is not None
    x = WALL_X - 2.0

    def drive(w: Writer) -> int:
        return out_and_back(w, start=4.0, to=x, kind=LineKind.PROCESS, feed=CUT_MM_S)

    found, proof = collision_of(faced(drive), "T2 shank / stock")
    assert found.depth_mm == pytest.approx(x + 0.5 * D8.shank_diameter_mm - WALL_X, abs=0.1)
    assert place(found)[0] == pytest.approx(WALL_X + 0.5 * found.depth_mm, abs=found.depth_mm)
    assert TOP_MM + D8.flute_length_mm - CELL_MM <= place(found)[2] <= WALL_HIGH
    assert the(proof, "gouge").line == found.line  # the flutes below it cut the wall


def test_cutter_that_runs_into_a_clamp_is_told_by_the_clamp_s_name_and_height() -> None:
    assert CELL.machine is not None
    clamps, plate = CELL.machine.clamps, CELL.plate.size_mm
    below_mm = 1.5

    def drive(w: Writer) -> int:
        return out_and_back(w, start=-40.0, to=-58.0, z=clamps.above_mm - below_mm)

    found, proof = collision_of(faced(drive), "T2 flutes / clamp 3")
    only_error(proof)
    assert found.depth_mm == pytest.approx(below_mm, abs=0.02)  # out upwards is the shortest way
    x, y, z = place(found)
    edge = -0.5 * plate[0] + clamps.overlap_mm
    assert edge - 11.0 <= x <= edge + 0.5 * D8.diameter_mm and abs(y) <= 0.5 * clamps.width_mm
    assert clamps.above_mm - below_mm - 0.01 <= z <= clamps.above_mm + 0.01


def test_table_turned_until_it_meets_the_nozzle_is_told_as_deep_as_the_angle_says() -> None:
    y, tip_z, angle = 90.0, 20.0, np.radians(25.0)
    radius, standoff = 0.5 * HEAD.nozzle.end_diameter_mm, HEAD.nozzle.standoff_mm

    def drive(w: Writer) -> int:
        with_head(w)
        w.move(0.0, y, SAFE_MM, LineKind.LINK, FAST_MM_S)
        w.move(0.0, y, tip_z, LineKind.LINK, FAST_MM_S)
        n = w.line("G1 A-25 F60", LineKind.LINK, 1.0)
        w.line("G1 A0 F60", LineKind.LINK, 1.0)
        w.move(0.0, y, SAFE_MM, LineKind.LINK, FAST_MM_S)
        return n

    found, proof = collision_of(faced(drive), "nozzle / table")
    only_error(proof)
    # The far edge of the nozzle's end, from the pivot: turned with the table it lies this far along its top and this far above it.
    far, high = y + radius, PART_Z + tip_z + standoff - PIVOT_Z
    along, above = far * np.cos(angle) + high * np.sin(angle), high * np.cos(angle) - far * np.sin(angle) - (TABLE_TOP_Z - PIVOT_Z)
    assert along < TABLE_RADIUS and above < 0.0
    assert found.depth_mm == pytest.approx(-above, abs=0.05)
    contact = place(found)
    assert contact[0] == pytest.approx(0.0, abs=1.0) and contact[1] == pytest.approx(along, abs=2.0)
    assert TABLE_TOP_Z - PART_Z + above - 0.1 <= contact[2] <= TABLE_TOP_Z - PART_Z + 0.1


def test_pass_half_a_millimetre_too_deep_is_a_gouge_on_its_line_as_deep_as_that() -> None:
    program, line = faced(deeper_mm=0.5)
    proof = prove_faced(program)
    found = the(proof, "gouge")
    assert [each.kind for each in proof.findings] == ["gouge"] and not proof.passed
    assert (found.line, found.operation, found.severity) == (line, 0, "error")
    assert found.depth_mm == pytest.approx(0.5, abs=0.1 * CELL_MM)
    x, y, z = place(found)
    assert abs(x - PASSES_X[2]) <= 0.5 * D8.diameter_mm and abs(y) <= HALF_Y and TOP_MM - 0.5 <= z <= TOP_MM
    assert f"allowed {TOLERANCE_MM:g} mm" in found.text
    assert any(reason.startswith("gouge:") and f"N{line}" in reason for reason in proof.reasons)


def test_holder_that_passes_close_by_is_a_warning_and_the_proof_passes() -> None:
    gap_mm = 0.4
    assert gap_mm + LOOK_MM < CLEAR_MM

    def drive(w: Writer) -> int:
        with_d4(w)
        return out_and_back(w, start=0.0, to=WALL_X - 0.5 * D4.holder_diameter_mm - gap_mm)

    program, line = faced(drive)
    proof = prove_faced(program)
    found = the(proof, "clearance")
    assert proof.passed and [each.kind for each in proof.findings] == ["clearance"]
    assert (found.line, found.operation, found.severity) == (line, 1, "warning")
    assert "T3 holder" in found.text and "stock" in found.text
    assert proof.clearance_mm is not None and gap_mm - 0.05 <= proof.clearance_mm <= gap_mm + LOOK_MM
    assert WALL_X - gap_mm <= place(found)[0] <= WALL_X + 3.0 * CELL_MM


def test_cell_that_states_no_bodies_is_proven_with_a_warning_that_nobody_looked() -> None:
    proof = prove_faced(faced()[0], CELL.model_copy(update={"machine": None}))
    found = the(proof, "unchecked")
    assert proof.passed and found.severity == "warning" and found.at_mm is None
    assert proof.clearance_mm is None
