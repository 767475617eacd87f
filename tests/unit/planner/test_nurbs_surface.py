"""Surfaces: exact quadrics, their normals and curvatures, closest points, boxes, ruled walls as surfaces."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from planner.nurbs.construct import arc, circle, line
from planner.nurbs.quadrics import cone, cylinder, extruded, plane, revolved, ruled, sphere, torus
from planner.nurbs.ruled import RuledSurface
from planner.nurbs.surface import Surface
from planner.nurbs.surface_closest import closest_on_surface
from planner.nurbs.surface_shape import curvatures, unit_normals

Floats = NDArray[np.float64]
U, V = np.random.default_rng(7).uniform(0.01, 0.99, (2, 400))


def test_sphere_is_a_sphere_to_rounding_in_place_normal_and_curvature() -> None:
    ball, middle = sphere((1.0, 2.0, 3.0), 5.0), np.array([1.0, 2.0, 3.0])
    arm = ball.evaluate(U, V) - middle
    np.testing.assert_allclose(np.linalg.norm(arm, axis=1), 5.0, rtol=1e-14)
    np.testing.assert_allclose(unit_normals(ball, U, V), arm / 5.0, atol=1e-12)
    bend = curvatures(ball, U, V)
    np.testing.assert_allclose(bend.mean, 0.2, rtol=1e-9)
    np.testing.assert_allclose(bend.gaussian, 0.04, rtol=1e-9)
    np.testing.assert_allclose(ball.bounding_box(), [middle - 5.0, middle + 5.0], atol=1e-14)
    np.testing.assert_allclose(unit_normals(ball, [0.0, 0.3, 0.9], [0.0, 0.0, 1.0])[:, 2], [-1, -1, 1], atol=1e-12)
    assert np.isnan(curvatures(ball, 0.3, 0.0).largest).all()


def test_cylinder_and_cone_keep_their_radius_and_bend_only_across_their_rulings() -> None:
    axis = np.array([1.0, 1.0, 1.0]) / np.sqrt(3.0)
    for side, slope in ((cylinder((1, 2, 3), axis, 5.0, 7.0), 0.0), (cone((1, 2, 3), axis, 5.0, 2.0, 7.0), -3.0 / 7.0)):
        arm = side.evaluate(U, V) - [1.0, 2.0, 3.0]
        height = arm @ axis
        reach = np.linalg.norm(arm - height[:, None] * axis, axis=1)
        np.testing.assert_allclose(reach, 5.0 + slope * height, rtol=1e-13)
        bend = curvatures(side, U, V)
        np.testing.assert_allclose(bend.smallest, 0.0, atol=1e-12)
        np.testing.assert_allclose(bend.largest, 1.0 / (reach * np.sqrt(1.0 + slope**2)), rtol=1e-9)
        outward = arm - height[:, None] * axis
        assert np.all(np.einsum("ij,ij->i", unit_normals(side, U, V), outward) > 0.0)
    pointed = cone((0, 0, 0), (0, 0, 1), 5.0, 0.0, 10.0)
    np.testing.assert_allclose(unit_normals(pointed, U, np.ones(400))[:, 2], 1.0 / np.sqrt(5.0), rtol=1e-9)


def test_torus_has_the_curvatures_of_a_torus_and_its_box_is_exact() -> None:
    ring = torus((1.0, 2.0, 3.0), (0.0, 1.0, 0.0), 9.0, 2.0)
    point = ring.evaluate(U, V) - [1.0, 2.0, 3.0]
    reach = np.hypot(point[:, 0], point[:, 2])
    np.testing.assert_allclose(np.hypot(reach - 9.0, point[:, 1]), 2.0, rtol=1e-13)
    bend = curvatures(ring, U, V)
    np.testing.assert_allclose(bend.largest, 0.5, rtol=1e-9)
    np.testing.assert_allclose(bend.smallest, (reach - 9.0) / (2.0 * reach), atol=1e-10)
    np.testing.assert_allclose(ring.bounding_box(), [[-10.0, 0.0, -8.0], [12.0, 4.0, 14.0]], atol=1e-13)
    across = np.cross(np.column_stack([point[:, 0], np.zeros(400), point[:, 2]]), [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across, axis=1)[:, None]
    np.testing.assert_allclose(np.abs(np.einsum("ij,ij->i", bend.along_smallest, across)), 1.0, rtol=1e-9)


def test_partial_revolution_stops_where_it_was_asked_to() -> None:
    quarter = revolved(line((2, 0, 0), (2, 0, 5)), (0, 0, 0), (0, 0, 1), 0.7)
    end = quarter.evaluate(1.0, [0.0, 1.0])
    np.testing.assert_allclose(end, [[2 * np.cos(0.7), 2 * np.sin(0.7), z] for z in (0, 5)], atol=1e-14)


def test_plane_and_extrusion_are_what_their_sides_say() -> None:
    sheet = plane((1, 1, 1), (4, 0, 0), (0, 3, 3))
    expected = np.array([1.0, 1, 1]) + U[:, None] * [4, 0, 0] + V[:, None] * [0, 3, 3]
    np.testing.assert_allclose(sheet.evaluate(U, V), expected, atol=1e-14)
    np.testing.assert_allclose(
        unit_normals(sheet, U, V), np.broadcast_to([0, -(0.5**0.5), 0.5**0.5], (400, 3)), atol=1e-14
    )
    pulled = extruded(circle((0, 0, 0), 3.0), (1, 0, 9))
    np.testing.assert_allclose(
        pulled.evaluate(U, V), circle((0, 0, 0), 3.0).evaluate(U) + V[:, None] * [1, 0, 9], atol=1e-13
    )


def test_ruled_wall_as_a_surface_is_the_same_wall() -> None:
    low, high = circle((0, 0, 0), 10.0), circle((1, 0, 6), 7.0)
    wall = RuledSurface(low, high)
    surface = wall.as_surface()
    np.testing.assert_allclose(surface.evaluate(U, V), wall.evaluate(U, V[:, None][:, 0]), atol=1e-12)
    np.testing.assert_allclose(ruled(low, high).isocurve("v", 1.0).evaluate(U), high.evaluate(U), atol=1e-12)
    uneven = RuledSurface(arc((0, 0, 0), (1, 0, 0), (0, 1, 0), 5.0, 0.0, 1.5), line((4, 4, 5), (0, 6, 5)))
    between, ends = uneven.as_surface().evaluate(U, V), (uneven.evaluate(U, 0.0), uneven.evaluate(U, 1.0))
    away = np.linalg.norm(np.cross(between - ends[0], ends[1] - ends[0]), axis=1)
    assert away.max() <= 1e-11


def test_closest_point_on_quadrics_is_along_their_normal_even_at_poles_seams_and_centres() -> None:
    rng = np.random.default_rng(3)
    points = rng.normal(size=(300, 3)) * 8.0
    special = np.array([[0, 0, 9.0], [0, 0, -9], [0, 0, 0], [0, 0, 4.999], [7, 0, 0], [5, 0, 0], [0, 0, 1e-9]])
    everywhere = np.vstack([points, special])
    u, v, distance = closest_on_surface(sphere((0, 0, 0), 5.0), everywhere)
    np.testing.assert_allclose(distance, np.abs(np.linalg.norm(everywhere, axis=1) - 5.0), atol=1e-12)
    np.testing.assert_allclose(
        np.linalg.norm(sphere((0, 0, 0), 5.0).evaluate(u, v) - everywhere, axis=1), distance, atol=1e-12
    )
    reach = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 9.0, points[:, 2])
    distance = closest_on_surface(torus((0, 0, 0), (0, 0, 1), 9.0, 2.0), points)[2]
    np.testing.assert_allclose(distance, np.abs(reach - 2.0), atol=1e-12)


def test_closest_point_beside_a_sheet_lies_on_its_edge_or_corner() -> None:
    sheet = plane((0, 0, 0), (4, 0, 0), (0, 3, 0))
    points = np.array([[-1, 1, 0], [5, 4, 0], [2, -2, 2], [1, 1, 7], [4.0, 3.0, 0.0], [9, 1.5, 0]])
    u, v, distance = closest_on_surface(sheet, points)
    np.testing.assert_allclose(distance, [1, np.sqrt(2), np.sqrt(8), 7, 0, 5], atol=1e-12)
    np.testing.assert_allclose(np.column_stack([u * 4, v * 3]), np.clip(points[:, :2], 0, [4, 3]), atol=1e-9)


def test_surfaces_that_do_not_fit_together_and_parameters_outside_are_refused() -> None:
    knots, flat = np.array([0.0, 0, 1, 1]), plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
    with pytest.raises(ValueError, match="no surface"):
        Surface(2, 1, knots, knots, np.zeros((2, 2, 3)))
    with pytest.raises(ValueError, match="clamped"):
        Surface(1, 1, np.array([0.0, 0.5, 1, 1]), knots, np.zeros((2, 2, 3)))
    with pytest.raises(ValueError, match="weights must be positive"):
        Surface(1, 1, knots, knots, np.zeros((2, 2, 3)), np.zeros((2, 2)))
    with pytest.raises(ValueError, match=r"v = 1.5 leaves the domain \(0, 1\)"):
        flat.evaluate_grid([0.5], [0.5, 1.5])
    with pytest.raises(ValueError, match="not finite"):
        closest_on_surface(flat, [[np.nan, 0, 0]])
    with pytest.raises(ValueError, match="parallel"):
        plane((0, 0, 0), (1, 0, 0), (2, 0, 0))
    with pytest.raises(ValueError, match="torus"):
        torus((0, 0, 0), (0, 0, 1), 2.0, 3.0)
