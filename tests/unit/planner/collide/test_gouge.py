"""Gouges: the swept cutter against facets, told against closed forms and against a plain search over points and times."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from planner.collide.cutting_end import CuttingEnd
from planner.collide.gouge import SLACK_MM, Target, gouge, steps_of
from planner.errors import InputError
from planner.mesh.mesh import Mesh
from planner.plan import Pass
from planner.toolpath.motion import UP, process_pass, straight, turning

Floats = NDArray[np.float64]

ROW = [0.0, 10.0, 0.0, 0.0, 0.0]
CHORD_MM = 2e-3
BLOCK = trimesh.creation.box((20.0, 30.0, 10.0))


def block() -> Mesh:
    """20 x 30 x 10 mm about (0, 0, 5)."""
    return Mesh(np.asarray(BLOCK.vertices) + np.array([0.0, 0.0, 5.0]), np.asarray(BLOCK.faces))


def along_wall(x: float, z: float, axis: Floats = UP) -> Pass:
    return process_pass(straight([[x, -12.0, z], [x, 12.0, z]], axis), ROW)


@pytest.mark.parametrize("corner", [0.0, 1.0, 4.0])
@pytest.mark.parametrize("away", [-0.3, 0.0, 0.02])
def test_flank_beside_a_wall_is_as_far_from_it_as_its_axis_less_its_radius(corner: float, away: float) -> None:
    found = gouge([along_wall(14.0 + away, 1.0)], CuttingEnd(4.0, corner, 12.0), block(), look_mm=0.05)
    assert found.least_mm[0] == pytest.approx(away, abs=SLACK_MM)
    assert found.floor_mm[0] <= away <= found.least_mm[0] + 1e-9
    assert found.place[0, 0] == pytest.approx(10.0)


def test_end_that_dips_under_a_top_between_the_ends_of_its_pass_is_found_where_it_does() -> None:
    dip = process_pass(straight([[0.0, -10.0, 11.0], [0.0, 3.0, 9.8], [0.0, 10.0, 11.0]]), ROW)
    found = gouge([along_wall(0.0, 10.0), dip], CuttingEnd(3.0, 0.0, 12.0), block(), look_mm=0.05)
    assert found.least_mm == pytest.approx([0.0, -0.2], abs=SLACK_MM)
    assert abs(found.place[1, 1] - 3.0) < 3.1


def test_leaning_end_mill_cuts_in_by_the_drop_of_its_rim() -> None:
    lean = np.array([np.sin(0.1), 0.0, np.cos(0.1)])
    found = gouge([along_wall(0.0, 10.0, lean)], CuttingEnd(3.0, 0.0, 12.0), block(), look_mm=0.05)
    # the nearest way out of the solid for a point of the top under the rim is through its end: along the axis
    deepest = 3.0 * np.sin(0.1)
    assert -deepest - 1e-9 <= found.least_mm[0] <= -0.5 * deepest


def test_ball_that_rolls_over_a_top_touches_it_whatever_its_axis() -> None:
    tips, axes = np.array([[-5.0, 0.0, 10.0], [5.0, 0.0, 10.0]]), np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
    tips += 3.0 * (UP - axes)
    found = gouge([process_pass(turning(tips, axes), ROW)], CuttingEnd(3.0, 3.0, 12.0), block(), look_mm=0.05)
    assert found.least_mm[0] == pytest.approx(0.0, abs=0.05)  # tip and axis turn straight: the ball's centre swings a little


def test_facets_with_metal_to_spare_count_only_below_it() -> None:
    mesh = block()
    spare = np.where(mesh.normals[:, 2] > 0.5, 0.8, 0.0)
    found = gouge([along_wall(0.0, 9.5)], CuttingEnd(3.0, 0.0, 12.0), Target.of(mesh, spare), look_mm=0.05)
    assert found.least_mm[0] == pytest.approx(0.05) or found.least_mm[0] >= 0.0


def test_asked_for_deep_gouges_only_a_touch_is_none() -> None:
    found = gouge([along_wall(13.95, 1.0), along_wall(13.5, 1.0)], CuttingEnd(4.0, 0.0, 12.0), block(), look_mm=-0.1)
    assert found.least_mm == pytest.approx([-0.1, -0.5], abs=0.02)
    assert np.isnan(found.place[0]).all()


def test_corner_wider_than_its_cutter_is_refused() -> None:
    with pytest.raises(InputError, match="corner radius"):
        CuttingEnd(2.0, 3.0, 12.0)


def depth_by_search(one: Pass, end: CuttingEnd, points: Floats) -> float:
    """Least signed distance of points from the cutter at many times, by the cutter's shape in its half-plane."""
    least = np.inf
    core = max(end.radius_mm - end.corner_radius_mm, 0.0)
    for step in steps_of(one, CHORD_MM):
        for t in np.linspace(0.0, 1.0, 21):
            axis = step[6:9] + t * (step[9:] - step[6:9])
            axis /= np.linalg.norm(axis)
            off = points - (step[:3] + t * (step[3:6] - step[:3]))
            h = off @ axis
            r = np.linalg.norm(off - h[:, None] * axis, axis=1)
            dh = np.maximum(end.corner_radius_mm - h, h - (end.flute_length_mm - end.corner_radius_mm))
            dr = r - core
            outside = np.hypot(np.maximum(dh, 0.0), np.maximum(dr, 0.0))
            least = min(least, float((outside + np.minimum(np.maximum(dh, dr), 0.0) - end.corner_radius_mm).min()))
    return least


@settings(max_examples=25, deadline=None)
@given(
    corner=st.sampled_from([0.0, 0.7, 2.0]),
    start=st.tuples(*[st.floats(-14.0, 14.0)] * 2, st.floats(6.0, 12.0)),
    way=st.tuples(*[st.floats(-4.0, 4.0)] * 3),
    lean=st.tuples(*[st.floats(-0.5, 0.5)] * 2),
)
def test_no_point_at_no_time_is_deeper_than_told(
    corner: float, start: tuple[float, ...], way: tuple[float, ...], lean: tuple[float, ...]
) -> None:
    axis = np.array([*lean, 1.0]) / np.linalg.norm([*lean, 1.0])
    first, last = np.array(start), np.array(start) + np.array(way) + [0.0, 0.0, 0.01]
    one = process_pass(straight([first, last], axis), ROW)
    end = CuttingEnd(2.0, corner, 8.0)
    found = gouge([one], end, block(), look_mm=2.0)
    share = np.linspace(0.0, 1.0, 25)
    grid = np.array([[a, b] for a in share for b in share])
    x, y = 20.0 * grid[:, 0] - 10.0, 30.0 * grid[:, 1] - 15.0
    points = np.vstack([np.column_stack([x, y, np.full(len(x), z)]) for z in (0.0, 10.0)])
    assert found.floor_mm[0] <= min(depth_by_search(one, end, points), 2.0) + 1e-6
    assert found.least_mm[0] <= min(depth_by_search(one, end, points), 2.0) + SLACK_MM + 1e-6
