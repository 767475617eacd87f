"""Ruled walls between contours that correspond one to one: developable where the body is, on the body elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from planner.matching import wall_deviation
from planner.matching.contact import first_contact
from planner.mesh.mesh import Mesh
from planner.nurbs.measure import closest_points
from planner.nurbs.ruled import RuledSurface
from planner.slicing.contours import section_curves
from tests.unit.planner.matching_shapes import area_at, between, circle, loft, square, walls_between

U = np.linspace(0.0, 1.0, 701)


def misses(wall: RuledSurface, apex: list[float]) -> float:
    """Largest distance, mm, by which a ruling's line passes a point."""
    away = np.array(apex) - wall.curve0.evaluate(U)
    return float(np.linalg.norm(np.cross(away, wall.rulings(U)), axis=1).max())


def test_the_rulings_of_a_cylinder_run_along_its_axis():
    wall = walls_between(loft(lambda z: circle(20.0), np.array([0.0, 10.0])), 1.0, 9.0).walls[0]
    assert wall.surface.rulings(U)[:, 2].min() > 1.0 - 1e-10
    assert wall.twist_max_rad < 1e-5


def test_the_rulings_of_a_cylinder_cut_by_tilted_planes_run_along_its_axis():
    body = loft(lambda z: circle(5.0), np.array([0.0, 20.0]))
    low = np.array([0.0, 0.0, 3.0, 0.0, np.sin(0.2), np.cos(0.2)])
    high = np.array([0.0, 0.0, 12.0, np.sin(0.15), 0.0, np.cos(0.15)])
    wall = walls_between(body, low, high).walls[0]
    assert wall.surface.rulings(U)[:, 2].min() > 1.0 - 1e-8
    assert wall.twist_max_rad < np.radians(0.02)


@pytest.mark.parametrize("lean", [(0.0, 0.0), (0.8, 0.3)], ids=["upright", "oblique"])
def test_the_rulings_of_a_cone_pass_its_apex(lean: tuple[float, float]):
    body = loft(lambda z: circle(10.0 * (1.0 - z / 25.0), 96, (lean[0] * z, lean[1] * z)), np.array([0.0, 15.0]))
    wall = walls_between(body, 1.0, 14.0).walls[0]
    assert misses(wall.surface, [25.0 * lean[0], 25.0 * lean[1], 25.0]) < 0.01
    assert wall.twist_max_rad < np.radians(0.2)


def test_the_rulings_of_a_pyramid_pass_its_apex_and_its_edges_stay_edges():
    body = loft(lambda z: square(20.0 * (1.0 - z / 30.0), 8), np.array([0.0, 15.0]))
    wall = walls_between(body, 1.0, 14.0).walls[0]
    assert misses(wall.surface, [0.0, 0.0, 30.0]) < 1e-9
    assert wall.twist_max_rad < 1e-9
    assert len(wall.surface.curve0.breaks) - 1 == 4


def test_corners_of_a_twisted_prism_are_joined_along_their_crease():
    body = loft(lambda z: square(20.0, 96, np.radians(5.0) * z / 20.0), np.linspace(0.0, 20.0, 41))
    walls = walls_between(body, 0.5, 19.5)
    chord = np.sqrt(200.0) * (1.0 - np.cos(np.radians(5.0) * 19.0 / 20.0 / 2.0))
    assert wall_deviation(walls, body).max_mm == pytest.approx(chord, rel=0.05)
    assert walls.walls[0].twist_max_rad == pytest.approx(np.radians(4.75), rel=0.01)


def test_a_wall_between_a_square_and_a_circle_follows_the_body_layer_by_layer():
    corners = square(20.0, 96)
    angle = np.arctan2(corners[:, 1], corners[:, 0])
    round_end = 10.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    body = loft(lambda z: corners * (1.0 - z / 20.0) + round_end * z / 20.0, np.linspace(0.0, 20.0, 41))
    for low in (0.0, 7.0, 19.0):
        walls = walls_between(body, low, low + 1.0)
        assert not walls.notes
        assert wall_deviation(walls, body).max_mm < 0.02


def test_walls_of_a_sphere_leave_it_by_the_chord_of_its_arc():
    body = Mesh.from_trimesh(trimesh.creation.icosphere(4, radius=20.0))
    low, high = 4.0, 7.0
    walls = walls_between(body, low, high)
    angle = np.arcsin(high / 20.0) - np.arcsin(low / 20.0)
    facets = 20.0 - np.linalg.norm(body.centroids, axis=1).min()
    measured = wall_deviation(walls, body)
    assert measured.max_mm == pytest.approx(20.0 * (1.0 - np.cos(0.5 * angle)), abs=1.2 * facets)
    assert measured.p99_mm <= measured.max_mm


def test_walls_start_and_end_on_the_contours_of_their_sections():
    body = loft(lambda z: circle(10.0, 96, (0.05 * z * z, 0.0)) * np.array([1.0, 0.7]), np.linspace(0.0, 10.0, 11))
    bottom, top = between(body, 2.3, 4.1)
    walls = walls_between(body, 2.3, 4.1)
    for loops, section in ((walls.bottom_loops, bottom), (walls.top_loops, top)):
        curve = section_curves(section, body)[0][0]
        assert closest_points(loops[0], curve.evaluate(U))[1].max() < 1e-6
        assert closest_points(curve, loops[0].evaluate(U))[1].max() < 1e-6
        assert np.abs(loops[0].control_points[:, 2] - section.origin[2]).max() < 1e-9


def test_both_contours_have_the_same_knots_and_close():
    walls = walls_between(Mesh.from_trimesh(trimesh.creation.annulus(5.0, 9.0, 10.0, sections=48)), -3.0, 3.0)
    assert len(walls.walls) == 2
    for wall in walls.walls:
        assert np.array_equal(wall.surface.curve0.knots, wall.surface.curve1.knots)
        assert wall.surface.curve0.is_closed and wall.surface.curve1.is_closed
    assert area_at(walls, 0.5) == pytest.approx(np.pi * (81.0 - 25.0), rel=1e-3)


def test_rulings_neither_cross_nor_go_back():
    body = loft(lambda z: circle(10.0, 96) * (1.0 + 0.3 * np.cos(5.0 * np.arange(96) / 96 * 2.0 * np.pi))[:, None]
                * (1.0 - z / 40.0), np.linspace(0.0, 10.0, 21))
    walls = walls_between(body, 1.0, 3.0)
    assert not walls.notes
    surface = walls.walls[0].surface
    for share in (0.25, 0.5, 0.75):
        points = surface.evaluate(U[:-1], share)
        step = np.roll(points, -1, axis=0) - points
        along = surface.curve0.derivatives(U[:-1], 1)[1]
        assert ((step * along).sum(axis=1) > 0.0).mean() > 0.97


def test_two_walls_that_lean_into_each_other_meet_where_they_must():
    disc = loft(lambda h: circle(1.0, 96), np.array([0.0, 1.0]))
    ring = walls_between(disc, 0.25, 0.75).walls[0].surface.curve0

    def leaning(start: float, end: float) -> RuledSurface:
        low, high = np.eye(4), np.eye(4)
        low[0, 3], high[:3, 3] = start, (end, 0.0, 5.0)
        return RuledSurface(ring.transformed(low), ring.transformed(high))

    contact = first_contact([leaning(-3.0, -0.5), leaning(3.0, 0.5)], np.eye(3)[:2])
    assert contact is not None and {contact.first, contact.second} == {0, 1}
    assert contact.share == pytest.approx((6.0 - 2.0) / (6.0 - 1.0), abs=2e-3)
    assert first_contact([leaning(-3.0, -1.2), leaning(3.0, 1.2)], np.eye(3)[:2]) is None


def test_layers_of_a_bend_between_planes_that_turn_follow_it_without_twist():
    whole = trimesh.creation.torus(20.0, 6.0, major_sections=128, minor_sections=64)
    quarter = trimesh.boolean.intersection(
        [whole, trimesh.creation.box(bounds=[(0.0, 0.0, -10.0), (40.0, 40.0, 10.0)])], engine="manifold"
    )
    body = Mesh.from_trimesh(quarter)

    def across(angle: float) -> np.ndarray:
        return np.array([0.0, 0.0, 0.0, -np.sin(angle), np.cos(angle), 0.0])

    low, high = 0.4, 0.6
    walls = walls_between(body, across(low), across(high))
    assert [group.kind for group in walls.matching.groups] == ["one_to_one"]
    assert not walls.notes
    chord = 26.0 * (1.0 - np.cos(0.5 * (high - low)))
    assert wall_deviation(walls, body).max_mm == pytest.approx(chord, rel=0.25)
    rulings = walls.walls[0].surface.rulings(U)
    tangent = np.array([-np.sin(0.5), np.cos(0.5), 0.0])
    assert (rulings @ tangent).min() > np.cos(0.01)
