"""Forward and inverse kinematics of the shipped cells against hand calculation and the simulator's own chain."""

from __future__ import annotations

import numpy as np
import pytest

from config.cell import Cell, load_cell
from planner.errors import PostError, TravelLimitError
from planner.kinematics.chain import Chain
from planner.kinematics.free_spin import filled
from planner.kinematics.inverse import both_branches
from planner.kinematics.limits import check_travel
from sim.cnc.chain import Chain as SimulatedChain

CELLS = ("trunnion_tcp", "head_head", "head_table")


def random_joints(cell: Cell, count: int) -> np.ndarray:
    draw = np.random.default_rng(7)
    low = [max(axis.min, -180.0) if axis.kind == "rotary" else axis.min for axis in cell.axes]
    high = [min(axis.max, 180.0) if axis.kind == "rotary" else axis.max for axis in cell.axes]
    return draw.uniform(low, high, (count, 5))


def test_trunnion_at_zero_puts_the_tip_at_the_tool_offset() -> None:
    cell = load_cell("trunnion_tcp")
    tip, axis = Chain.from_cell(cell).forward(np.array([[10.0, 20.0, -30.0, 0.0, 0.0]]), np.array([0.0, 0.0, -140.0]))
    assert np.allclose(tip, [[10.0, 20.0, -170.0]])
    assert np.allclose(axis, [[0.0, 0.0, 1.0]])


def test_trunnion_tilted_by_90_degrees_shows_the_tool_along_y() -> None:
    # The table turns by +90 about -x: its own +y then points to the machine's -z, so the tool's +z is the table's -y.
    cell = load_cell("trunnion_tcp")
    tip, axis = Chain.from_cell(cell).forward(np.array([[0.0, 0.0, -310.0, 90.0, 0.0]]), np.array([0.0, 0.0, -140.0]))
    assert np.allclose(tip, [[0.0, 0.0, -450.0]], atol=1e-12)
    assert np.allclose(axis, [[0.0, -1.0, 0.0]], atol=1e-12)


@pytest.mark.parametrize("name", CELLS)
def test_forward_kinematics_agrees_with_the_simulators_own_chain(name: str) -> None:
    cell = load_cell(name)
    joints = random_joints(cell, 50)
    theirs = SimulatedChain(cell)
    for tool in cell.tools:
        tip, axis = Chain.from_cell(cell).forward(joints, np.array(tool.tip_mm))
        assert np.abs(tip - theirs.tip_in_table(joints, tool.number)).max() < 1e-9
        assert np.abs(axis - theirs.axis_in_table(joints, tool.number)).max() < 1e-9


@pytest.mark.parametrize("name", CELLS)
def test_both_branches_reach_the_pose_and_one_of_them_is_the_pose_it_came_from(name: str) -> None:
    cell = load_cell(name)
    chain = Chain.from_cell(cell)
    tool = np.array([60.0, 0.0, -160.0])
    joints = random_joints(cell, 400)
    tip, axis = chain.forward(joints, tool)
    found, angles = both_branches(chain, tip, axis, tool)
    assert angles.is_reachable.all()
    for branch in range(2):
        tip_again, axis_again = chain.forward(found[:, branch], tool)
        assert np.abs(tip_again - tip).max() < 1e-9
        assert np.abs(axis_again - axis).max() < 1e-9
    assert np.abs(found - joints[:, None]).max(axis=2).min(axis=1).max() < 1e-6


def test_a_measured_pivot_replaces_the_nominal_one() -> None:
    cell = load_cell("trunnion_tcp")
    moved = cell.placement.model_copy(update={"pivots_mm": {"A": (0.0, 0.2, -450.1)}})
    joints, tool = np.array([[0.0, 0.0, 0.0, 90.0, 0.0]]), np.array([0.0, 0.0, -140.0])
    nominal = Chain.from_cell(cell).forward(joints, tool)[0]
    measured = Chain.from_cell(cell, moved).forward(joints, tool)[0]
    # About -x by -90: (y, z) about the pivot goes to (-z, y); a pivot moved by (a, b) moves the point by (a + b, b - a).
    assert np.allclose(measured - nominal, [[0.0, 0.2 - 0.1, -0.1 - 0.2]], atol=1e-9)


def test_a_cell_with_parallel_rotary_joints_is_refused_in_one_line() -> None:
    cell = load_cell("head_table")
    head = tuple(
        joint.model_copy(update={"direction": (0.0, 0.0, 1.0)}) if joint.axis == "B" else joint
        for joint in cell.kinematics.head
    )
    bad = cell.model_copy(update={"kinematics": cell.kinematics.model_copy(update={"head": head})})
    with pytest.raises(PostError, match="C and B are parallel"):
        Chain.from_cell(bad)


def test_the_worst_axis_out_of_travel_is_named_with_limit_and_unit() -> None:
    cell = load_cell("trunnion_tcp")
    joints = np.array([[0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 118.3, 0.0]])
    with pytest.raises(TravelLimitError, match=r"axis A: 118.300 deg asked, limit 110 deg, there"):
        check_travel(cell.axes, joints, ["here", "there"])


def test_a_free_angle_is_held_before_and_behind_and_led_over_between() -> None:
    values, known = np.array([0.0, 10.0, 0.0, 30.0, 0.0]), np.array([False, True, False, True, False])
    assert filled(values, known, np.array([0.0, 0.0, 1.0, 2.0, 3.0]), 5.0).tolist() == [10.0, 10.0, 20.0, 30.0, 30.0]
    assert filled(values, known, np.arange(5.0), 5.0).tolist() == [5.0, 10.0, 20.0, 30.0, 30.0]
    assert filled(values, np.zeros(5, dtype=bool), np.arange(5.0), 7.0).tolist() == [7.0] * 5
