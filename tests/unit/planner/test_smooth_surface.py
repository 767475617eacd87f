"""What facets stand for: creases, normals at vertices, curves over edges, patches, and distances from them."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from planner.mesh.crease import corner_normals, crease_edges, edge_bends
from planner.mesh.patch import distances_to_patches
from planner.mesh.smooth import bezier_at, edge_curves, smooth_surface
from planner.slicing import slice_mesh
from planner.slicing.contours import section_curves_many
from planner.slicing.nearness import nearest_sides
from tests.unit.planner import smooth_surfaces as known


@pytest.mark.parametrize("name", ["sphere UV 48x24", "icosphere 3"])
def test_normals_of_a_mesh_on_a_sphere_are_those_of_the_sphere(name: str) -> None:
    mesh = known.SHAPES[name]().mesh
    exact = mesh.corners / known.RADIUS
    assert np.abs(corner_normals(mesh, 35.0) - exact).max() < 1e-7
    for other in ("angle", "area"):
        assert np.abs(corner_normals(mesh, 35.0, other) - exact).max() > 1e-3


def test_normals_of_a_torus_are_exact_and_the_mean_by_angle_is_not() -> None:
    mesh = known.torus().mesh
    corners = mesh.corners
    centre = corners * [1.0, 1.0, 0.0]
    centre *= known.RING / np.linalg.norm(centre, axis=2, keepdims=True)
    exact = (corners - centre) / known.TUBE
    assert np.abs(corner_normals(mesh, 35.0) - exact).max() < 1e-6
    assert np.abs(corner_normals(mesh, 35.0, "angle") - exact).max() > 1e-3


def test_a_cylinders_rim_is_a_crease_with_a_normal_on_each_side() -> None:
    mesh = known.cylinder().mesh
    assert crease_edges(mesh, 35.0).sum() == 2 * 2 * 48
    normals, is_wall = corner_normals(mesh, 35.0), np.abs(mesh.normals[:, 2]) < 0.5
    radial = mesh.corners[is_wall] * [1.0, 1.0, 0.0] / known.RADIUS
    assert np.abs(normals[is_wall] - radial).max() < 1e-12
    assert np.abs(np.abs(normals[~is_wall][:, :, 2]) - 1.0).max() < 1e-12


def test_every_edge_of_a_cube_bends_by_a_right_angle_or_not_at_all() -> None:
    mesh = known.prism(np.array([[5.0, 5.0], [-5.0, 5.0], [-5.0, -5.0], [5.0, -5.0]]))
    bends = np.degrees(edge_bends(mesh))
    assert np.isclose(bends, 90.0).sum() == 24 and np.isclose(bends, 0.0, atol=1e-6).sum() == bends.size - 24
    assert not crease_edges(mesh, 90.1).any() and crease_edges(mesh, 89.9).sum() == 24


def test_at_the_tip_of_a_cone_each_facet_keeps_its_own_normal() -> None:
    for rows in (1, 5):
        mesh = known.cone(rows).mesh
        surface = smooth_surface(mesh, 35.0)
        facet, corner = np.nonzero(mesh.vertices[mesh.facets][:, :, 2] > known.HEIGHT - 1e-9)
        assert len(facet) >= 48
        assert np.abs(surface.normals[facet, corner] - mesh.normals[facet]).max() < 1e-12


def test_a_flat_side_stays_flat_where_it_runs_into_an_arc() -> None:
    angle = np.linspace(-np.pi / 2, np.pi / 2, 13)
    arc = np.column_stack([20.0 + 10.0 * np.cos(angle), 10.0 * np.sin(angle)])
    mesh = known.prism(np.vstack([arc, -arc]))
    section = slice_mesh(mesh, np.array([[0.0, 0.0, 4.0, 0.0, 0.0, 1.0]]))[0]
    curve = section_curves_many([section], mesh)[0][0].curve
    points = curve.evaluate(np.unique(np.linspace(curve.breaks[:-1], curve.breaks[1:], 33)))
    side, end = np.abs(points[:, 0]) < 20.0, np.abs(points[:, 0]) >= 20.0
    assert np.abs(np.abs(points[side, 1]) - 10.0).max() < 1e-9
    assert np.abs(np.hypot(np.abs(points[end, 0]) - 20.0, points[end, 1]) - 10.0).max() < 0.086 / 20.0


def test_curves_over_edges_of_a_sphere_lie_on_it_to_a_thousandth_of_the_facets_height() -> None:
    mesh = known.icosphere(3).mesh
    surface = smooth_surface(mesh, 35.0)
    facet = np.arange(len(mesh.facets))
    bezier, own, other = edge_curves(surface, facet, np.zeros(len(facet), dtype=np.int64))
    middle, _ = bezier_at(bezier, np.full(len(facet), 0.5))
    height = known.RADIUS - np.linalg.norm(bezier[:, [0, 3]].mean(axis=1), axis=1)
    assert (np.abs(np.linalg.norm(middle, axis=1) - known.RADIUS) < 1e-3 * height).all()
    assert np.array_equal(own, other)


def test_both_facets_beside_an_edge_have_the_same_curve_over_it() -> None:
    for mesh in (known.torus().mesh, known.cylinder().mesh):
        surface = smooth_surface(mesh, 35.0)
        half = np.arange(3 * len(mesh.facets))
        mate = mesh.half_edge_mates
        there, _, _ = edge_curves(surface, half // 3, half % 3)
        back, _, _ = edge_curves(surface, mate // 3, mate % 3)
        assert np.abs(there - back[:, ::-1]).max() < 1e-12


def test_distance_to_patches_is_that_to_the_sphere_they_stand_for() -> None:
    mesh = known.icosphere(3).mesh
    surface = smooth_surface(mesh, 35.0)
    facets = np.arange(len(mesh.facets))
    outward = mesh.centroids / np.linalg.norm(mesh.centroids, axis=1)[:, None]
    found = distances_to_patches(surface, (known.RADIUS + 0.3) * outward, facets, outward)
    assert np.abs(found - 0.3).max() < 1e-3
    sideways = np.cross(outward, [0.3, 0.5, -0.7])
    sideways /= np.linalg.norm(sideways, axis=1)[:, None]
    assert np.isnan(distances_to_patches(surface, 3.0 * known.RADIUS * outward, facets, sideways)).all()


def test_measured_deviations_are_the_sagitta_from_facets_and_an_upper_bound_of_the_true_one_from_the_surface() -> None:
    shape, normal = known.cylinder(), known.direction("upright")
    sagitta = known.RADIUS * (1.0 - np.cos(np.pi / 48))
    for curves in section_curves_many(known.sections_across(shape.mesh, normal), shape.mesh):
        assert curves[0].deviation_mm == pytest.approx(sagitta, rel=1e-3)
    for name in known.SHAPES:
        shape, normal = known.SHAPES[name](), known.direction("tilted")
        for curves in section_curves_many(known.sections_across(shape.mesh, normal), shape.mesh):
            for made in curves:
                points = made.curve.evaluate(made.curve.sample(1e-4))
                true = known.in_plane_distance(shape.field, points, normal).max()
                assert true <= 2.0 * made.smooth_deviation_mm
                assert "cone" in name or made.smooth_deviation_mm < 0.2 * made.deviation_mm


def test_nearest_sides_agree_with_geos_on_random_polylines() -> None:
    random = np.random.default_rng(5)
    sizes, counts = [3, 40, 700], [5, 300, 100]
    path = random.normal(size=(sum(sizes), 3)) * [5.0, 5.0, 0.0]
    points = random.normal(size=(sum(counts), 3)) * [8.0, 8.0, 0.0]
    path_start, point_start = np.cumsum([0, *sizes]), np.cumsum([0, *counts])
    distance, side = nearest_sides(points, point_start, path, path_start)
    for k in range(3):
        ring = shapely.LinearRing(path[path_start[k] : path_start[k + 1], :2])
        own = slice(point_start[k], point_start[k + 1])
        assert np.abs(distance[own] - shapely.distance(shapely.points(points[own, :2]), ring)).max() < 1e-12
        assert side[own].min() >= path_start[k] and side[own].max() < path_start[k + 1]


def test_the_surface_of_a_mesh_is_made_once() -> None:
    mesh = known.icosphere(3).mesh
    assert smooth_surface(mesh, 35.0) is smooth_surface(mesh, 35.0) is not smooth_surface(mesh, 20.0)
