"""Shares of parts whose shape says what a direction can make."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from planner.decompose.buildable import buildable_shares, report
from planner.decompose.grown import cells_along
from planner.mesh.mesh import Mesh
from tests.unit.planner.small_parts import box, frustum

AXES = np.array([[0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], dtype=np.float64)


def bracket() -> Mesh:
    """An L: a foot of 40 x 20 x 5 and, on a stem at its end, an arm of 30 x 20 x 5 over the foot."""
    pieces = [
        trimesh.creation.box(bounds=[[0, 0, 0], [5, 20, 40]]),
        trimesh.creation.box(bounds=[[0, 0, 0], [40, 20, 5]]),
        trimesh.creation.box(bounds=[[0, 0, 35], [30, 20, 40]]),
    ]
    return Mesh.from_trimesh(trimesh.boolean.union(pieces))


def test_cells_hold_the_volume_of_the_part() -> None:
    part = Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=4, radius=10.0))
    for direction in ([0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [-1.0, 0.0, 0.0]):
        assert cells_along(part, np.array(direction), 30.0).volume_mm3 == pytest.approx(part.volume, rel=0.01)


def test_box_is_made_from_each_side() -> None:
    shares = buildable_shares(box(20.0, 15.0, 10.0), AXES, 30.0)
    assert shares.upright == pytest.approx(1.0)
    assert shares.order == (0,) and shares.together == (1.0,)


def test_cone_is_made_within_the_limit_and_not_beyond() -> None:
    wide = frustum(4.0, 16.0, 12.0)  # leans by 45 degrees
    held = buildable_shares(wide, AXES[:2], 55.0).upright
    assert held == pytest.approx(1.0)
    steep, upside_down = buildable_shares(wide, AXES[:2], 20.0).upright
    z = np.linspace(0.0, 12.0, 200)
    truth = np.trapezoid(np.pi * (4.0 + z * np.tan(np.radians(20.0))) ** 2, z) / wide.volume
    assert steep == pytest.approx(truth, abs=0.1) and upside_down == pytest.approx(1.0)


def test_arm_over_a_foot_is_left_by_one_direction_and_made_by_two() -> None:
    part = bracket()
    shares = buildable_shares(part, AXES[[0, 2]], 30.0, 85.0)
    arm = 25 * 20 * 5 / part.volume
    spread = 0.5 * 5 * 5 * np.tan(np.radians(30.0)) * 20 / part.volume
    assert shares.upright[0] == pytest.approx(1.0 - arm + spread, abs=0.03)
    assert shares.together[-1] == pytest.approx(1.0, abs=0.01)


def test_cross_is_made_by_three_directions_in_turn_and_the_report_says_so() -> None:
    column = trimesh.creation.box(bounds=[[-10, -10, 0], [10, 10, 50]])
    beam = trimesh.creation.box(bounds=[[-40, -5, 25], [40, 5, 35]])
    shares = buildable_shares(Mesh.from_trimesh(trimesh.boolean.union([column, beam])), AXES[:4], 30.0)
    assert [tuple(shares.directions[k]) for k in shares.order] == [(0, 0, 1), (1, 0, 0), (-1, 0, 0)]
    assert shares.together == tuple(sorted(shares.together)) and shares.together[-1] == pytest.approx(1.0, abs=0.005)
    line = report(shares)[0]
    assert line.startswith("direction (0, 0, 1) makes ") and ", with (-1, 0, 0) 100 %" in line


def test_body_that_begins_in_the_air_is_not_made() -> None:
    low, high = trimesh.creation.box((10, 10, 10)), trimesh.creation.box((10, 10, 10))
    high.apply_translation([0, 0, 25])
    both = trimesh.util.concatenate([low, high])
    assert isinstance(both, trimesh.Trimesh)
    part = Mesh.from_trimesh(both)
    assert buildable_shares(part, AXES[:1], 45.0).upright[0] == pytest.approx(0.5, abs=0.01)
