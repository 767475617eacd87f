"""Contours along the smooth surface: against the true sections of known surfaces, and corners that stay."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from planner.mesh.mesh import Mesh
from planner.nurbs.curve import Curve
from planner.slicing import slice_mesh
from planner.slicing.contours import ContourStyle, fitted_curves, region_of, section_curves_many
from planner.slicing.section import Loop
from tests.unit.planner import smooth_surfaces as known

Floats = NDArray[np.float64]

TIMES_CLOSER = 20.0
NOTHING_MM = 1e-9  # what both may be off where the polygon itself is exact


def farthest_from_section(curve: Curve, loop: Loop, shape: known.Shape, normal: Floats) -> float:
    """The larger of: the curve's points from the true section, the true section's points from the curve, mm."""
    points = curve.evaluate(curve.sample(1e-6))
    outward = known.in_plane_distance(shape.field, points, normal).max()
    probes = known.along(loop, 2)
    truth = known.true_points(shape.field, probes, normal)
    truth = truth[np.abs(shape.field(truth)) < 1e-10]
    u, v = np.linalg.svd(normal[None, :])[2][1:]
    line = shapely.LineString(np.column_stack([points @ u, points @ v]))
    shapely.prepare(line)
    inward = shapely.distance(shapely.points(np.column_stack([truth @ u, truth @ v])), line).max()
    assert len(truth) > 0.9 * len(probes)
    return float(max(outward, inward))


@pytest.mark.parametrize("way", known.DIRECTIONS)
@pytest.mark.parametrize("name", known.SHAPES)
def test_every_contour_is_twenty_times_closer_to_the_true_section_than_the_polygon(name: str, way: str) -> None:
    shape, normal = known.SHAPES[name](), known.direction(way)
    sections = known.sections_across(shape.mesh, normal)
    for section, curves in zip(sections, section_curves_many(sections, shape.mesh), strict=True):
        for loop, made in zip(section.loops, curves, strict=True):
            polygon = known.in_plane_distance(shape.field, known.along(loop, 16), normal).max()
            error = farthest_from_section(made.curve, loop, shape, normal)
            assert error <= max(polygon / TIMES_CLOSER, NOTHING_MM)


@pytest.mark.parametrize("rows", [1, 5])
@pytest.mark.parametrize("beside_mm", [0.0005, 0.004, 0.1, 0.4])
def test_beside_the_tip_of_a_cone_the_curve_is_no_farther_off_than_the_polygon(rows: int, beside_mm: float) -> None:
    shape, normal = known.cone(rows), known.direction("lying")
    section = slice_mesh(shape.mesh, np.concatenate([beside_mm * normal, normal])[None])[0]
    loop, made = section.loops[0], section_curves_many([section], shape.mesh)[0][0]
    polygon = known.in_plane_distance(shape.field, known.along(loop, 64), normal).max()
    assert farthest_from_section(made.curve, loop, shape, normal) <= 1.05 * polygon


@pytest.mark.parametrize("name", known.SHAPES)
def test_speed_handles_are_closer_than_the_polygon_too(name: str) -> None:
    shape, normal = known.SHAPES[name](), known.direction("tilted")
    sections = known.sections_across(shape.mesh, normal)
    found = section_curves_many(sections, shape.mesh, ContourStyle(handles="speed"))
    for section, curves in zip(sections, found, strict=True):
        for loop, made in zip(section.loops, curves, strict=True):
            polygon = known.in_plane_distance(shape.field, known.along(loop, 16), normal).max()
            points = made.curve.evaluate(made.curve.sample(1e-6))
            assert known.in_plane_distance(shape.field, points, normal).max() <= max(polygon / 10.0, NOTHING_MM)


def prism_of(name: str) -> Mesh:
    angle = np.arange(6) * np.pi / 3.0
    outlines = {
        "cube": np.array([[5.0, 5.0], [-5.0, 5.0], [-5.0, -5.0], [5.0, -5.0]]),
        "hexagon": 10.0 * np.column_stack([np.cos(angle), np.sin(angle)]),
        "gear": known.gear_outline(),
    }
    return known.prism(outlines[name])


@pytest.mark.parametrize("way", ["upright", "30 degrees", "tilted", "lying"])
@pytest.mark.parametrize("name", ["cube", "hexagon", "gear"])
def test_plane_faces_keep_their_corners_and_straight_sides(name: str, way: str) -> None:
    mesh, normal = prism_of(name), known.direction(way)
    for section in known.sections_across(mesh, normal):
        for loop, made in zip(section.loops, section_curves_many([section], mesh)[0], strict=True):
            corners = corner_points(made.curve)
            expected = sharp_points(loop)
            assert len(corners) >= len(expected)
            away = np.linalg.norm(corners[None] - expected[:, None], axis=2).min(axis=1)
            assert away.max() < 1e-6
            assert made.deviation_mm < 1e-6 and made.smooth_deviation_mm < 1e-6


def corner_points(curve: Curve) -> Floats:
    """Points where the curve's direction jumps by more than a degree."""
    u = curve.breaks[:-1]
    after = curve.derivatives(u, 1)[1]
    before = curve.derivatives(np.append(curve.domain[1], u[1:]), 1, side="left")[1]
    cosine = np.einsum("nd,nd->n", before, after) / np.linalg.norm(before, axis=1) / np.linalg.norm(after, axis=1)
    return curve.evaluate(u[cosine < np.cos(np.radians(1.0))])


def sharp_points(loop: Loop) -> Floats:
    """Points of a loop where it turns by more than a degree."""
    after = np.roll(loop.points, -1, axis=0) - loop.points
    before = np.roll(after, 1, axis=0)
    cosine = np.einsum("nd,nd->n", before, after) / np.linalg.norm(before, axis=1) / np.linalg.norm(after, axis=1)
    return np.asarray(loop.points[cosine < np.cos(np.radians(1.0))])


def test_points_on_facet_diagonals_of_a_cylinder_are_left_out_and_the_others_give_the_exact_circle() -> None:
    shape = known.cylinder()
    section = known.sections_across(shape.mesh, known.direction("upright"))[3]
    curve = section_curves_many([section], shape.mesh)[0][0].curve
    points = curve.evaluate(np.linspace(0.0, 1.0, 501))
    assert len(section.loops[0].points) == 96 and len(curve.breaks) == 5
    assert np.abs(np.hypot(points[:, 0], points[:, 1]) - known.RADIUS).max() < 1e-9


def test_curves_lie_in_their_planes_and_run_with_the_material_on_their_left() -> None:
    shape, normal = known.torus(), known.direction("tilted")
    sections = known.sections_across(shape.mesh, normal)
    for section, curves in zip(sections, section_curves_many(sections, shape.mesh), strict=True):
        for loop, made in zip(section.loops, curves, strict=True):
            points = made.curve.evaluate(made.curve.sample(1e-3))
            assert np.abs((points - section.origin) @ normal).max() < 1e-9
            area = shapely.LinearRing(section.flatten(points)).is_ccw
            assert area == (not loop.is_hole)


def test_region_of_the_curves_has_the_true_area_where_the_polygon_has_less() -> None:
    shape = known.cylinder()
    section = slice_mesh(shape.mesh, np.array([[0.0, 0.0, 7.0, 0.0, 0.0, 1.0]]))[0]
    region = region_of(section, fitted_curves([section], shape.mesh)[0])
    true_mm2 = np.pi * known.RADIUS**2
    assert abs(region.area - true_mm2) < 0.07 < 3.0 < true_mm2 - section.area_mm2


def test_facets_are_followed_within_a_few_micrometres_where_that_is_asked() -> None:
    shape = known.cylinder()
    sections = known.sections_across(shape.mesh, known.direction("upright"))
    wide, fine = (
        section_curves_many(sections, shape.mesh, ContourStyle(fit="facets", epsilon_mm=epsilon))[3][0]
        for epsilon in (0.5, 0.05)
    )
    smooth = section_curves_many(sections, shape.mesh)[3][0]
    assert fine.deviation_mm < 0.2 * wide.deviation_mm < 0.2 * smooth.deviation_mm
    assert np.isnan(fine.smooth_deviation_mm) and np.isnan(wide.smooth_deviation_mm)


def test_an_empty_section_has_no_curves() -> None:
    shape = known.cylinder()
    sections = slice_mesh(shape.mesh, np.array([[0.0, 0.0, 99.0, 0.0, 0.0, 1.0], [0.0, 0.0, 9.0, 0.0, 0.0, 1.0]]))
    assert [len(found) for found in section_curves_many(sections, shape.mesh)] == [0, 1]
    assert section_curves_many(sections[:1], shape.mesh) == [[]]
