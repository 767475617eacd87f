"""Approximations close into watertight bodies that lie within the cusp of the part, both ways."""

from __future__ import annotations

from collections.abc import Callable

import manifold3d
import numpy as np
import pytest
import trimesh

from planner.errors import RecipeError
from planner.mesh.mesh import Mesh
from planner.mesh.selfcross import crossing_facets
from planner.model import Approximation, approximate
from planner.model.measuring import two_way
from tests.unit.planner.matching_shapes import box, circle, loft, united

UP = (0.0, 0.0, 1.0)


def sphere() -> Mesh:
    return Mesh.from_trimesh(trimesh.creation.icosphere(4, radius=20.0))


def cone() -> Mesh:
    return loft(lambda z: circle(10.0 * (1.0 - z / 25.0), 64), np.array([0.0, 15.0]))


def cylinder() -> Mesh:
    return loft(lambda z: circle(20.0), np.array([0.0, 10.0]))


def lying_torus() -> Mesh:
    return Mesh.from_trimesh(trimesh.creation.torus(20.0, 6.0, major_sections=64, minor_sections=32))


def table() -> Mesh:
    legs = [box((x, y, 0.0), (x + 2.0, y + 2.0, 11.0)) for x in (0.0, 10.0) for y in (0.0, 6.0)]
    return united(box((-1.0, -1.0, 10.0), (13.0, 9.0, 12.0)), *legs)


def fork() -> Mesh:
    stem = box((-4.0, -3.0, 0.0), (4.0, 3.0, 8.0))
    arms = [trimesh.creation.cylinder(2.5, segment=[[0, 0, 5], [x, 0, 20]], sections=32) for x in (-8.0, 8.0)]
    return united(stem, *arms)


def stepped() -> Mesh:
    """Ledges at 5 and 7, top at 9, a blind hole of radius 3 from the top down to 3."""
    solid = united(
        box((0.0, 0.0, 0.0), (30.0, 20.0, 5.0)), box((5.0, 5.0, 4.0), (20.0, 15.0, 9.0)),
        box((20.0, 0.0, 4.0), (30.0, 20.0, 7.0)),
    )  # fmt: skip
    hole = trimesh.creation.cylinder(3.0, segment=[[12, 10, 3], [12, 10, 12]], sections=64)
    return Mesh.from_trimesh(trimesh.boolean.difference([solid.to_trimesh(), hole], engine="manifold"))


def assert_sound(made: Approximation, mesh: Mesh) -> None:
    """Watertight, oriented, of the mesh's topology, without self-crossings, within the cusp both ways."""
    model = made.triangles()
    body = model.to_trimesh()
    assert body.is_watertight and body.is_winding_consistent
    assert body.euler_number == mesh.to_trimesh().euler_number
    solid = manifold3d.Manifold(manifold3d.Mesh64(np.array(model.vertices), np.array(model.facets).astype(np.uint64)))
    assert solid.status() == manifold3d.Error.NoError
    assert solid.volume() == pytest.approx(model.volume, rel=1e-6)
    assert not len(crossing_facets(model)[0])
    assert made.deviation().max_mm <= made.cusp_mm


@pytest.mark.parametrize(
    ("shape", "cusp_mm", "most_layers"),
    [
        (sphere, 0.16, 15),
        (cylinder, 0.05, 1),
        (cone, 0.05, 1),
        (lying_torus, 0.2, 8),
        (table, 0.05, 2),
        (stepped, 0.05, 4),
    ],
)
def test_a_model_is_watertight_and_within_the_cusp(shape: Callable[[], Mesh], cusp_mm: float, most_layers: int):
    mesh = shape()
    made = approximate(mesh, UP, cusp_mm)
    assert_sound(made, mesh)
    assert made.counts.layers <= most_layers
    assert not made.notes


@pytest.mark.parametrize(("shape", "cusp_mm"), [(cone, 0.3), (lying_torus, 0.4)])
def test_a_staircase_model_is_watertight_and_within_the_cusp(shape: Callable[[], Mesh], cusp_mm: float):
    mesh = shape()
    assert_sound(approximate(mesh, UP, cusp_mm, rule="extruded"), mesh)


def test_arms_that_leave_a_stem_make_one_body():
    mesh = fork()
    made = approximate(mesh, UP, 0.15)
    assert_sound(made, mesh)
    assert made.counts.branchings >= 1


def test_level_faces_are_planar_faces_of_the_model_with_their_area():
    made = approximate(stepped(), UP, 0.05)
    model = made.triangles()
    top = np.abs(model.normals[:, 2] - 1.0) < 1e-9
    height = model.centroids[top, 2]
    hole = 0.5 * 64 * 9.0 * np.sin(2.0 * np.pi / 64)
    for level, area in ((3.0, hole), (5.0, 600.0 - 150.0 - 200.0), (7.0, 200.0), (9.0, 150.0 - hole)):
        assert model.areas[top][np.abs(height - level) < 1e-6].sum() == pytest.approx(area, abs=0.1)


def test_any_build_direction_gives_a_closed_model():
    mesh = cylinder()
    assert_sound(approximate(mesh, (1.0, 2.0, 2.0), 0.2), mesh)


def test_the_measure_agrees_with_a_known_offset_and_with_trimesh():
    inner, outer = (Mesh.from_trimesh(trimesh.creation.box((size, size, size))) for size in (10.0, 10.2))
    found = two_way(outer, inner)
    assert found.max_mm == pytest.approx(0.1 * np.sqrt(3.0))
    assert found.mesh_to_model_mm == pytest.approx(0.1)
    assert found.volume_error == pytest.approx(1.02**3 - 1.0)
    points = outer.vertices * np.array([1.0, 0.3, 0.7])
    from planner.mesh.nearest import FacetTree

    expected = trimesh.proximity.closest_point_naive(inner.to_trimesh(), points)[1]
    np.testing.assert_allclose(FacetTree(inner).nearest(points)[0], expected, atol=1e-12)


@pytest.mark.parametrize(
    ("direction", "cusp_mm", "rule"), [((0.0, 0.0, 0.0), 0.1, "ruled"), (UP, 0.0, "ruled"), (UP, 0.1, "wavy")]
)
def test_numbers_without_sense_are_refused(direction: tuple[float, float, float], cusp_mm: float, rule: str):
    with pytest.raises(RecipeError):
        approximate(cylinder(), direction, cusp_mm, rule=rule)  # type: ignore[arg-type]
