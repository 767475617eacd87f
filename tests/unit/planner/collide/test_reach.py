"""What head and cutter have around them: distances against an independent polygon, every point asked, and sampled solids."""

from __future__ import annotations

import time
from itertools import pairwise

import numpy as np
import pytest
import shapely
import trimesh
from numpy.typing import NDArray

from planner.collide.reach import NOTHING, PLATE, CutterShape, HeadShape, PointTree, Shape, reach, surface_points
from planner.errors import InputError
from planner.mesh.mesh import Mesh

Floats = NDArray[np.float64]

HEAD, CUTTER = HeadShape(), CutterShape(3.0, 12.0, 2.0)
PLATE_MM = (120.0, 80.0)


def unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def half_plane(points: Floats, tip: Floats, axis: Floats) -> Floats:
    """(n, 2): height along the axis and distance from it."""
    along = (points - tip) @ axis
    return np.column_stack([along, np.linalg.norm(points - tip - along[:, None] * axis, axis=1)])


def signed_by_polygon(points: Floats, tip: Floats, axis: Floats, shape: Shape) -> Floats:
    """Signed distance by shapely: from the profile and its mirror image as one polygon."""
    profile = shape.profile
    outline = shapely.Polygon(np.vstack([profile, (profile * [1.0, -1.0])[::-1]]))
    places = shapely.points(half_plane(points, tip, axis))
    depth = shapely.distance(outline.boundary, places)
    return np.asarray(np.where(shapely.contains(outline, places), -depth, depth))


def solid_points(shape: Shape, tip: Floats, axis: Floats, pitch: float) -> Floats:
    """Points of the whole tool, none of it farther than about the pitch from one."""
    profile = shape.profile
    found = []
    for (h0, r0), (h1, r1) in pairwise(profile):
        for t in np.linspace(0.0, 1.0, max(int(np.ceil(np.hypot(h1 - h0, r1 - r0) / pitch)), 1) + 1):
            for r in np.arange(0.0, r0 + (r1 - r0) * t + pitch, pitch):
                radius = min(r, r0 + (r1 - r0) * t)
                turn = np.linspace(0.0, 2.0 * np.pi, max(int(2.0 * np.pi * radius / pitch), 1) + 1)
                ring = [radius * np.cos(turn), radius * np.sin(turn), np.full(len(turn), h0 + (h1 - h0) * t)]
                found.append(np.column_stack(ring))
    side = unit(np.cross(axis, [0.3, 1.0, 0.1]))
    return np.asarray(tip + np.vstack(found) @ np.array([side, np.cross(axis, side), axis]))


def poses(count: int, seed: int, spread: float = 40.0, lift: float = 60.0) -> tuple[Floats, Floats]:
    random = np.random.default_rng(seed)
    tips = random.uniform([-spread, -spread, 0.0], [spread, spread, lift], (count, 3))
    axes = unit(random.normal([0.0, 0.0, 1.0], 1.0, (count, 3)))
    return tips, axes


@pytest.mark.parametrize("shape", [HEAD, CUTTER], ids=["head", "cutter"])
def test_clearance_is_the_least_signed_distance_of_all_points_whichever_side_they_are_on(shape: Shape) -> None:
    tips, axes = poses(60, 1)
    points = np.random.default_rng(2).uniform(-70.0, 70.0, (701, 3))
    found = reach(tips, axes, points, None, shape)
    for k in range(len(tips)):
        true = signed_by_polygon(points, tips[k], axes[k], shape)
        assert found.clearance_mm[k] == pytest.approx(true.min(), abs=1e-9)
        assert true[found.nearest[k]] == pytest.approx(true.min(), abs=1e-9)
        assert found.free[k] == (true.min() >= 0.0)
    assert (found.clearance_mm < 0.0).any()
    few = reach(tips, axes, points[:2], None, shape)
    assert (few.clearance_mm > 5.0).any() and (few.clearance_mm >= found.clearance_mm).all()


def test_upright_head_over_a_point_has_the_stand_off_and_beside_the_cone_its_slope() -> None:
    up = np.array([[0.0, 0.0, 1.0]])
    assert reach([[0.0, 0.0, 5.0]], up, [[0.0, 0.0, 5.0]], None, HEAD).clearance_mm[0] == pytest.approx(13.0)
    slope = np.deg2rad(HEAD.cone_half_angle_deg)
    beside = np.array([[6.0 + 30.0 * np.tan(slope) + 4.0 / np.cos(slope), 0.0, 13.0 + 30.0]])
    assert reach([[0.0, 0.0, 0.0]], up, beside, None, HEAD).clearance_mm[0] == pytest.approx(4.0)
    wall = np.array([[16.0, 0.0, 39.0], [16.0, 0.0, 41.0]])
    found = reach([[0.0, 0.0, 0.0]], up, wall, None, CutterShape(4.0, 20.0, 4.0, 40.0, 20.0))
    assert found.nearest[0] == 1 and found.clearance_mm[0] == pytest.approx(-1.0) and not found.free[0]


def test_head_far_over_the_plate_is_clear_of_it_by_its_lowest_point() -> None:
    tips, axes = poses(200, 3, spread=10.0, lift=80.0)
    found = reach(tips, axes, np.empty((0, 3)), (1e4, 1e4), HEAD)
    profile = HEAD.profile
    level = np.sqrt(1.0 - axes[:, 2] ** 2)
    lowest = (tips[:, 2:] + profile[:, 0] * axes[:, 2:] - profile[:, 1] * level[:, None]).min(axis=1)
    assert found.clearance_mm == pytest.approx(lowest, abs=1e-9)
    assert (found.nearest == PLATE).all() and (lowest < 0.0).any()


@pytest.mark.parametrize("shape", [HeadShape(13.0, 6.0, 30.0, 18.0, 40.0), CUTTER], ids=["head", "cutter"])
def test_beside_the_plate_a_tool_may_reach_below_its_top(shape: Shape) -> None:
    tips, axes = poses(18, 4, spread=75.0, lift=20.0)
    axes = unit(tips * [1.0, 1.0, 0.0] + np.random.default_rng(5).normal(size=tips.shape) * 12.0)
    found = reach(tips, axes, np.empty((0, 3)), PLATE_MM, shape)
    half = 0.5 * np.array(PLATE_MM)
    below_and_free = 0
    for k in range(len(tips)):
        solid = solid_points(shape, tips[k], axes[k], 1.5)
        off = np.maximum(np.column_stack([np.abs(solid[:, :2]) - half, solid[:, 2]]), 0.0)
        true = float(np.linalg.norm(off, axis=1).min())
        below_and_free += bool(true > 1.0 and solid[:, 2].min() < -5.0)
        if true > 0.0:
            assert true - 1.5 <= found.clearance_mm[k] <= true + 1e-3
        else:
            assert found.clearance_mm[k] <= 1e-3
    assert below_and_free > 1


def test_poses_without_anything_around_are_free() -> None:
    found = reach([[0.0, 0.0, 1.0]], [[0.0, 0.0, 1.0]], np.empty((0, 3)), None, HEAD)
    assert found.free[0] and found.clearance_mm[0] == np.inf and found.nearest[0] == NOTHING
    close = reach([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]], [[0.0, 0.0, 0.0]], None, HEAD, clearance_mm=14.0)
    assert not close.free[0]


def test_mesh_is_sampled_within_the_pitch_everywhere_and_slivers_get_few_points() -> None:
    needle = trimesh.creation.cylinder(2.0, 200.0, sections=96)
    for source, pitch, most in ((trimesh.creation.icosphere(3, 20.0), 1.0, 40_000), (needle, 1.0, 40_000)):
        mesh = Mesh.from_trimesh(source)
        points = surface_points(mesh, pitch)
        asked = np.asarray(trimesh.sample.sample_surface(source, 4000, seed=7)[0])
        apart = np.array([np.linalg.norm(points - p, axis=1).min() for p in asked[::10]])
        assert apart.max() <= pitch and len(points) < most
        assert np.array_equal(points, surface_points(mesh, pitch))
        assert len(np.unique(points, axis=0)) == len(points)


def test_head_clears_a_ball_as_far_as_their_distance() -> None:
    ball = Mesh.from_trimesh(trimesh.creation.icosphere(4, 10.0))
    tips = np.array([[40.0, 0.0, 0.0], [0.0, 0.0, 12.0], [0.0, 0.0, -20.0]])
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
    found = reach(tips, axes, ball, None, HEAD)
    assert found.clearance_mm[:2] == pytest.approx([43.0, 15.0], abs=0.03)
    assert found.clearance_mm[2] < -3.0


def test_ten_thousand_poses_among_a_hundred_thousand_points_take_under_a_second() -> None:
    random = np.random.default_rng(8)
    points = unit(random.normal(size=(100_000, 3))) * random.uniform(20.0, 40.0, (100_000, 1)) + [0.0, 0.0, 40.0]
    tips, axes = poses(10_000, 9)
    reach(tips[:2], axes[:2], points[:9], PLATE_MM, HEAD)
    started = time.process_time()
    found = reach(tips, axes, points, PLATE_MM, HEAD)
    assert time.process_time() - started < 1.0
    for k in range(0, 10_000, 2500):
        true = signed_by_polygon(points, tips[k], axes[k], HEAD).min()
        assert found.clearance_mm[k] <= true + 1e-9


def test_tree_made_once_gives_the_same_answers_every_time() -> None:
    points = np.random.default_rng(10).uniform(-30.0, 30.0, (999, 3))
    tips, axes = poses(50, 11)
    tree = PointTree.over(points)
    first, again = reach(tips, axes, tree, PLATE_MM, HEAD), reach(tips, axes, points, PLATE_MM, HEAD)
    assert np.array_equal(first.clearance_mm, again.clearance_mm) and np.array_equal(first.nearest, again.nearest)


def test_clearances_beyond_enough_are_given_as_enough_and_all_others_as_they_are() -> None:
    points = np.random.default_rng(12).uniform(-60.0, 60.0, (99, 3))
    tips, axes = poses(100, 13)
    whole, part = reach(tips, axes, points, PLATE_MM, HEAD), reach(tips, axes, points, PLATE_MM, HEAD, enough_mm=1.0)
    assert np.array_equal(part.clearance_mm, np.minimum(whole.clearance_mm, 1.0))
    assert np.array_equal(part.nearest, np.where(whole.clearance_mm < 1.0, whole.nearest, NOTHING))
    assert np.array_equal(part.free, whole.free) and 5 < part.free.sum() < 95


def test_wrong_poses_and_shapes_are_refused_in_one_line() -> None:
    with pytest.raises(InputError, match="no unit vector"):
        reach([[0.0, 0.0, 0.0]], [[0.0, 0.0, 2.0]], [[1.0, 0.0, 0.0]], None, HEAD)
    with pytest.raises(InputError, match="tips and axes"):
        reach([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]] * 2, [[1.0, 0.0, 0.0]], None, HEAD)
    with pytest.raises(InputError, match="obstacles are"):
        reach([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]], [[1.0, 0.0]], None, HEAD)
    with pytest.raises(InputError, match="stick out"):
        reach([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]], None, CutterShape(4.0, 50.0))
    with pytest.raises(InputError, match="apart"):
        surface_points(Mesh.from_trimesh(trimesh.creation.box((1.0, 1.0, 1.0))), 0.0)
