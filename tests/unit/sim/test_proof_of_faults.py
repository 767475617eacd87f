"""Whole Programs in which laser, powder, spindle, axes or text are wrong: each is told with what, where and on which line, and is judged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from config import load_material
from planner.program import Channel, LineKind, Program
from sim.dryrun import DryRun
from sim.findings import Finding
from sim.proof import Proof
from tests.cell.jobs import Writer
from tests.unit.sim.jobs_by_hand import (
    CELL,
    CELL_MM,
    FEED_MM_S,
    HALF_Y,
    LAYER_MM,
    LEAD_MM,
    LENGTH_MM,
    PASS_Y,
    PASSES_X,
    PIECES,
    POWDER_G_MIN,
    RAW_MM,
    SAFE_MM,
    TOP_MM,
    beads,
    beads_part,
    edited,
    faced,
    line_of,
    prove_beads,
    prove_faced,
    the,
)  # fmt: skip

LAYER = 1  # of the beads, that is broken
Z = LAYER * LAYER_MM
GATE_RAMP_MM = 1.0  # way of the tip until a finding has been noticed: ramp and bound, at the bead's feed
RADIUS_MM = 4.0  # of the cutter


def broken(program: Program, kind: str, severity: str = "error", layer: int = LAYER) -> tuple[Finding, Proof]:
    """The finding of a kind in the beads, which belongs to the layer and, as an error, fails the proof with its line among the reasons."""
    proof = prove_beads(program)
    found = the(proof, kind)
    assert (found.severity, found.layer, found.operation) == (severity, layer, layer)
    named = [reason for reason in proof.reasons if reason.startswith(f"{kind}:") and f"N{found.line}" in reason]
    assert bool(named) == (severity == "error") and not (named and proof.passed)
    return found, proof


def at(found: Finding) -> tuple[float, float, float]:
    assert found.at_mm is not None
    return found.at_mm


def with_setpoint(channel: Channel, value: float) -> Program:
    """The beads with another value of a channel in the layer."""
    given = beads()
    schedule = given.schedule.copy()
    schedule["value"][(schedule["channel"] == channel) & (given.table["layer"][schedule["n"] - 1] == LAYER)] = value
    return replace(given, schedule=schedule)


def test_sound_beads_pass_without_a_finding() -> None:
    proof = prove_beads(beads())
    assert proof.passed, proof.reasons
    assert proof.findings == ()


def test_light_at_standstill_is_told_where_the_tip_stands_and_for_how_long() -> None:
    line = line_of("G90", LAYER)
    found, _ = broken(edited({line: "G4 P0.25"}), "standstill")  # a wait belongs to the line before it, where the tip came to stand
    assert found.line in (line - 1, line) and "250 ms" in found.text
    assert at(found) == pytest.approx((0.0, 0.0, Z), abs=0.05)


def test_light_while_the_machine_waits_at_a_barrier_belongs_to_the_line_that_it_came_to_stand_with() -> None:
    line = line_of("M63 P0", LAYER)
    given = edited({line: "G90"})
    wait = np.array([(line + 1, Channel.CARRIER_GAS_L_MIN, 1, 8.0)], dtype=given.schedule.dtype)
    place = int(np.searchsorted(given.schedule["n"], line + 1))
    found, _ = broken(replace(given, schedule=np.insert(given.schedule, place, wait)), "standstill")
    assert found.line == line - 1 and found.layer == LAYER


def test_gate_that_stays_open_is_told_from_where_the_pass_should_have_ended() -> None:
    line = line_of("M63 P0", LAYER)
    proof = prove_beads(edited({line: "G90"}))
    first = next(each for each in proof.findings if each.kind == "stray light")
    assert not proof.passed and first.help and (first.line, first.layer) == (line + 1, LAYER)
    out = LEAD_MM + 20.0 + (LENGTH_MM + 2.0 * LEAD_MM)
    assert first.depth_mm == pytest.approx(out, rel=0.05)


def test_powder_without_light_is_a_warning_as_long_as_the_dark_pass_and_the_metal_is_missing() -> None:
    found, proof = broken(edited({line_of("M62 P0", LAYER): "G90"}), "waste", "warning")
    assert found.depth_mm == pytest.approx(LENGTH_MM + LEAD_MM, abs=1.0)  # from where powder was waited for to the end of the bead
    assert f"{POWDER_G_MIN:.1f} g/min" in found.text
    x, y, z = at(found)
    assert -0.5 * LENGTH_MM - LEAD_MM - 0.1 <= x <= 0.5 * LENGTH_MM + LEAD_MM and (y, z) == pytest.approx((0.0, Z), abs=0.05)
    assert not proof.passed and any(reason.startswith("missing metal") for reason in proof.reasons)


def test_light_without_powder_is_told_over_the_whole_bead() -> None:
    found, _ = broken(with_setpoint(Channel.POWDER_G_MIN, 0.0), "starved")
    assert found.depth_mm == pytest.approx(LENGTH_MM, abs=GATE_RAMP_MM) and " 0 % of its powder" in found.text
    x, y, z = at(found)
    assert abs(x) <= 0.5 * LENGTH_MM and (y, z) == pytest.approx((0.0, Z), abs=0.05)


def test_head_that_retreats_under_light_is_told_where_it_left_its_stop() -> None:
    program = beads()
    line = line_of("G90", LAYER)
    run = DryRun(program, CELL, beads_part(), load_material("316L"), None, CELL_MM)

    def drive_slide_in() -> bool:
        if run.controller.executing >= line:
            run.world.io.values["head_deploy"] = 0.0
        return False

    run.execute(cancelled=drive_slide_in)
    proof = run.conclude()
    found = next(each for each in proof.findings if each.kind == "head parked")
    assert not proof.passed and found.severity == "error" and found.layer == LAYER and found.help
    x, y, z = at(found)
    assert line - PIECES // 2 <= found.line <= line_of("M63 P0", LAYER) and abs(x) <= 0.5 * LENGTH_MM and (y, z) == pytest.approx((0.0, Z), abs=0.05)


def test_head_that_is_never_called_out_leaves_the_laser_dark_and_the_proof_says_so() -> None:
    schedule = beads().schedule
    is_call = (schedule["channel"] == Channel.MODE) & (schedule["value"] == 1.0)
    proof = prove_beads(replace(beads(), schedule=schedule[~is_call]))
    assert the(proof, "no emission").severity == "error" and not proof.passed


def test_line_that_the_firmware_refuses_is_told_with_meaning_and_remedy() -> None:
    line = line_of("G90", LAYER)
    found, proof = broken(edited({line: "G1 X1 X2"}), "firmware")
    assert found.line == line and "a word stands twice" in found.text and "G1 X1 X2" in found.text
    assert found.help == "Leave one of the two."
    assert proof.lines_executed < proof.lines


def test_line_longer_than_the_firmware_takes_is_told_by_how_much() -> None:
    line, more = line_of("G90", LAYER), 300
    text = f"N{line} G90 ({'x' * more})"
    found, proof = broken(edited({line: text.split(" ", 1)[1]}), "line length")
    most = CELL.cnc.line_length_max
    assert found.line == line and f"{len(text)} characters" in found.text and f"{len(text) - most} too many" in found.text
    assert max(len(reason) for reason in proof.reasons) < 250


def test_travel_beyond_an_axis_is_told_by_axis_distance_and_the_place_it_would_have_gone_to() -> None:
    beyond = CELL.axis("X").max + 40.0

    def drive(w: Writer) -> int:
        return w.line(f"G1 X{beyond:g} F60", LineKind.LINK, 1.0)

    program, line = faced(drive)
    proof = prove_faced(program)
    found = the(proof, "travel")
    assert not proof.passed and (found.line, found.operation) == (line, 1)
    assert [each.kind for each in proof.findings] == ["travel"]
    assert found.text.startswith("X would have to go") and found.depth_mm == pytest.approx(40.0, abs=1e-3)
    assert at(found) == pytest.approx((beyond, -PASS_Y, SAFE_MM), abs=1e-3)


def in_the_cut(found: Finding, x: float) -> None:
    """The place lies in the metal that a pass along y at x takes."""
    px, py, pz = at(found)
    assert abs(px - x) <= RADIUS_MM and abs(py) <= HALF_Y and TOP_MM - 3.0 * CELL_MM <= pz <= RAW_MM + 3.0 * CELL_MM
    assert found.depth_mm == pytest.approx(RAW_MM - TOP_MM, abs=0.1 * CELL_MM)


def test_cutter_that_meets_metal_with_its_spindle_standing_is_told_on_a_pass() -> None:
    program, _ = faced(spindle=False)
    proof = prove_faced(program)
    found = the(proof, "spindle off")
    assert not proof.passed and program.table["kind"][found.line - 1] == LineKind.PROCESS and found.operation == 0
    in_the_cut(found, program.table["tip_end"][found.line - 1][0])


def test_rapid_through_metal_is_told_on_its_line() -> None:
    program, line = faced(rapid=True)
    proof = prove_faced(program)
    found = the(proof, "rapid in metal")
    assert not proof.passed and (found.line, found.operation) == (line, 0)
    in_the_cut(found, PASSES_X[2])


def test_feed_that_an_axis_cannot_follow_is_told_by_its_letter() -> None:
    axes = tuple(axis.model_copy(update={"max_velocity": 0.5 * FEED_MM_S}) if axis.letter == "X" else axis for axis in CELL.axes)
    proof = prove_beads(beads(), CELL.model_copy(update={"axes": axes}))
    found = [each for each in proof.findings if each.kind == "speed"]
    assert not proof.passed and found and all("axis X would have to move 2.00 times" in each.text and each.help for each in found)
