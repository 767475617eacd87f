"""Which contour lies in which."""

from __future__ import annotations

from pathlib import Path

import manifold3d
import numpy as np
import pytest
import trimesh

from planner.mesh import Mesh, load
from planner.slicing import slice_mesh

PARTS = Path(__file__).resolve().parents[3] / "config" / "parts"


def test_a_torus_across_its_axis_is_a_ring_and_along_it_two_discs() -> None:
    torus = Mesh.from_trimesh(trimesh.creation.torus(10.0, 3.0, 128, 64))
    across, along = slice_mesh(torus, [[0, 0, 0.1, 0, 0, 1], [0, 0.1, 0, 0, 1, 0]])
    outer = max(range(2), key=lambda i: across.loops[i].area_mm2)
    assert across.loops[1 - outer].is_hole
    assert across.loops[1 - outer].parent == outer
    assert across.loops[outer].parent == -1
    assert across.area_mm2 == pytest.approx(np.pi * (13**2 - 7**2), rel=3e-3)
    assert [(loop.is_hole, loop.parent) for loop in along.loops] == [(False, -1), (False, -1)]
    (ring,) = across.to_shapely().geoms
    assert len(ring.interiors) == 1


def test_shells_in_shells_alternate() -> None:
    shells = []
    for number, size in enumerate((10, 8, 6, 4, 2)):
        shell = trimesh.creation.box((size, size, size))
        if number % 2:
            shell.invert()
        shells.append(shell)
    mesh = Mesh.from_trimesh(trimesh.util.concatenate(shells))
    (section,) = slice_mesh(mesh, [[0, 0, 0.2, 0, 0, 1]])
    by_size = sorted(range(5), key=lambda i: -abs(section.loops[i].area_mm2))
    assert [section.loops[i].parent for i in by_size] == [-1, *by_size[:-1]]
    assert [section.loops[i].is_hole for i in by_size] == [False, True, False, True, False]
    assert section.area_mm2 == pytest.approx(100 - 64 + 36 - 16 + 4)
    assert section.to_shapely().area == pytest.approx(60.0)


def test_a_hole_that_touches_the_rim_at_one_point_is_still_a_hole() -> None:
    outer = trimesh.creation.box((10, 10, 10))
    inner = trimesh.creation.cylinder(radius=3.0, height=4.0, sections=4)  # a square on its corner
    inner.apply_translation((5.0 - inner.bounds[1, 0], 0, 0))
    inner.invert()
    (section,) = slice_mesh(Mesh.from_trimesh(trimesh.util.concatenate([outer, inner])), [[0, 0, 0.1, 0, 0, 1]])
    hole = next(loop for loop in section.loops if loop.is_hole)
    assert hole.parent >= 0
    assert section.to_shapely().is_valid
    assert section.to_shapely().area == pytest.approx(100.0 - 18.0)


def test_bodies_that_overlap_count_once_in_the_area_of_the_material() -> None:
    left, right = trimesh.creation.box((4, 4, 4)), trimesh.creation.box((4, 4, 4))
    right.apply_translation((2, 1, 0.5))
    (section,) = slice_mesh(Mesh.from_trimesh(trimesh.util.concatenate([left, right])), [[0, 0, 0.1, 0, 0, 1]])
    assert section.area_mm2 == pytest.approx(32.0)
    assert section.to_shapely().area == pytest.approx(26.0)


@pytest.mark.parametrize("name", ["bearing", "double_arc", "hinge", "pipe"])
def test_areas_and_loop_counts_agree_with_manifold3d(name: str) -> None:
    mesh = load(PARTS / f"{name}.stl")
    solid = manifold3d.Manifold(manifold3d.Mesh64(mesh.vertices.copy(), mesh.facets.astype(np.uint64)))
    low, high = mesh.bounds[:, 2]
    heights = np.linspace(low, high, 42)[1:-1] + 1.234e-4
    planes = np.column_stack([np.zeros((40, 2)), heights, np.tile([0.0, 0.0, 1.0], (40, 1))])
    for height, section in zip(heights, slice_mesh(mesh, planes), strict=True):
        other = solid.slice(float(height))
        assert section.area_mm2 == pytest.approx(other.area(), rel=1e-6)
        assert len(section.loops) == other.num_contour()


def test_the_tube_has_one_hole_in_every_section_across_it() -> None:
    mesh = load(PARTS / "pipe.stl")
    low, high = mesh.bounds[:, 0]
    planes = [[x, 0, 0, 1, 0, 0] for x in np.linspace(low, high, 13)[:-1]]
    for section in slice_mesh(mesh, planes):
        assert sorted((loop.is_hole, loop.parent >= 0) for loop in section.loops) == [(False, False), (True, True)]
    assert sum(s.area_mm2 for s in slice_mesh(mesh, planes)) / 12 * (high - low) == pytest.approx(mesh.volume, rel=1e-6)
