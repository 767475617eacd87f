"""Projection of reports on the Program, prediction between them, and the judgement of motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cellctl.cell.arc_ways import bows, plane_of
from cellctl.cell.stream import gate_of_lines
from cellctl.domain.arcs import fraction_of_arc
from cellctl.domain.sync import Follower, MotionJudge, Timeline
from config.cell import load_cell
from planner.kinematics.chain import Chain
from planner.post import post
from tests.unit.planner.hand_plan import contour_operation, plan_of

SPEED = 10.0  # mm/s
LINES = 10
LENGTH = 4.0


def straight(emitting: bool = True) -> Timeline:
    """LINES pieces of LENGTH mm along x at SPEED; the first line brings the tip to x = 0."""
    ends = np.arange(LINES) * LENGTH
    tip = np.stack([ends, np.zeros(LINES), np.zeros(LINES)], axis=1)
    joints = np.concatenate([tip + 100.0, np.zeros((LINES, 2))], axis=1)
    times = ends / SPEED
    starts = np.concatenate([[0.0], times[:-1]])
    arc = np.concatenate([[0.0, 0.0], ends[1:]])
    axis = np.tile([0.0, 0.0, 1.0], (LINES, 1))
    return Timeline(starts, times, arc, tip, axis, joints, np.full(LINES, emitting))


def at(x: float) -> np.ndarray:
    return np.array([x + 100.0, 100.0, 100.0, 0.0, 0.0])


def line_of(x: float) -> int:
    return int(np.ceil(x / LENGTH))


@pytest.mark.parametrize("x", [0.5, 3.99, 4.01, 17.3, 35.9])
def test_a_reported_position_is_projected_on_time_arc_and_tip(x: float) -> None:
    timeline = straight()
    fraction = timeline.fraction(line_of(x), at(x))
    assert timeline.time_at(line_of(x), fraction) == pytest.approx(x / SPEED)
    assert timeline.arc_at(line_of(x), fraction) == pytest.approx(x)
    assert timeline.tip_at(line_of(x), fraction)[0] == pytest.approx([x, 0.0, 0.0])
    assert timeline.line_at(x / SPEED) == line_of(x)


@pytest.mark.parametrize("scale", [0.5, 1.0, 20.0])
def test_between_reports_the_place_is_predicted_at_the_measured_rate(scale: float) -> None:
    follower = Follower(straight(), 0.1)
    step = 0.01 / scale * 10  # so that ten reports stay on the path
    for k in range(9):
        x = SPEED * scale * step * k + 0.1
        follower.report(line_of(x), at(x), k * step, is_run=True, feed=600.0)
    ahead = follower.predicted_time(8 * step + step / 2) * SPEED
    assert ahead == pytest.approx(0.1 + SPEED * scale * step * 8.5, abs=0.1 + 0.02 * scale * step * SPEED)
    assert follower.speed_mm_s == pytest.approx(SPEED * scale, rel=1e-6)


def test_prediction_does_not_run_on_when_reports_stay_away_or_the_machine_stands() -> None:
    follower = Follower(straight(), 0.1)
    follower.report(1, at(1.0), 0.0, is_run=True, feed=600.0)
    follower.report(1, at(2.0), 0.1, is_run=True, feed=600.0)
    assert follower.predicted_time(60.0) <= 0.2 + 0.2 * follower.rate + 1e-9
    follower.report(1, at(2.0), 0.2, is_run=False, feed=0.0)
    assert follower.predicted_time(60.0) == pytest.approx(0.2)


def judged(xs: list[float], *, is_run: bool = True, feed: float = 600.0, emitting: bool = True) -> MotionJudge:
    follower = Follower(straight(emitting), 0.1)
    judge = MotionJudge(0.5, 0.25)
    for k, x in enumerate(xs):
        follower.report(line_of(x), at(x), 0.1 * k, is_run=is_run, feed=feed)
        judge.report(follower)
    return judge


def test_a_tip_that_advances_between_reports_moves() -> None:
    assert judged([1.0, 2.0]).is_moving(0.1)


@pytest.mark.parametrize(
    "judge",
    [
        judged([1.0]),
        judged([1.0, 1.0]),
        judged([1.0, 1.02]),
        judged([1.0, 2.0], is_run=False),
        judged([1.0, 2.0], feed=0.0),
    ],
)
def test_standstill_creeping_no_run_or_no_feed_is_no_motion_and_says_why(judge: MotionJudge) -> None:
    assert not judge.is_moving(0.2)
    assert judge.why


def test_expected_motion_ends_by_itself_and_at_once_on_standstill() -> None:
    judge = MotionJudge(0.5, 0.25)
    judge.expect(10.0)
    assert judge.is_moving(10.2)
    assert not judge.is_moving(10.26)
    judge.expect(11.0)
    judge.standstill("held")
    assert not judge.is_moving(11.0)


@pytest.mark.parametrize("name", ["trunnion_tcp", "head_head"])
def test_joints_reported_anywhere_on_an_arc_give_its_length_and_the_tip_there(name: str) -> None:
    cell = load_cell(name)
    program = post(plan_of([contour_operation(0)]), cell)
    timeline = Timeline.from_table(program.table, gate_of_lines(program), bows(program, cell), plane_of(program))
    arcs = np.flatnonzero(program.table["bulge"])
    assert len(arcs) >= 2 and np.abs(program.table["bulge"]).max() > 0.5
    chain, tool = Chain.from_cell(cell), np.array(cell.tools[0].tip_mm)
    turn = program.machine_from_build
    for line in arcs:
        start, end = program.table["joints_end"][line - 1], program.table["joints_end"][line]
        sweep = 4.0 * np.arctan(program.table["bulge"][line])
        chord = complex(*(end - start)[:2])
        centre = complex(*start[:2]) + chord / (1.0 - np.exp(1j * sweep))
        length = abs(sweep) * abs(complex(*start[:2]) - centre)
        for share in (0.0, 1e-4, 0.21, 0.5, 0.77, 1.0):
            here = centre + (complex(*start[:2]) - centre) * np.exp(1j * sweep * share)
            joints = np.concatenate([[here.real, here.imag], start[2:]])
            fraction = timeline.fraction(int(line), joints)
            assert timeline.arc_at(int(line), fraction) - timeline.arc_mm[line] == pytest.approx(
                share * length, abs=1e-6
            )
            tip = chain.forward(joints[None], tool)[0][0]
            build = np.linalg.inv(turn) @ np.append(tip, 1.0)
            assert timeline.tip_at(int(line), fraction)[0] == pytest.approx(build[:3], abs=1e-6)


def test_a_place_beside_a_half_circle_is_behind_its_start_or_beyond_its_end() -> None:
    start, end = np.array([1.0, 0.0]), np.array([-1.0, 0.0])
    assert fraction_of_arc(start, end, 1.0, np.array([1.0, -0.01])) == 0.0
    assert fraction_of_arc(start, end, 1.0, np.array([-1.0, -0.01])) == 1.0
    assert fraction_of_arc(start, end, -1.0, np.array([0.0, -2.0])) == pytest.approx(0.5)


def test_words_in_a_comment_open_no_gate() -> None:
    given = post(plan_of([contour_operation(0)]), load_cell("trunnion_tcp"))
    gate = gate_of_lines(given)
    dark = int(np.flatnonzero(~gate)[0])
    lines = list(given.lines)
    lines[dark] = f"N{dark + 1} (part M62 P0 T2)"
    assert np.array_equal(gate_of_lines(replace(given, lines=tuple(lines))), gate)
