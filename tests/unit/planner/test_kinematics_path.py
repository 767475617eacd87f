"""Branch, turn and lean of a whole operation as one shortest path: against brute force, at the pole, at the ends of the travel."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from config.cell import load_cell
from planner.kinematics.chain import Chain, Floats
from planner.kinematics.inverse import RotaryPair, rotary_angles
from planner.kinematics.limits import travel
from planner.kinematics.rotary_travel import followed_axes, pointwise_joints, rotary_travel_deg
from planner.kinematics.shortest import Lattice, shortest_way

LOW, HIGH, SPEED = np.array([-110.0, -400.0]), np.array([110.0, 400.0]), np.array([90.0, 180.0])
NONE = np.zeros(2)


def lattice(angles: Floats, *, unwinds: tuple[int, ...] = (0,)) -> Lattice:
    may = np.isin(np.arange(len(angles)), unwinds)
    return Lattice.of_branches(angles, np.zeros(angles.shape[:2]), may)


def through_pole(tilt: Floats) -> Floats:
    """Both branches of a tilt that changes its sense while the spin stands."""
    spin = np.where(tilt > 0.0, 0.0, 180.0)
    return np.stack([np.column_stack([np.abs(tilt), spin]), np.column_stack([-np.abs(tilt), 180.0 - spin])], axis=1)


def test_the_way_goes_straight_through_the_pole_instead_of_turning_by_half_a_turn() -> None:
    tilt = np.array([5.0, 1.0, -1.0, -5.0])
    way = shortest_way(lattice(through_pole(tilt)), NONE, LOW, HIGH, SPEED)
    assert way.angles[:, 0].tolist() == tilt.tolist() and np.all(way.angles[:, 1] == 0.0) and way.inside


def test_a_branch_outside_the_travel_is_left_for_the_other_one() -> None:
    angles = np.array([[[10.0, 0.0], [-10.0, 180.0]]] * 3)
    way = shortest_way(lattice(angles), NONE, np.array([-110.0, -400.0]), np.array([5.0, 400.0]), SPEED)
    assert way.chosen.tolist() == [1, 1, 1]


def test_one_pose_that_no_candidate_has_is_told_as_such() -> None:
    single = lattice(np.array([[[10.0, 0.0], [-10.0, 180.0]]]))
    nowhere = replace(single, cost=np.full((1, 2), np.inf))
    assert not np.isfinite(shortest_way(nowhere, NONE, LOW, HIGH, SPEED).cost)
    outside = shortest_way(single, NONE, np.array([20.0, -400.0]), np.array([30.0, 400.0]), SPEED)
    assert not outside.inside


def test_the_choice_looks_ahead_to_the_end_of_the_operation() -> None:
    # The near branch first would wind the spin out of its travel at the end; only the far one holds all of the way.
    spin = np.linspace(0.0, 700.0, 36)
    wrapped = spin - 360.0 * np.round(spin / 360.0)
    other = wrapped + 180.0
    other -= 360.0 * np.round(other / 360.0)
    angles = np.stack([np.column_stack([np.full(36, 20.0), wrapped]), np.column_stack([np.full(36, -20.0), other])], axis=1)
    way = shortest_way(lattice(angles), NONE, LOW, HIGH, SPEED)
    assert way.inside and np.ptp(way.angles[:, 1]) == pytest.approx(700.0)
    assert np.abs(np.diff(way.angles[:, 1])).max() < 21.0


def test_the_spin_unwinds_where_the_tool_is_off_the_part_and_nowhere_else() -> None:
    spin = np.linspace(0.0, 1200.0, 61)
    wrapped = spin - 360.0 * np.round(spin / 360.0)
    angles = np.stack([np.column_stack([np.full(61, 20.0), wrapped])] * 2, axis=1)
    way = shortest_way(lattice(angles, unwinds=(0, 20, 40)), NONE, LOW, HIGH, SPEED)
    leaps = np.flatnonzero(np.abs(np.diff(way.angles[:, 1])) > 180.0) + 1
    assert way.inside and leaps.size and set(leaps.tolist()) <= {20, 40}


def test_what_no_turn_holds_is_told_as_outside() -> None:
    spin = np.linspace(0.0, 1200.0, 61)
    wrapped = spin - 360.0 * np.round(spin / 360.0)
    angles = np.stack([np.column_stack([np.full(61, 20.0), wrapped])] * 2, axis=1)
    way = shortest_way(lattice(angles), NONE, LOW, HIGH, SPEED)
    assert not way.inside and np.abs(np.diff(way.angles[:, 1])).max() < 21.0


def test_the_way_is_as_cheap_as_the_best_of_all_ways() -> None:
    draw = np.random.default_rng(3)
    low, high = np.array([-170.0, -170.0]), np.array([170.0, 170.0])
    for _ in range(20):
        angles = draw.uniform(-60.0, 60.0, (5, 3, 2))
        cost = draw.uniform(0.0, 1.0, (5, 3))
        lean = draw.uniform(-5.0, 5.0, (5, 3, 2))
        made = Lattice(angles, cost, np.zeros(5, dtype=np.bool_), lean, np.full(5, 7.0), 0.01)
        best = np.inf
        for picks in itertools.product(range(3), repeat=5):
            here, total = NONE, 0.0
            for i, k in enumerate(picks):
                swing = np.hypot(*(lean[i, k] - lean[i - 1, picks[i - 1]])) if i else 0.0
                step = angles[i, k] - here
                leap = 20.0 * float((step**2).sum()) / 180.0**2 if i else 0.0
                total += np.inf if swing > 7.0 else np.abs(step) @ (1.0 / SPEED) + cost[i, k] + 0.01 * swing**2 + leap
                here = angles[i, k]
            best = min(best, total)
        way = shortest_way(made, NONE, low, high, SPEED)
        assert way.cost == pytest.approx(best) if np.isfinite(best) else not np.isfinite(way.cost)


@pytest.mark.parametrize("name", ["trunnion_tcp", "head_head", "head_table"])
def test_the_whole_way_turns_less_than_an_inverse_that_looks_at_one_point_after_the_other(name: str) -> None:
    # To and fro beside the pole, then straight through it, as hatches on a dome go.
    cell = load_cell(name)
    chain = Chain.from_cell(cell)
    pair = RotaryPair.of(chain)
    x = np.tile(np.concatenate([np.linspace(-0.3, 0.3, 41), np.linspace(0.3, -0.3, 41)]), 3)
    axes = np.column_stack([x, np.repeat([1e-4, -1e-4, 0.02], 82), np.zeros(246)])
    axes[:, 2] = np.sqrt(1.0 - (axes**2).sum(axis=1))
    start = np.zeros(5)
    point = rotary_travel_deg(chain, pointwise_joints(chain, axes, start))
    columns = list(pair.columns)
    low, high = (side[columns] for side in travel(cell.axes))
    speed = np.array([cell.axes[column].max_velocity for column in columns])
    way = shortest_way(lattice(rotary_angles(pair, axes).angles), NONE, low, high, speed)
    joints = np.zeros((len(axes), 5))
    joints[:, columns] = way.angles
    assert way.inside and np.abs(chain.forward(joints, np.zeros(3))[1] - axes).max() < 1e-12
    assert rotary_travel_deg(chain, joints) <= point + 1e-9


def test_one_move_of_a_whole_turn_is_a_whole_turn_for_the_inverse_that_looks_point_by_point_too() -> None:
    # A ring round the table's axis with the head at 30 degrees is one block of C; a turn back in the air need not be followed.
    chain = Chain.from_cell(load_cell("trunnion_tcp"))
    joints = np.array([[0.0, 0.0, 0.0, 30.0, c] for c in (0.0, 400.0, 100.0, 280.0)])
    axes = followed_axes(chain, joints, np.array([True, False, True]))
    point = pointwise_joints(chain, axes, joints[0])
    assert rotary_travel_deg(chain, point) == pytest.approx(400.0 + 60.0 + 180.0)
    assert np.abs(chain.forward(point, np.zeros(3))[1] - axes).max() < 1e-12
