"""Predicted times against the kinematic equations."""

from __future__ import annotations

import numpy as np
import pytest

from planner.kinematics.timing import arc_pieces, axis_limited_times, predicted_times

ACCELERATION = np.array([1000.0, 1000.0, 1000.0, 400.0, 400.0])


def along_x(*lengths: float) -> np.ndarray:
    return np.array([[length, 0.0, 0.0, 0.0, 0.0] for length in lengths])


def times_of(moves: np.ndarray, nominal: list[float], stops: list[bool] | None = None) -> np.ndarray:
    return predicted_times(moves, np.array(nominal), np.array(stops or [False] * len(nominal)), ACCELERATION)


def test_one_move_from_rest_to_rest_takes_the_time_of_its_trapezoid() -> None:
    # 100 mm at 100 mm/s and 1000 mm/s2: way over speed plus speed over acceleration.
    assert np.isclose(times_of(along_x(100.0), [1.0])[0], 1.0 + 0.1)


def test_a_short_move_that_never_reaches_its_speed_is_a_triangle() -> None:
    assert np.isclose(times_of(along_x(1.0), [0.001])[0], 2.0 * np.sqrt(1.0 / 1000.0))


def test_a_straight_way_in_many_moves_takes_as_long_as_in_one() -> None:
    assert np.isclose(times_of(along_x(*[1.0] * 100), [0.01] * 100).sum(), 1.1)


def test_a_halt_between_two_moves_costs_a_second_start() -> None:
    assert np.isclose(times_of(along_x(50.0, 50.0), [0.5, 0.5], [False, True]).sum(), 1.2)


def test_turning_back_is_a_halt() -> None:
    assert np.isclose(times_of(along_x(50.0, -50.0), [0.5, 0.5]).sum(), 1.2)


def test_a_right_angle_is_passed_at_the_speed_that_junction_deviation_allows() -> None:
    moves = np.array([[100.0, 0.0, 0.0, 0.0, 0.0], [0.0, 100.0, 0.0, 0.0, 0.0]])
    half_sine = np.sqrt(0.5)
    corner = np.sqrt(1000.0 * np.sqrt(2.0) * 0.01 * half_sine / (1.0 - half_sine))
    each = 1.0 + 0.05 + (100.0 - corner) ** 2 / (2.0 * 1000.0 * 100.0)
    assert np.isclose(times_of(moves, [1.0, 1.0]).sum(), 2.0 * each)


def test_lines_without_motion_keep_their_own_time() -> None:
    assert times_of(np.zeros((2, 5)), [0.0, 2.5]).tolist() == [0.0, 2.5]


def test_no_axis_is_asked_for_more_than_its_velocity() -> None:
    moves = np.array([[1.0, 0.0, 0.0, 45.0, 0.0], [10.0, 0.0, 0.0, 0.0, 0.0]])
    limits = np.array([250.0, 250.0, 200.0, 90.0, 180.0])
    assert axis_limited_times(moves, np.array([0.1, 1.0]), limits).tolist() == [0.5, 1.0]


def test_an_output_between_two_moves_does_not_stop_the_machine() -> None:
    moves = np.vstack([along_x(50.0), np.zeros((1, 5)), along_x(50.0)])
    assert np.isclose(times_of(moves, [0.5, 0.0, 0.5]).sum(), 1.1)


def test_chords_of_an_arc_lie_on_its_circle_within_the_tolerance_and_end_where_it_ends() -> None:
    radius, sweep = 10.0, np.deg2rad(150.0)
    end = radius * np.array([np.sin(sweep), 1.0 - np.cos(sweep)])  # from the origin, heading along x, about (0, 10)
    move = np.array([[*end, 3.0, 0.0, 0.0]])
    pieces, line = arc_pieces(move, np.array([np.tan(sweep / 4.0)]), (0, 1), 0.003)
    places = np.vstack([np.zeros(5), np.cumsum(pieces, axis=0)])
    assert np.allclose(places[-1], move[0]) and not line.any()
    assert np.allclose(np.hypot(places[:, 0], places[:, 1] - radius), radius)
    middle = 0.5 * (places[1:] + places[:-1])
    assert radius - np.hypot(middle[:, 0], middle[:, 1] - radius).min() == pytest.approx(0.003, rel=0.05)
    assert np.allclose(np.diff(places[:, 2]), places[1, 2])


def test_an_arc_takes_the_time_of_its_way_and_of_starting_and_stopping() -> None:
    radius, sweep, speed = 20.0, np.pi, 12.0
    move, way = np.array([[0.0, 2.0 * radius, 0.0, 0.0, 0.0]]), radius * sweep
    times = predicted_times(
        move, np.array([way / speed]), np.array([False]), ACCELERATION, bulge=np.array([np.tan(sweep / 4.0)])
    )
    assert np.isclose(times.sum(), way / speed + speed / 1000.0, rtol=1e-3)
