"""LinuxCNC programs: tolerance shared with the control, gate and power in the stream, NURBS where they are shorter."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial import KDTree

from config.cell import Cell, load_cell
from planner.errors import PostError
from planner.nurbs.curve import Curve
from planner.plan import Pass, Plan, Process
from planner.post import linuxcnc, post, post_with_report
from planner.post.reread import check, read, verify
from planner.program import Channel, Program
from tests.unit.planner.hand_plan import (
    FEED_MM_S,
    LASER_W,
    RADIUS_MM,
    UP,
    cone_operation,
    contour_operation,
    fill_operation,
    hybrid_plan,
    link,
    oval,
    oval_operation,
    plan_of,
)


@cache
def cell() -> Cell:
    return load_cell("trunnion_tcp")


@cache
def posted() -> Program:
    return post(ovals(), cell(), dialect="linuxcnc")


@cache
def ovals() -> Plan:
    return plan_of([oval_operation(0), fill_operation(0)], [oval_operation(1)])


def size(program: Program) -> int:
    return sum(len(line) + 1 for line in program.lines)


def with_pass(tip: Curve) -> Plan:
    operation = fill_operation(0)
    first = tip.evaluate([tip.domain[0]])[0]
    last = tip.evaluate([tip.domain[1]])[0]
    passes = (
        link(first + 6.0 * UP, first),
        Pass(tip, UP, np.array([[0.0, FEED_MM_S, 0.0, 12.0, 15.0]])),
        link(last, last + 6.0 * UP),
    )
    return plan_of([replace(operation, passes=passes)], half_mm=40.0)


@pytest.mark.parametrize("name", ["trunnion_tcp", "trunnion_rtu", "head_head", "head_table"])
def test_moves_and_what_the_control_may_leave_stay_together_within_the_cells_tolerance(name: str) -> None:
    facts = load_cell(name)
    program, report = post_with_report(hybrid_plan(), facts, dialect="linuxcnc")
    said = next(found for line in program.lines if (found := re.search(r"G64 P([\d.]+) Q([\d.]+)", line)))
    assert report.reread.max_tip_mm + float(said[1]) + float(said[2]) <= facts.chord_tolerance_mm
    assert report.reread.max_axis_deg <= facts.axis_tolerance_deg and report.reread.setpoints_ok
    assert program.gate == "stream" and program.cell_sha256 == facts.sha256


def test_a_round_pass_is_a_nurbs_that_lies_on_the_pass_in_few_bytes() -> None:
    reading = read(posted())
    lines = reading.splines.lines
    assert len(reading.splines.points) == 2  # one contour a layer, the leads stay moves
    tips = np.concatenate([reading.at(lines, share)[:, :2] for share in np.linspace(0.0, 1.0, 11)])
    x, y = tips[:, 0] + 60.0, tips[:, 1]  # the head stands 60 mm beside the gauge point
    turn = np.linspace(0.0, 2.0 * np.pi, 20_001)
    there = KDTree(np.column_stack([RADIUS_MM * np.cos(turn), 0.6 * RADIUS_MM * np.sin(turn)]))
    assert there.query(np.column_stack([x, y]))[0].max() < 0.006 + 0.003  # the fit to the pass, the pass to the ellipse
    moves = post(ovals(), cell(), dialect="grblhal")
    assert size(posted()) < size(moves)
    table = posted().table
    own = lines[reading.splines.number == 0]
    assert np.allclose(table["arc_start_mm"][own[1:]], table["arc_end_mm"][own[:-1]])


def test_a_pass_that_is_such_a_nurbs_goes_as_it_is_with_its_weights() -> None:
    half = np.sqrt(0.5)
    poles = np.array([[20.0, 0.0, 0.0], [20.0, 12.0, 0.0], [0.0, 12.0, 0.0]])
    quarter = Curve(2, np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]), poles, np.array([1.0, half, 1.0]))
    program, report = post_with_report(with_pass(quarter), cell(), dialect="linuxcnc")
    text = [line for line in program.lines if "G5.2" in line]
    assert len(text) == 1 and text[0].endswith("X-40Y12P0.707107L3F720")
    reading = read(program)
    assert reading.splines.order == (3,) and np.allclose(reading.splines.weights[0], [1.0, half, 1.0], atol=1e-6)
    assert report.reread.max_tip_mm < 1e-3


def test_corners_and_straight_ways_stay_moves() -> None:
    program = post(plan_of([fill_operation(0)]), cell(), dialect="linuxcnc")
    assert not any("G5.2" in line for line in program.lines)


def test_the_lasers_power_goes_in_the_stream_and_not_by_the_schedule() -> None:
    program = posted()
    assert not np.any(program.schedule["channel"] == Channel.LASER_W)
    watts = [float(found[1]) for line in program.lines if (found := re.search(r" M67 E0 Q([\d.]+)$", line))]
    assert watts[0] == LASER_W
    reading = read(program)
    assert np.nanmax(reading.power_w) == LASER_W
    assert not np.isnan(reading.power_w[reading.gate]).any()


def test_power_that_the_text_says_wrong_is_seen_by_the_reread() -> None:
    lines = tuple(line.replace("Q1200", "Q900") for line in posted().lines)
    report = check(replace(posted(), lines=lines), ovals(), linuxcnc.fitted(cell()))
    assert not report.setpoints_ok
    with pytest.raises(PostError, match="set-points"):
        verify(report, cell())


def test_a_pole_that_the_text_says_wrong_is_seen_by_the_reread() -> None:
    lines = list(posted().lines)
    row = next(k for k, line in enumerate(lines) if "G5.2" in line) + 4
    lines[row] = re.sub(r"X(-?\d+)\.", lambda match: f"X{int(match[1]) + 1}.", lines[row])
    report = check(replace(posted(), lines=tuple(lines)), ovals(), linuxcnc.fitted(cell()))
    assert report.max_tip_mm > 0.1


def test_outputs_of_the_cell_file_are_used_and_told() -> None:
    cnc = cell().cnc.model_copy(update={"laser_gate_output": 2, "power_output": 3})
    plan = plan_of([contour_operation(0)])
    program = post(plan, cell().model_copy(update={"cnc": cnc}), dialect="linuxcnc")
    assert any(line.endswith("(gate M62 M63 P2, power M67 E3 Q in W)") for line in program.lines)
    assert any(" M62 P2" in line for line in program.lines) and any(" M67 E3 Q" in line for line in program.lines)


def test_a_change_of_power_within_a_round_pass_cuts_its_nurbs_there() -> None:
    tip = oval()
    rows = np.array([[0.0, FEED_MM_S, 800.0, 12.0, 15.0], [60.0, FEED_MM_S, 1000.0, 12.0, 15.0]])
    operation = oval_operation(0)
    passes = (operation.passes[0], Pass(tip, UP, rows), operation.passes[2])
    plan = plan_of([replace(operation, process=Process.DEPOSIT_CONTOUR, passes=passes)])
    program, report = post_with_report(plan, cell(), dialect="linuxcnc")
    assert report.reread.setpoints_ok
    reading = read(program)
    change = next(k for k, line in enumerate(program.lines) if "M67 E0 Q1000" in line)
    assert program.table["arc_start_mm"][change + 1] == pytest.approx(60.0, abs=1e-6)
    assert change - 1 in reading.splines.lines


def test_power_is_nought_in_the_stream_before_milling_and_at_the_end() -> None:
    program = post(plan_of([oval_operation(0), cone_operation(0)]), cell(), dialect="linuxcnc")
    said = [line.split(" ", 1)[-1] for line in program.lines]
    change = said.index("M6 T2")
    assert said[change - 1] == "M68 E0 Q0" and "M68 E0 Q0" in said[-3:]
    reading = read(program)
    milled = program.table["operation"] == 1
    assert np.all(reading.power_w[change:][milled[change:]] == 0.0)
