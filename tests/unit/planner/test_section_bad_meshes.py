"""Sections of meshes that are degenerate, touch or cross themselves, lie far away or are tiny; and of many loops."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest
import shapely
import trimesh
from numpy.typing import NDArray

from planner.errors import MeshError
from planner.mesh import Mesh
from planner.slicing import Section, slice_mesh

Z = (0.0, 0.0, 1.0)
TILTED = (0.48, 0.6, 0.64)


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


def joined(*shapes: trimesh.Trimesh) -> Mesh:
    """All shapes in one mesh, equal vertices made one, nothing united."""
    return Mesh.from_trimesh(trimesh.util.concatenate(list(shapes)))


def cut(mesh: Mesh, z: float, side: str = "above") -> Section:
    return slice_mesh(mesh, [[0.0, 0.0, z, *Z]], side)[0]


def test_facets_without_area_and_slivers_change_nothing() -> None:
    sound = Mesh.from_trimesh(box((0, 0, 0), (4, 4, 4)))
    a, b, c = sound.facets[0]
    middle = 0.5 * (sound.vertices[a] + sound.vertices[b])
    new = len(sound.vertices)
    for shift in (0.0, 1e-13):
        vertices = np.vstack([sound.vertices, middle + shift])
        across = int(sound.adjacency[0, 0])
        apex = next(int(v) for v in sound.facets[across] if v not in (a, b))
        facets = np.vstack(
            [np.delete(sound.facets, [0, across], axis=0), [[a, new, c], [new, b, c], [b, new, apex], [new, a, apex]]]
        )
        flat = Mesh(vertices, np.vstack([facets, [[a, b, new], [a, new, b]]]))
        for z in (0.0, 1e-12, 1.3, float(middle[2]), 4.0 - 1e-12):
            assert cut(flat, z).area_mm2 == pytest.approx(cut(sound, z).area_mm2, abs=1e-9)


@pytest.mark.parametrize(
    ("second", "area"),
    [
        (box((4, 0, 0), (8, 4, 4)), 32.0),  # shares a wall
        (box((4, 4, 0), (8, 8, 4)), 32.0),  # shares an edge
        (box((4, 4, 4), (8, 8, 8)), 16.0),  # shares a corner
        (box((4, 1, 1), (8, 3, 3)), 24.0),  # a wall on part of a wall
        (box((0, 0, 0), (4, 4, 4)), 32.0),  # the same body twice
    ],
)
@pytest.mark.parametrize("side", ["above", "below"])
def test_bodies_that_touch_are_cut_into_closed_loops(second: trimesh.Trimesh, area: float, side: str) -> None:
    mesh = joined(box((0, 0, 0), (4, 4, 4)), second)
    for z in (1.5, 2.0, 2.9):
        assert cut(mesh, z, side).area_mm2 == pytest.approx(area)
    for z in (0.0, 1.0, 3.0, 4.0, 8.0):
        section = cut(mesh, z, side)
        assert all(len(loop.points) >= 3 for loop in section.loops)
        assert section.to_shapely().is_valid


def test_bodies_that_cross_count_once_like_their_union() -> None:
    rng = np.random.default_rng(8)
    for _ in range(6):
        shapes = [trimesh.creation.icosphere(subdivisions=2, radius=3.0) for _ in range(3)]
        for shape in shapes:
            shape.apply_translation(rng.uniform(-2, 2, 3))
        solids = [manifold3d.Manifold(manifold3d.Mesh64(s.vertices, s.faces.astype(np.uint64))) for s in shapes]
        union = manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add)
        for z in rng.uniform(-4, 4, 5).tolist():
            assert cut(joined(*shapes), z).to_shapely().area == pytest.approx(union.slice(z).area(), rel=1e-6, abs=1e-9)


def test_a_surface_turned_inside_out_in_part_is_refused_with_the_place() -> None:
    sound, inverted = box((0, 0, 0), (4, 4, 4)), box((10, 0, 0), (11, 1, 4))
    inverted.invert()
    with pytest.raises(MeshError, match=r"inside out or passes through itself: the plane .* near \(1[01], ") as refused:
        cut(joined(sound, inverted), 1.0)
    assert "\n" not in str(refused.value)


def test_an_edge_of_three_facets_is_refused_where_it_is_crossed_and_nowhere_else() -> None:
    shape = box((0, 0, 0), (4, 4, 4))
    fin = trimesh.Trimesh([[0, 0, 1], [0, 0, 3], [-2, -2, 2]], [[0, 1, 2]], process=False)
    mesh = joined(shape, fin)
    assert cut(mesh, 0.5).area_mm2 == pytest.approx(16.0)
    with pytest.raises(MeshError, match=r"not closed: .* crosses an open edge of facet \d+ at \("):
        cut(mesh, 2.0)


@pytest.mark.parametrize("size", [0.1, 1e-3, 1.0, 1e5])
@pytest.mark.parametrize("normal", [Z, TILTED])
def test_a_part_of_any_size_has_the_same_sections_to_scale(size: float, normal: tuple[float, float, float]) -> None:
    unit = trimesh.creation.torus(0.5, 0.2, 24, 12)
    here, there = Mesh.from_trimesh(unit), Mesh(size * np.array(unit.vertices), np.array(unit.faces))
    levels = np.linspace(-0.6, 0.6, 21)
    at = [np.column_stack([s * levels[:, None] * normal, np.tile(normal, (21, 1))]) for s in (1.0, size)]
    for one, other in zip(slice_mesh(here, at[0]), slice_mesh(there, at[1]), strict=True):
        assert len(one.loops) == len(other.loops)
        assert other.area_mm2 == pytest.approx(size**2 * one.area_mm2, rel=1e-9, abs=1e-9 * size**2)


@pytest.mark.parametrize("normal", [Z, TILTED])
@pytest.mark.parametrize("size", [0.1, 10.0])
def test_a_part_a_kilometre_from_the_origin_has_its_sections_there(
    size: float, normal: tuple[float, float, float]
) -> None:
    far = np.array([1e6, -1e6, 1e6])
    unit = trimesh.creation.torus(0.5 * size, 0.2 * size, 24, 12)
    rounded = np.array(unit.vertices) + far  # doubles there are 1e-10 mm apart
    here, there = Mesh(rounded - far, np.array(unit.faces)), Mesh(rounded, np.array(unit.faces))
    levels = np.linspace(-0.4 * size, 0.4 * size, 11) + 1e-4 * size
    planes = np.column_stack([levels[:, None] * normal, np.tile(normal, (11, 1))])
    moved = planes + np.array([*far, 0, 0, 0])
    for one, other in zip(slice_mesh(here, planes), slice_mesh(there, moved), strict=True):
        assert len(one.loops) == len(other.loops)
        assert other.area_mm2 == pytest.approx(one.area_mm2, rel=1e-6, abs=1e-8 * size)


def plate_with_holes(count: int) -> tuple[Mesh, NDArray[np.float64]]:
    """A plate with count x count square holes, each with a pin in it; areas of plate, a hole and a pin."""
    plate = box((0, 0, 0), (4.0 * count, 4.0 * count, 1))
    shapes = [plate]
    for i in range(count):
        for k in range(count):
            hole = box((4.0 * i + 1, 4.0 * k + 1, 0.1), (4.0 * i + 3, 4.0 * k + 3, 0.9))
            hole.invert()
            shapes += [hole, box((4.0 * i + 1.5, 4.0 * k + 1.5, 0.2), (4.0 * i + 2.5, 4.0 * k + 2.5, 0.8))]
    return joined(*shapes), np.array([16.0 * count**2, -4.0, 1.0])


@pytest.mark.parametrize("count", [2, 3, 25])
def test_pins_in_holes_in_a_plate_are_nested_few_or_many(count: int) -> None:
    mesh, areas = plate_with_holes(count)
    section = cut(mesh, 0.5)
    assert len(section.loops) == 1 + 2 * count**2
    for loop in section.loops:
        kind = int(np.argmin(np.abs(areas - loop.area_mm2)))
        if kind == 0:
            assert loop.parent == -1
            continue
        outer = section.loops[loop.parent]
        assert outer.area_mm2 == pytest.approx(areas[kind - 1])
        assert shapely.Polygon(outer.xy).contains(shapely.Polygon(loop.xy))


def test_a_vertex_that_many_facets_share_costs_linear_time() -> None:
    count = 200_000
    turn = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    rim = np.column_stack([10.0 * np.cos(turn), 10.0 * np.sin(turn), np.zeros(count)])
    following = np.roll(np.arange(count), -1) + 2
    facets = np.vstack(
        [
            np.column_stack([np.zeros(count, np.int64), np.arange(count) + 2, following]),
            np.column_stack([np.ones(count, np.int64), following, np.arange(count) + 2]),
        ]
    )
    cone = Mesh(np.vstack([[[0, 0, 5.0], [0, 0, -5.0]], rim]), facets)
    assert cut(cone, 2.5).area_mm2 == pytest.approx(np.pi * 25.0, rel=1e-6)
