"""Projection of reports on the Program, prediction between them, and the judgement of motion."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.domain.sync import Follower, MotionJudge, Timeline

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


@pytest.mark.parametrize(("override", "factor"), [(1.0, 1.0), (0.5, 0.5), (0.1, 0.3), (2.0, 1.0)])
def test_power_follows_a_reduced_override_between_its_bounds(override: float, factor: float) -> None:
    assert Follower(straight(), 0.1).power_factor(override) == factor
