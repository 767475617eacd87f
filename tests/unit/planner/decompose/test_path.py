"""Planes that turn with a piece's axis: against the known axis, with the bounds on every layer taken from the planes themselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import config
from planner.decompose.path import AxisPath, PathBreak, axis_path
from planner.mesh import load
from planner.mesh.mesh import Mesh
from planner.slicing.stations import path_stations
from tests.unit.planner.decompose.bent_parts import above, arc, bend, rough, straight, swept, united, without

Floats = NDArray[np.float64]

GROUND = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
RATIO = 3.0


def path_of(mesh: Mesh, base: Floats = GROUND) -> AxisPath | PathBreak:
    return axis_path(mesh, base, layer_min_mm=0.3, layer_max_mm=1.0, max_ratio=RATIO)


def followed(mesh: Mesh, base: Floats = GROUND) -> AxisPath:
    """The path, after what holds for every one: it begins in the base, its layers are even enough and it turns gently."""
    path = path_of(mesh, base)
    assert isinstance(path, AxisPath), path
    assert path.planes[0] == pytest.approx(base, abs=1e-9) or path.planes[0, 3:] == pytest.approx(base[3:])
    assert abs((path.planes[0, :3] - base[:3]) @ base[3:]) < 1e-3
    stations = path_stations(mesh, path.planes)
    layer = np.floor(stations.middle).astype(np.int64)
    for number in np.unique(layer):
        rate = stations.rate[layer == number]
        assert 0.0 < rate.max() <= RATIO * rate.min()
    turning = np.diff(path.planes[:, 3:], axis=0)
    assert np.linalg.norm(np.diff(turning, axis=0), axis=1).max() < np.radians(4.0)
    return path


def elbow_pipe(bend_mm: float, outer_mm: float, inner_mm: float) -> Mesh:
    """A quarter of a torus with a bore from end to end."""
    way = arc(bend_mm)
    bore = swept(np.vstack([way[0] - (0, 0, 1), way, way[-1] + (1, 0, 0)]), inner_mm)
    return without(bend(bend_mm, outer_mm), [bore])


@pytest.mark.parametrize(("outer_mm", "inner_mm"), [(8.0, 0.0), (5.0, 0.0), (8.0, 5.0), (5.0, 3.0)])
def test_quarter_of_a_torus_solid_or_pipe_is_followed_round_to_its_flat_end(outer_mm: float, inner_mm: float) -> None:
    mesh = elbow_pipe(20.0, outer_mm, inner_mm) if inner_mm else bend(20.0, outer_mm)
    path = followed(mesh)
    aside = np.hypot(np.hypot(path.axis[:, 0] - 20.0, path.axis[:, 2]) - 20.0, path.axis[:, 1])
    assert aside.max() < 0.012 * outer_mm
    assert path.planes[-1, 3:] == pytest.approx((1.0, 0.0, 0.0), abs=1e-6)
    assert path.planes[-1, 0] == pytest.approx(20.0, abs=1e-4)
    # The plane through (0, 0, s) of the axis stands across it: normals are the circle's tangents.
    tangent = np.column_stack([path.planes[:, 2], 0.0 * path.planes[:, 0], 20.0 - path.planes[:, 0]]) / 20.0
    assert np.degrees(np.arccos(np.clip((path.planes[:, 3:] * tangent).sum(axis=1), -1, 1))).max() < 3.0


def test_both_arms_of_the_double_arc_are_followed_from_a_level_cut_to_their_end_faces() -> None:
    part = load(Path(config.__file__).parent / "parts" / "double_arc.stl")
    base = np.array([0.0, 0.0, 38.0, 0.0, 0.0, 1.0])
    left, right = (followed(arm, base) for arm in above(part, base))
    assert left.planes[-1] == pytest.approx(right.planes[-1] * (-1, 1, 1, -1, 1, 1), abs=0.05)
    assert np.degrees(right.bend_rad) == pytest.approx(100.0, abs=1.0)
    assert np.abs(right.axis[:, 1]).max() < 0.02


def test_s_bend_turns_there_and_back() -> None:
    half = arc(20.0, 60.0)
    way = np.vstack([half, half[-1] + (half[-1] - half[::-1])[1:]])
    path = followed(swept(way, 5.0, ends=[(0, 0, 1), (0, 0, 1)]))
    leaning = np.degrees(np.arccos(path.planes[:, 5]))
    assert leaning[[0, -1]] == pytest.approx(0.0, abs=0.1)
    assert 50.0 < leaning.max() < 60.5


def test_tube_that_winds_in_space_is_followed() -> None:
    turn = np.linspace(0.0, 2.2, 60)
    way = np.column_stack([25.0 * np.cos(turn) - 25.0, 25.0 * np.sin(turn), 14.0 * turn])
    ends = np.column_stack([-25.0 * np.sin(turn), 25.0 * np.cos(turn), 14.0 + 0.0 * turn])[[0, -1]] / np.hypot(25.0, 14.0)
    path = followed(swept(way, 4.0, ends=ends), np.concatenate([way[0], ends[0]]))
    fine = np.linspace(0.0, 2.2, 2000)
    true = np.column_stack([25.0 * np.cos(fine) - 25.0, 25.0 * np.sin(fine), 14.0 * fine])
    assert np.linalg.norm(path.axis[:, None, :] - true[None, :, :], axis=2).min(axis=1).max() < 0.06
    assert path.planes[-1, 3:] == pytest.approx(ends[1], abs=1e-6)


def test_leaning_cylinder_on_a_level_base_is_caught_up_with_within_the_bounds() -> None:
    leaning = above(straight([-10.0, 0.0, -10.0], [30.0, 0.0, 30.0], 5.0), GROUND)[0]
    path = followed(leaning)
    assert path.planes[0, 3:] == pytest.approx((0.0, 0.0, 1.0))
    assert path.planes[-1, 3:] == pytest.approx(np.array([1.0, 0.0, 1.0]) / np.sqrt(2.0), abs=1e-6)
    assert np.abs(path.axis[:, 0] - path.axis[:, 2]).max() < 0.05


def test_straight_cylinder_keeps_its_planes_level() -> None:
    path = followed(straight([0, 0, 0], [0, 0, 30], 5.0))
    assert path.bend_rad < 1e-6
    assert path.planes[-1, 2] == pytest.approx(30.0, abs=1e-4)


def test_limb_that_folds_back_is_refused_with_the_place_of_the_corner() -> None:
    found = path_of(united([straight([0, 0, 0], [0, 0, 24], 4.0), straight([0, 0, 20], [22, 0, 2], 4.0)]))
    assert isinstance(found, PathBreak)
    assert np.linalg.norm(found.place - (0.0, 0.0, 20.0)) < 12.0
    assert "too fast" in found.reason and "\n" not in found.reason


def test_bend_tighter_than_its_thickness_allows_is_refused() -> None:
    legs = np.vstack([[(0, 0, z) for z in np.linspace(0, 18, 10)], np.add(arc(7.0, 170.0)[1:], (0, 0, 20))])
    end = np.array([np.sin(np.radians(170.0)), 0.0, np.cos(np.radians(170.0))])
    way = np.vstack([legs, legs[-1] + np.linspace(2.0, 10.0, 5)[:, None] * end])
    found = path_of(swept(way, 6.0, ends=[(0, 0, 1), end]))
    assert isinstance(found, PathBreak)
    assert found.place[2] > 5.0


def test_piece_that_branches_is_refused_with_the_place() -> None:
    limbs = [straight([0, 0, 24], [20 * side, 0, 50], 5.0) for side in (-1, 1)]
    found = path_of(united([straight([0, 0, 0], [0, 0, 25], 5.0), *limbs]))
    assert isinstance(found, PathBreak)
    assert "branches" in found.reason
    assert np.linalg.norm(found.place - (0.0, 0.0, 28.0)) < 10.0


def test_piece_that_does_not_stand_on_the_base_is_refused() -> None:
    found = path_of(straight([0, 0, 10], [0, 0, 30], 5.0))
    assert isinstance(found, PathBreak)
    assert "stand" in found.reason


def test_rough_copy_of_a_bend_has_nearly_the_same_planes() -> None:
    smooth = followed(bend(20.0, 5.0))
    other = path_of(above(rough(swept(np.vstack([[0, 0, -1], arc(20.0)]), 5.0), 0.02), GROUND)[0])
    assert isinstance(other, AxisPath)
    share = np.linspace(0.0, 1.0, 20)
    first, second = (
        np.column_stack([np.interp(share, np.linspace(0, 1, len(p.planes)), p.planes[:, k]) for k in range(6)])
        for p in (smooth, other)
    )
    assert np.linalg.norm(first[:, :3] - second[:, :3], axis=1).max() < 0.4
    assert (first[:, 3:] * second[:, 3:]).sum(axis=1).min() > np.cos(np.radians(4.0))


def test_same_piece_gives_the_same_planes_to_the_last_bit() -> None:
    first, second = (followed(bend(20.0, 5.0)) for _ in range(2))
    assert first.planes.tobytes() == second.planes.tobytes()
