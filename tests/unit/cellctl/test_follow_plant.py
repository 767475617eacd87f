"""The follower beside the simulated control: arc length between reports, on what posts really write."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cellctl.domain.profile import SpeedProfile, make_chunk
from cellctl.domain.ramp import Ramp
from cellctl.domain.sync import Follower, MotionLimits, Timeline
from config.cell import Cell, load_cell
from planner.plan import Operation
from planner.post import post
from planner.program import LineKind, Program
from tests.bench.following import Ride, changed, timeline_of
from tests.unit.planner.hand_plan import contour_operation, fill_operation, oval_operation, plan_of

ALLOWED_MM = 0.1  # of arc length between reports, the bound at 20 mm/s
EXACT_MM = 0.01  # where the control moves as predicted
CELL = load_cell("trunnion_tcp")


def posted(*operations: Operation, cell: Cell = CELL) -> Program:
    return post(plan_of(list(operations)), cell)


PROGRAM = posted(contour_operation(0, interpass_s=1.5), oval_operation(0), fill_operation(1), contour_operation(2))


def worst_mm(ride: Ride, kinds: tuple[LineKind, ...] = (LineKind.PROCESS,), after_s: float = 0.0) -> float:
    """Largest error on lines of some kinds at process speeds, as at 20 mm/s."""
    kind = ride.program.table["kind"][[line for _, line, _ in ride.where]]
    chosen = np.isin(kind, kinds) & (np.array([at for at, *_ in ride.where]) >= after_s)
    assert chosen.sum() > 150
    speeds = np.array(ride.speeds)[chosen]
    return float(np.abs(np.array(ride.errors_mm))[chosen].max() * 20.0 / max(np.median(speeds), 1.0))


def ridden(seconds: float = 36.0, *, acceleration: float = 1.0, deviation: float = 1.0, program: Program = PROGRAM, **how: Any) -> Ride:
    ride = Ride(program, changed(CELL, acceleration=acceleration, deviation=deviation), CELL, every=6, **how)
    ride.run(seconds)
    return ride


def test_arc_length_is_known_between_reports_on_arcs_corners_short_lines_and_behind_dwells() -> None:
    ride = ridden()
    assert ride.follower.source == "Ln"
    assert worst_mm(ride) < EXACT_MM
    assert max(np.array(ride.tips_mm)[np.array(ride.speeds) < 30.0][200:]) < EXACT_MM


def test_without_line_numbers_the_place_comes_from_the_position_and_the_follower_says_so() -> None:
    ride = ridden(24.0, with_lines=False)
    assert ride.follower.source == "position"
    assert worst_mm(ride) < EXACT_MM


@pytest.mark.parametrize(("acceleration", "deviation"), [(0.7, 0.5)])
def test_a_control_that_accelerates_otherwise_is_followed_by_its_own_settings(acceleration: float, deviation: float) -> None:
    assert worst_mm(ridden(24.0, acceleration=acceleration, deviation=deviation, is_known=True)) < EXACT_MM


def test_a_control_that_accelerates_otherwise_is_learnt() -> None:
    ride = ridden(acceleration=0.5)
    assert ride.follower.pace.agility == pytest.approx(0.5, rel=0.1)
    assert worst_mm(ride, after_s=20.0) < ALLOWED_MM


def test_a_commanded_override_is_followed_at_once() -> None:
    assert worst_mm(ridden(24.0, overrides=((5.0, 50), (11.0, 130), (16.0, 90)))) < ALLOWED_MM


def test_an_override_from_another_hand_is_known_with_the_next_report() -> None:
    ride = ridden(24.0, overrides=((5.0, 50), (12.0, 130)), tells_override=False)
    late = {
        round(at - max(change for change in (0.0, 5.0, 12.0) if change <= at), 3)
        for (at, line, _), error in zip(ride.where, ride.errors_mm, strict=True)
        if abs(error) > ALLOWED_MM and PROGRAM.table["kind"][line] == LineKind.PROCESS
    }
    assert max(late) < 0.31  # two reports: in the next one WCO may stand in its place


def test_a_hold_and_the_resume_behind_it_are_followed() -> None:
    assert worst_mm(ridden(24.0, holds=((6.0, 0.5), (12.0, 1.0)))) < ALLOWED_MM


def test_unsure_time_stamps_are_evened_out() -> None:
    rough = 0.5 * 0.01 * 12.0  # mm: what half of the spread is at the speed of the passes
    ride = ridden(24.0, jitter_s=0.01)
    kind = PROGRAM.table["kind"][[line for _, line, _ in ride.where]]
    errors = np.abs(np.array(ride.errors_mm))[kind == LineKind.PROCESS]
    assert np.median(errors) < 0.4 * rough and errors.max() < 1.3 * rough


def test_the_predicted_speeds_within_lines_add_up_to_the_times_of_the_table() -> None:
    timeline = timeline_of(PROGRAM, CELL, None)
    chunk = make_chunk(timeline, 0, len(timeline), 1.0)
    lasting = timeline.time_end_s - timeline.time_start_s
    assert np.abs(np.diff(chunk.tau) - lasting).max() < 2e-3
    rest = CELL.axes[0].max_acceleration * 2.0  # corners may ask several axes at once
    assert max(a for a, length in zip(chunk.acceleration, chunk.length, strict=True) if length > 0) < rest


def test_place_and_time_on_the_profile_are_inverse() -> None:
    timeline = timeline_of(PROGRAM, CELL, None)
    profile = SpeedProfile(timeline)
    profile.override = 0.7
    here = (0, 0.0)
    for _ in range(400):
        there = profile.advance(here, 0.037)
        assert there >= here
        if there < (len(timeline) - 1, 1.0):
            assert profile.between(here, there) == pytest.approx(0.037, abs=1e-9)
        here = there


@pytest.mark.parametrize("ramp", [Ramp(0.0, 20.0, 500.0), Ramp(20.0, 10.0, 800.0), Ramp(5.0, 20.0, 100.0)])
def test_a_ramp_is_its_own_inverse_and_ends_at_the_speed_of_the_profile(ramp: Ramp) -> None:
    for seconds in (0.001, 0.01, 0.05, 0.3):
        assert ramp.needed_s(ramp.passed_s(seconds)) == pytest.approx(seconds, abs=1e-9)
    assert ramp.passed_s(1.001) - ramp.passed_s(1.0) == pytest.approx(0.001)


def test_a_braking_machine_stops_after_its_way() -> None:
    ramp = Ramp(20.0, 20.0, 500.0, stops=True)
    assert ramp.passed_s(10.0) * 20.0 == pytest.approx(20.0**2 / (2 * 500.0))
    assert ramp.needed_s(1.0) == math.inf


def loops(turns: int, pieces: int = 40, radius: float = 10.0, speed: float = 20.0) -> Timeline:
    """A circle that is run through several times at the same place, in `pieces` straight lines a turn."""
    turn = 2.0 * np.pi * np.arange(turns * pieces + 1) / pieces
    tip = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.zeros(len(turn))])
    steps = np.append(0.0, np.linalg.norm(np.diff(tip, axis=0), axis=1))
    times = np.cumsum(steps) / speed
    joints = np.column_stack([tip, np.zeros((len(turn), 2))])
    axis = np.tile([0.0, 0.0, 1.0], (len(turn), 1))
    emitting = np.ones(len(turn), dtype=np.bool_)
    limits = MotionLimits(np.full(5, 1e5), 0.05)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    return Timeline(times - steps / speed, times, arc, tip, axis, joints, emitting, limits=limits)


def test_a_place_that_is_passed_many_times_is_taken_for_the_turn_that_it_is() -> None:
    timeline = loops(6)
    follower = Follower(timeline, 0.1)
    end = float(timeline.time_end_s[-1])
    for at in np.arange(0.0, end - 0.2, 0.1):
        line = timeline.line_at(at)
        share = (at - timeline.time_start_s[line]) / max(timeline.time_end_s[line] - timeline.time_start_s[line], 1e-9)
        place = timeline.joints_end[max(line - 1, 0)] + share * (timeline.joints_end[line] - timeline.joints_end[max(line - 1, 0)])
        follower.report(len(timeline) - 1, np.round(place, 3), float(at), is_run=True, feed=1200.0, is_line_told=False)
        ahead = at + 0.09
        assert follower.predicted_arc(ahead) == pytest.approx(ahead * 20.0, abs=ALLOWED_MM) or at < 0.25
    assert follower.last is not None and follower.last.line > 5 * 40
    assert follower.error_mm < ALLOWED_MM


def test_when_a_line_begins_is_told_as_the_inverse_of_the_place() -> None:
    timeline = loops(2)
    follower = Follower(timeline, 0.1)
    for k in range(12):
        line = timeline.line_at(0.1 * k)
        share = (0.1 * k - timeline.time_start_s[line]) / max(timeline.time_end_s[line] - timeline.time_start_s[line], 1e-9)
        place = timeline.joints_end[max(line - 1, 0)] + share * (timeline.joints_end[line] - timeline.joints_end[max(line - 1, 0)])
        follower.report(line, place, 50.0 + 0.1 * k, is_run=True, feed=1200.0)
    for ahead in (1, 2, 30, 60):
        at = follower.time_of_line(line + ahead)
        assert at == pytest.approx(50.0 + timeline.time_start_s[line + ahead], abs=1e-3)
    follower.report(line, place, 51.2, is_run=False, feed=0.0)
    assert follower.time_of_line(line + 5) == math.inf


def test_a_prediction_never_leaves_the_program_and_no_program_gives_none() -> None:
    timeline = loops(1)
    follower = Follower(timeline, 0.1)
    last = len(timeline) - 1
    for k in range(3):
        follower.report(last, timeline.joints_end[last], 0.1 * k, is_run=True, feed=1.0)
    assert follower.predicted_place(0.35)[0] == last
    empty = Follower(replace(timeline, **{name: getattr(timeline, name)[:0] for name in ("time_start_s", "time_end_s", "joints_end")}), 0.1)
    empty.report(0, np.zeros(5), 0.0, is_run=True, feed=0.0)
    assert empty.predicted_arc(1.0) == 0.0 and empty.time_of_line(3) == math.inf


def test_a_machine_that_stands_in_the_middle_of_the_way_before_the_start_is_not_taken_to_be_there() -> None:
    timeline = loops(3)
    follower = Follower(timeline, 0.1)
    for k in range(5):
        follower.report(len(timeline) - 1, timeline.joints_end[20], 0.1 * k, is_run=False, feed=0.0, is_line_told=False)
    assert follower.last is not None and follower.last.line < 12
    follower.report(2, timeline.joints_end[2], 0.6, is_run=True, feed=1200.0)
    assert follower.last.place == (2, 1.0)
