"""Which contours belong together, and walls where contours begin, end, part and join."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import trimesh

from planner.errors import PlanningError
from planner.matching import LayerWalls, match_sections, wall_deviation
from planner.matching.contact import first_contact
from planner.mesh.mesh import Mesh
from planner.slicing import slice_mesh
from tests.unit.planner.matching_shapes import (
    area_at,
    between,
    box,
    circle,
    divided_between,
    loft,
    united,
    walls_between,
)


@pytest.fixture(scope="module")
def table() -> Mesh:
    """A table: four legs 10 high under a top 2 thick."""
    legs = [box((x, y, 0.0), (x + 2.0, y + 2.0, 11.0)) for x in (0.0, 10.0) for y in (0.0, 6.0)]
    return united(box((-1.0, -1.0, 10.0), (13.0, 9.0, 12.0)), *legs)


@pytest.fixture(scope="module")
def fork() -> Mesh:
    """A stem of radius 4 that parts into two leaning arms of radius 2.5."""
    stem = trimesh.creation.cylinder(4.0, segment=[[0, 0, 0], [0, 0, 8]], sections=64)
    arms = [trimesh.creation.cylinder(2.5, segment=[[0, 0, 7], [x, 0, 20]], sections=64) for x in (-8.0, 8.0)]
    return united(stem, *arms)


@pytest.fixture(scope="module")
def ring() -> Mesh:
    """A torus with its axis along z."""
    return Mesh.from_trimesh(trimesh.creation.torus(20.0, 6.0, major_sections=64, minor_sections=32))


def turned(mesh: Mesh) -> Mesh:
    """The mesh with its x axis up."""
    matrix = np.eye(4)
    matrix[:3, :3] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    return mesh.transformed(matrix)


def assert_solid(layers: tuple[LayerWalls, ...], mesh: Mesh, area_rel: float) -> None:
    """Rings are apart and enclose about the mesh's area half-way up every layer in which nothing begins or ends."""
    for layer in layers:
        assert not layer.notes
        assert first_contact([wall.surface for wall in layer.walls], np.eye(3)[:2]) is None
        if not all(wall.bottom and wall.top for wall in layer.walls):
            continue
        middle = 0.5 * (layer.bottom_plane + layer.top_plane)
        assert area_at(layer, 0.5) == pytest.approx(slice_mesh(mesh, middle)[0].area_mm2, rel=area_rel, abs=0.02)


def test_a_facet_in_both_contours_makes_a_direct_match():
    body = Mesh.from_trimesh(trimesh.creation.annulus(5.0, 9.0, 10.0, sections=32))
    found = match_sections(body, *between(body, -3.0, 3.0))
    assert found.direct_count == 2 and found.indirect_count == 0
    assert all(group.kind == "one_to_one" for group in found.groups)


def test_contours_without_a_common_facet_are_matched_by_the_climb():
    body = loft(lambda z: circle(5.0, 48), np.linspace(0.0, 10.0, 41))
    found = match_sections(body, *between(body, 1.1, 8.9))
    assert [(pair.bottom, pair.top, pair.how) for pair in found.pairs] == [(0, 0, "indirect")]


def test_equal_pillars_are_matched_to_themselves_and_not_to_their_neighbours():
    pillars = [loft(lambda z, n=n: circle(1.0, 24, (3.0 * n, 2.4 * z)), np.linspace(0.0, 5.0, 26)) for n in range(5)]
    count = np.cumsum([0, *[len(pillar.vertices) for pillar in pillars]])
    body = Mesh(
        np.vstack([pillar.vertices for pillar in pillars]),
        np.vstack([pillar.facets + start for pillar, start in zip(pillars, count[:-1], strict=True)]),
    )
    bottom, top = between(body, 0.3, 4.7)
    for pair in match_sections(body, bottom, top).pairs:
        first, second = bottom.loops[pair.bottom].points.mean(axis=0), top.loops[pair.top].points.mean(axis=0)
        assert abs(first[0] - second[0]) < 1e-6


def test_planes_that_meet_inside_the_part_are_refused_with_the_place():
    body = loft(lambda z: circle(5.0), np.array([0.0, 10.0]))
    tilted = np.array([0.0, 0.0, 5.5, np.sin(0.3), 0.0, np.cos(0.3)])
    with pytest.raises(PlanningError, match=r"meet inside the part, near \("):
        match_sections(body, *between(body, 5.0, tilted))


def test_four_legs_join_in_a_top_that_starts_in_the_layer(table: Mesh):
    found = match_sections(table, *between(table, 9.0, 11.0))
    assert [(len(group.bottom), len(group.top), group.kind) for group in found.groups] == [(4, 1, "merge")]
    walls = walls_between(table, 9.0, 11.0)
    assert [wall.how for wall in walls.walls] == ["swept"] * 4
    assert area_at(walls, 0.0) == pytest.approx(16.0) and area_at(walls, 1.0) == pytest.approx(16.0)


def test_a_layer_over_the_start_of_a_top_is_divided_there(table: Mesh):
    layers = divided_between(table, 9.0, 11.0)
    assert [layer.top_plane[2] for layer in layers] == [pytest.approx(10.0), pytest.approx(11.0)]
    assert [len(layer.walls) for layer in layers] == [4, 1]
    assert_solid(layers, table, 1e-6)
    assert max(wall_deviation(layer, table).max_mm for layer in layers) < 1e-6


def test_a_stem_that_parts_is_swept_down_from_its_branches(fork: Mesh):
    walls = walls_between(fork, 5.0, 16.0)
    assert [group.kind for group in walls.matching.groups] == ["diverge"]
    assert [wall.how for wall in walls.walls] == ["swept", "swept"]
    assert not walls.notes


def test_a_stem_that_parts_is_followed_once_divided(fork: Mesh):
    layers = tuple(walls for low in range(0, 17) for walls in divided_between(fork, float(low), low + 1.0))
    assert all(group.kind == "one_to_one" for walls in layers for group in walls.matching.groups)
    assert_solid(layers, fork, 0.02)


def test_a_pocket_opens_as_a_hole_and_is_followed_from_its_floor():
    body = Mesh.from_trimesh(
        trimesh.boolean.difference([box((0, 0, 0), (20, 20, 10)), box((5, 5, 4), (15, 15, 11))], engine="manifold")
    )
    bottom, top = between(body, 3.0, 6.0)
    kinds = {group.kind for group in match_sections(body, bottom, top).groups}
    assert kinds == {"one_to_one", "hole_opens"}
    layers = divided_between(body, 3.0, 6.0)
    assert [len(layer.walls) for layer in layers] == [1, 2]
    assert_solid(layers, body, 1e-6)


def test_a_sphere_begins_and_ends_in_a_point():
    body = Mesh.from_trimesh(trimesh.creation.icosphere(4, radius=20.0))
    low, high = float(body.bounds[0, 2]), float(body.bounds[1, 2])
    first, last = walls_between(body, low, low + 0.3), walls_between(body, high - 0.3, high)
    assert [group.kind for group in first.matching.groups] == ["begin"]
    assert [group.kind for group in last.matching.groups] == ["end"]
    for walls in (first, last):
        assert wall_deviation(walls, body).max_mm < 0.5 * 0.3
    assert area_at(first, 0.0) < 0.01 * area_at(first, 1.0)


def test_a_lying_ring_begins_with_an_outer_contour_and_a_hole(ring: Mesh):
    layers = tuple(walls for low in np.linspace(-6.0, 5.0, 12) for walls in divided_between(ring, float(low), low + 1.0))
    assert all(len(walls.walls) == 2 for walls in layers)
    assert {wall.how for wall in layers[0].walls} <= {"swept", "direct", "indirect"}
    assert_solid(layers[1:-1], ring, 0.05)
    assert max(wall.twist_max_rad for walls in layers for wall in walls.walls) < np.radians(1.0)


def test_a_standing_ring_parts_joins_and_ends(ring: Mesh):
    standing = turned(ring)
    edges = np.linspace(-26.0, 26.0, 27)
    layers = tuple(
        walls for low, high in pairwise(edges) for walls in divided_between(standing, float(low), float(high))
    )
    assert {len(walls.walls) for walls in layers} == {1, 2}
    assert_solid(layers, standing, 0.06)


def test_a_bore_that_opens_into_a_face_is_met_where_it_begins():
    bore = trimesh.creation.cylinder(4.0, segment=[[10, -1, 10], [10, 12, 10]], sections=48)
    body = Mesh.from_trimesh(trimesh.boolean.difference([box((0, 0, 0), (20, 20, 20)), bore], engine="manifold"))
    layers = divided_between(body, 5.0, 7.0)
    assert len(layers) == 2 and layers[0].top_plane[2] == pytest.approx(6.0, abs=0.01)
    assert wall_deviation(layers[0], body).max_mm < 1e-6
    assert wall_deviation(layers[1], body).max_mm < 0.3
