"""Sections against analytic truth: solids cut through faces, edges, vertices and nothing at all."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh
from numpy.typing import ArrayLike

from planner.errors import InputError, MeshError
from planner.mesh import Mesh, load
from planner.slicing import Section, slice_mesh, slicer

ROOT = Path(__file__).resolve().parents[3]
PARTS = ROOT / "config" / "parts"
CUBE = Mesh.from_trimesh(trimesh.creation.box((2, 2, 2)))
DIAGONAL = np.ones(3) / np.sqrt(3.0)


def cut(mesh: Mesh, point: ArrayLike, normal: ArrayLike, side: str = "above") -> Section:
    unit = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
    return slice_mesh(mesh, [[*np.asarray(point, dtype=float), *unit]], side)[0]


def test_a_plane_across_a_cube_gives_one_square_counter_clockwise() -> None:
    section = cut(CUBE, (0, 0, 0.3), (0, 0, 1))
    (loop,) = section.loops
    assert section.area_mm2 == pytest.approx(4.0)
    assert not loop.is_hole
    assert loop.length_mm == pytest.approx(8.0)
    assert loop.polygon2d().exterior.is_ccw


def test_every_point_lies_on_its_edge_and_every_segment_in_its_facet() -> None:
    mesh = load(PARTS / "hinge.stl")
    normal = np.array([0.48, 0.6, 0.64])
    for section in slice_mesh(mesh, [[30, 24, z, *normal] for z in (5.0, 14.0, 20.0)]):
        assert section.loops
        for loop in section.loops:
            a, b = mesh.vertices[loop.edges[:, 0]], mesh.vertices[loop.edges[:, 1]]
            assert (loop.edges[:, 0] < loop.edges[:, 1]).all()
            np.testing.assert_allclose(loop.points, a + loop.weights[:, None] * (b - a), atol=1e-12)
            np.testing.assert_allclose((loop.points - section.origin) @ section.normal, 0.0, atol=1e-9)
            following = np.roll(loop.points, -1, axis=0)
            flat = np.einsum("ij,ij->i", following - loop.points, mesh.normals[loop.facets])
            np.testing.assert_allclose(flat, 0.0, atol=1e-7)
            corners = mesh.facets[loop.facets]
            assert (corners[:, :, None] == loop.edges[:, None, :]).any(axis=1).all()


def test_material_lies_on_the_left_of_every_segment() -> None:
    mesh = load(PARTS / "pipe.stl")
    section = cut(mesh, (5.5, 0, 0), (1, 0, 0))
    for loop in section.loops:
        along = np.roll(loop.points, -1, axis=0) - loop.points
        left = np.cross(section.normal, along)
        assert (np.einsum("ij,ij->i", left, mesh.normals[loop.facets]) < 0).all()


def test_a_flat_face_in_the_plane_belongs_to_the_side_that_was_asked_for() -> None:
    areas = {
        (side, z): cut(CUBE, (0, 0, z), (0, 0, 1), side).area_mm2 for side in ("above", "below") for z in (-1.0, 1.0)
    }
    assert areas == pytest.approx(
        {("above", -1.0): 4.0, ("above", 1.0): 0.0, ("below", -1.0): 0.0, ("below", 1.0): 4.0}
    )


def test_a_step_in_the_plane_gives_the_narrow_or_the_wide_half() -> None:
    low = trimesh.creation.box(bounds=[[0, 0, 0], [4, 4, 1]])
    high = trimesh.creation.box(bounds=[[1, 1, 1], [3, 3, 2]])
    stepped = Mesh.from_trimesh(trimesh.boolean.union([low, high], engine="manifold"))
    assert cut(stepped, (0, 0, 1), (0, 0, 1), "above").area_mm2 == pytest.approx(4.0)
    assert cut(stepped, (0, 0, 1), (0, 0, 1), "below").area_mm2 == pytest.approx(16.0)


def test_turning_the_plane_over_swaps_the_sides_and_keeps_the_area() -> None:
    assert cut(CUBE, (0, 0, 1), (0, 0, -1), "above").area_mm2 == pytest.approx(4.0)
    assert cut(CUBE, (0, 0, 1), (0, 0, -1), "below").area_mm2 == 0.0


@pytest.mark.parametrize("side", ["above", "below"])
def test_planes_through_vertices_and_edges_give_exact_corners_once(side: str) -> None:
    through_edges = cut(CUBE, (0, 0, 0), (1, 0, 1), side)
    assert through_edges.area_mm2 == pytest.approx(4.0 * np.sqrt(2.0))
    through_vertices = cut(CUBE, (1, 1, -1), DIAGONAL, side)
    assert through_vertices.area_mm2 == pytest.approx(2.0 * np.sqrt(3.0))
    for section in (through_edges, through_vertices):
        (loop,) = section.loops
        steps = np.linalg.norm(np.roll(loop.points, -1, axis=0) - loop.points, axis=1)
        assert steps.min() > 0.5
    on_corner = np.abs(np.abs(through_vertices.loops[0].points) - 1.0).max(axis=1) == 0.0
    assert on_corner.sum() == 3


def test_planes_that_touch_a_vertex_or_an_edge_give_nothing() -> None:
    for side in ("above", "below"):
        assert cut(CUBE, (1, 1, 1), DIAGONAL, side).loops == []
        assert cut(CUBE, (1, 0, 1), (1, 0, 1), side).loops == []
        assert cut(CUBE, (0, 0, 5), (0, 0, 1), side).loops == []


def test_a_valley_that_touches_the_plane_leaves_no_spike() -> None:
    profile = np.array([[0, 0], [10, 0], [10, 6], [7, 6], [5, 2], [3, 6], [0, 6]], dtype=float)
    solid = Mesh.from_trimesh(trimesh.creation.extrude_polygon(shapely.Polygon(profile), 4.0, engine="manifold"))
    upright = solid.transformed([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    for side, loops in (("above", 2), ("below", 1)):
        section = cut(upright, (0, 0, 2), (0, 0, 1), side)
        assert section.area_mm2 == pytest.approx(40.0)
        assert len(section.loops) == loops
        assert section.to_shapely().area == pytest.approx(40.0)


def test_sphere_sections_have_the_radius_and_area_of_circles() -> None:
    ball = Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=5, radius=10.0))
    heights = np.linspace(-9.5, 9.5, 21)
    planes = np.column_stack([heights[:, None] * DIAGONAL, np.tile(DIAGONAL, (21, 1))])
    for height, section in zip(heights, slice_mesh(ball, planes), strict=True):
        radius = np.sqrt(100.0 - height**2)
        (loop,) = section.loops
        assert section.area_mm2 == pytest.approx(np.pi * radius**2, rel=4e-3)
        reach = np.linalg.norm(loop.points - height * DIAGONAL, axis=1)
        assert reach.max() <= radius + 1e-9
        assert reach.min() > radius - 0.02


@pytest.mark.parametrize("name", ["bearing", "double_arc", "hinge", "pipe"])
def test_planes_through_every_vertex_height_of_the_parts_close_on_both_sides(name: str) -> None:
    mesh = load(PARTS / f"{name}.stl")
    for axis in np.eye(3):
        heights = np.unique(mesh.vertices @ axis)[:: max(1, len(mesh.vertices) // 400)]
        planes = np.column_stack([heights[:, None] * axis, np.tile(axis, (len(heights), 1))])
        for side in ("above", "below"):
            for section in slice_mesh(mesh, planes, side):
                assert section.to_shapely().area == pytest.approx(section.area_mm2, rel=1e-9, abs=1e-9)


def test_many_planes_of_many_orientations_come_back_in_order() -> None:
    rng = np.random.default_rng(3)
    normals = rng.normal(size=(40, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    planes = np.column_stack([rng.uniform(-0.5, 0.5, (40, 3)), normals[rng.integers(0, 12, 40)]])
    together = slice_mesh(CUBE, planes)
    for plane, section in zip(planes, together, strict=True):
        alone = slice_mesh(CUBE, plane[None])[0]
        np.testing.assert_array_equal(section.plane, plane)
        assert [loop.points.tobytes() for loop in section.loops] == [loop.points.tobytes() for loop in alone.loops]


def test_planes_cut_in_portions_give_the_same_sections(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = load(PARTS / "hinge.stl")
    heights = np.random.default_rng(5).permutation(np.linspace(1.0, 27.0, 23))
    planes = np.column_stack([np.zeros((23, 2)), heights, np.tile([0.0, 0.0, 1.0], (23, 1))])
    whole = slice_mesh(mesh, planes)
    monkeypatch.setattr(slicer, "MAX_PAIRS", 500)
    for one, other in zip(whole, slice_mesh(mesh, planes), strict=True):
        assert [loop.points.tobytes() for loop in one.loops] == [loop.points.tobytes() for loop in other.loops]
        assert [loop.parent for loop in one.loops] == [loop.parent for loop in other.loops]


def test_frames_are_right_handed_and_lift_undoes_flatten() -> None:
    for normal in np.vstack([np.eye(3), -np.eye(3), [[0.6, 0.0, 0.8], [0.48, 0.6, 0.64]]]):
        section = cut(CUBE, (0.1, 0.2, 0.05), normal)
        u, v, w = section.frame[1:]
        np.testing.assert_allclose(np.cross(u, v), w, atol=1e-15)
        loop = section.loops[0]
        np.testing.assert_allclose(section.lift(loop.xy), loop.points, atol=1e-12)
        np.testing.assert_allclose(section.flatten(loop.points), loop.xy, atol=1e-12)


def test_a_trimesh_is_cut_like_our_mesh() -> None:
    shape = trimesh.creation.box((2, 2, 2))
    loose = trimesh.Trimesh(shape.triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False)
    for source in (shape, loose):
        assert slice_mesh(source, [[0, 0, 0, 0, 0, 1]])[0].area_mm2 == pytest.approx(4.0)


def test_no_planes_give_no_sections() -> None:
    assert slice_mesh(CUBE, np.empty((0, 6))) == []


def test_an_open_mesh_is_refused_with_plane_and_place_where_the_plane_meets_the_hole() -> None:
    mesh = load(PARTS / "pipe.stl")
    lost = int(np.argmax(mesh.centroids[:, 2]))
    opened = Mesh(mesh.vertices, np.delete(mesh.facets, lost, axis=0))
    with pytest.raises(
        MeshError, match=r"not closed: the plane .* \(number 1\) crosses an open edge of facet \d+ at \("
    ):
        slice_mesh(opened, [[0, 0, 10, 0, 0, 1], [*mesh.centroids[lost], 0, 0, 1]])
    assert slice_mesh(opened, [[0, 0, 10, 0, 0, 1]])[0].area_mm2 > 0


def test_an_inverted_mesh_is_refused() -> None:
    with pytest.raises(MeshError, match="inside out"):
        slice_mesh(Mesh(CUBE.vertices, CUBE.facets[:, ::-1]), [[0, 0, 0, 0, 0, 1]])


@pytest.mark.parametrize(
    ("planes", "words"),
    [
        ([[0, 0, 0, 0, 0, 2.0]], "length 2"),
        ([[0, 0, np.nan, 0, 0, 1.0]], "not finite"),
        ([[0, 0, 0, 1.0]], r"\(k, 6\)"),
    ],
)
def test_planes_that_are_none_are_refused(planes: ArrayLike, words: str) -> None:
    with pytest.raises(InputError, match=words):
        slice_mesh(CUBE, planes)


def test_the_kernels_give_the_same_without_compilation() -> None:
    program = (
        "import numpy as np, trimesh\n"
        "from planner.mesh import Mesh\n"
        "from planner.slicing import slice_mesh\n"
        "mesh = Mesh.from_trimesh(trimesh.creation.torus(10, 3, 16, 8))\n"
        "w = np.array([0.48, 0.6, 0.64])\n"
        "for s in slice_mesh(mesh, [[0, 0, z, *w] for z in (-3.0, 0.0, 2.0)]):\n"
        "    print([(loop.parent, loop.area_mm2.hex(), loop.points.sum().hex()) for loop in s.loops])\n"
    )
    outputs = [
        subprocess.run(
            [sys.executable, "-c", program],
            cwd=ROOT,
            env={**os.environ, "NUMBA_DISABLE_JIT": disabled},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for disabled in ("0", "1")
    ]
    assert outputs[0] == outputs[1]
    assert outputs[0].count("\n") == 3
