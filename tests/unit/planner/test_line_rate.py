"""Blocks as long as the control and its serial line take them."""

from __future__ import annotations

import numpy as np
import pytest

from config.cell import load_cell
from planner.post import post_with_report
from planner.post.line_rate import HELD_BLOCKS, LINE_SHARE, LineRate
from planner.program import LineKind
from tests.unit.planner.hand_plan import cone_operation, contour_operation, plan_of


def test_lines_are_counted_with_hardly_more_bytes_than_they_have() -> None:
    cell = load_cell("trunnion_tcp")
    lines = cell.model_copy(update={"cnc": cell.cnc.model_copy(update={"takes_arcs": False})})
    program, _ = post_with_report(plan_of([contour_operation(0), cone_operation(0)]), lines)
    rate = LineRate.of(cell)
    joints = program.table["joints_end"]
    told = rate.line_bytes(joints, program.table["bulge"][1:])
    rows = np.flatnonzero(
        (program.table["kind"][1:] == LineKind.PROCESS) & np.any(np.diff(joints, axis=0) != 0.0, axis=1)
    )
    real = np.array([len(program.lines[row + 1]) + 1 for row in rows])
    modal = np.array([sum(map(len, ("G93", "G94", "G1", "F1234.5")))])
    assert np.all(told[rows] + modal >= real) and told[rows].sum() <= 1.4 * real.sum()


def test_a_slow_line_lengthens_blocks_until_it_carries_their_bytes_but_for_what_the_control_holds() -> None:
    cell = load_cell("trunnion_tcp")
    slow = cell.model_copy(update={"cnc": cell.cnc.model_copy(update={"baud": 9600, "max_blocks_per_s": 1000.0})})
    rate = LineRate.of(slow)
    steps = np.zeros((400, 5))
    steps[1:] = [0.05, 0.03, 0.0, 0.02, 0.01]
    joints, bulge = np.cumsum(steps, axis=0), np.zeros(399)
    times = np.full(399, 0.005)
    least = np.maximum(rate.least_times(joints, bulge, times), times)
    need = rate.line_bytes(joints, bulge) / (LINE_SHARE * 960.0)
    assert np.all(least[:HELD_BLOCKS] == times[:HELD_BLOCKS])
    for begin in (0, 50, 200):
        behind = need[begin:].sum() - least[begin:].sum()
        assert behind <= need[-HELD_BLOCKS:].sum() * 1.1
    assert least.sum() == pytest.approx(need.sum() - need[-HELD_BLOCKS:].sum(), rel=0.02)


def test_a_fast_line_leaves_blocks_as_they_are_but_for_the_controls_rate() -> None:
    rate = LineRate.of(load_cell("trunnion_tcp"))
    joints = np.cumsum(np.full((50, 5), 0.1), axis=0)
    times = np.full(49, 0.02)
    times[7] = 0.001
    assert np.allclose(rate.least_times(joints, np.zeros(49), times), 1.0 / 400.0)
    assert np.flatnonzero(rate.slow(times, rate.least_times(joints, np.zeros(49), times))).tolist() == [7]


def test_the_report_says_where_the_line_slows_a_pass() -> None:
    cell = load_cell("trunnion_tcp")
    slow = cell.model_copy(update={"cnc": cell.cnc.model_copy(update={"max_blocks_per_s": 8.0, "takes_arcs": False})})
    _, report = post_with_report(plan_of([contour_operation(0)]), slow)
    assert any("most of all pass 1 of operation 0" in line for line in report.findings)
