"""What holds for every section of every closed mesh, whatever the plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from planner.mesh import Mesh, load
from planner.slicing import Section, slice_mesh

PARTS = Path(__file__).resolve().parents[2] / "config" / "parts"
SHAPES = {
    "torus": Mesh.from_trimesh(trimesh.creation.torus(10.0, 3.0, 24, 12)),
    "capsule": Mesh.from_trimesh(trimesh.creation.capsule(height=8.0, radius=3.0, count=[12, 12])),
    "cube": Mesh.from_trimesh(trimesh.creation.box((4, 4, 4))),
    "hinge": load(PARTS / "hinge.stl"),
    "bearing": load(PARTS / "bearing.stl"),
}
shapes = st.sampled_from(sorted(SHAPES))
components = st.integers(-4, 4)  # small whole numbers meet vertices, edges and faces on purpose
directions = st.tuples(components, components, components).filter(any)
reals = st.floats(-1.0, 1.0)
free_directions = st.tuples(reals, reals, reals).filter(lambda v: np.linalg.norm(v) > 0.1)


def unit(direction: tuple[float, float, float]) -> NDArray[np.float64]:
    return np.asarray(direction, dtype=float) / np.linalg.norm(direction)


def parallel(mesh: Mesh, normal: NDArray[np.float64], count: int) -> tuple[NDArray[np.float64], float]:
    """Planes in the middle of even slabs, and the thickness of a slab."""
    along = mesh.vertices @ normal
    edges = np.linspace(along.min(), along.max(), count + 1)
    middles = 0.5 * (edges[1:] + edges[:-1])
    return np.column_stack([middles[:, None] * normal, np.tile(normal, (count, 1))]), float(edges[1] - edges[0])


def check(mesh: Mesh, section: Section) -> None:
    """Closed, clean, oriented, nested."""
    for loop in section.loops:
        steps = np.linalg.norm(np.roll(loop.points, -1, axis=0) - loop.points, axis=1)
        assert len(loop.points) >= 3
        assert steps.min() > 0.0
        across = mesh.adjacency[loop.facets]
        following = np.roll(loop.facets, -1)
        assert len(loop.facets) == len(loop.points) == len(loop.edges) == len(loop.weights)
        assert ((across == following[:, None]).any(axis=1) | (loop.weights == np.rint(loop.weights)).any()).all()
        if loop.parent >= 0:
            outer = section.loops[loop.parent]
            assert outer.is_hole != loop.is_hole
            assert abs(outer.area_mm2) > abs(loop.area_mm2)
        else:
            assert not loop.is_hole


@settings(max_examples=20)
@given(shapes, free_directions)
def test_the_areas_of_even_sections_integrate_to_the_volume(name: str, direction: tuple[float, float, float]) -> None:
    mesh, normal = SHAPES[name], unit(direction)
    planes, thickness = parallel(mesh, normal, 300)
    sections = slice_mesh(mesh, planes)
    assert sum(section.area_mm2 for section in sections) * thickness == pytest.approx(mesh.volume, rel=5e-3)


@settings(max_examples=60)
@given(shapes, directions, st.integers(0, 10_000), st.sampled_from(["above", "below"]))
def test_planes_through_vertices_give_closed_oriented_nested_loops(
    name: str, direction: tuple[int, int, int], vertex: int, side: str
) -> None:
    mesh, normal = SHAPES[name], unit(direction)
    point = mesh.vertices[vertex % len(mesh.vertices)]
    (section,) = slice_mesh(mesh, [[*point, *normal]], side)
    check(mesh, section)
    assert section.to_shapely().area == pytest.approx(section.area_mm2, rel=1e-9, abs=1e-9)


@settings(max_examples=30)
@given(shapes, directions, st.integers(0, 10_000))
def test_a_plane_through_a_vertex_is_the_limit_of_the_planes_beside_it(
    name: str, direction: tuple[int, int, int], vertex: int
) -> None:
    mesh, normal = SHAPES[name], unit(direction)
    point = mesh.vertices[vertex % len(mesh.vertices)]
    step = 1e-6 * normal
    exact = [slice_mesh(mesh, [[*point, *normal]], side)[0] for side in ("above", "below")]
    beside = slice_mesh(mesh, [[*(point + step), *normal], [*(point - step), *normal]])
    for limit, near in zip(exact, beside, strict=True):
        assert limit.area_mm2 == pytest.approx(near.area_mm2, rel=1e-4, abs=1e-3)
        reach = [np.abs((loop.points - point) @ normal).max() for loop in limit.loops]
        assert max(reach, default=0.0) < 1e-6


@settings(max_examples=20)
@given(shapes, directions, free_directions, st.floats(0.0, 6.2))
def test_a_turned_part_has_turned_sections(
    name: str, direction: tuple[int, int, int], axis: tuple[float, float, float], angle: float
) -> None:
    mesh, normal = SHAPES[name], unit(direction)
    turn = trimesh.transformations.rotation_matrix(angle, axis)
    planes, _ = parallel(mesh, normal, 7)
    planes[:, :3] += 1.7e-5 * normal
    turned = np.column_stack([planes[:, :3] @ turn[:3, :3].T, planes[:, 3:] @ turn[:3, :3].T])
    turned[:, 3:] /= np.linalg.norm(turned[:, 3:], axis=1)[:, None]
    for before, after in zip(slice_mesh(mesh, planes), slice_mesh(mesh.transformed(turn), turned), strict=True):
        assert after.area_mm2 == pytest.approx(before.area_mm2, rel=1e-6, abs=1e-6)
        assert len(after.loops) == len(before.loops)
        check(mesh, after)
