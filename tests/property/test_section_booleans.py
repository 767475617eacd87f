"""Sections of random bodies, cut out of each other: exact volume from areas, and manifold3d's own slices."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from planner.mesh import Mesh
from planner.slicing import slice_mesh

whole = st.integers(-3, 3)  # coarse numbers make faces, edges and corners of different bodies meet
parts = st.tuples(
    st.sampled_from(["box", "ball", "cylinder"]),
    st.tuples(whole, whole, whole),
    st.integers(1, 4),
    st.sampled_from([manifold3d.OpType.Add, manifold3d.OpType.Subtract, manifold3d.OpType.Intersect]),
    st.booleans(),
)
bodies = st.lists(parts, min_size=2, max_size=5)
directions = st.tuples(whole, whole, whole).filter(any)


def solid_of(pieces: list[tuple[str, tuple[int, int, int], int, manifold3d.OpType, bool]]) -> manifold3d.Manifold:
    """The first piece with the others added, taken away or intersected."""
    result = manifold3d.Manifold.cube((6.0, 6.0, 6.0), True)
    for kind, place, size, operation, is_turned in pieces:
        if kind == "box":
            piece = manifold3d.Manifold.cube((size, size, size), True)
        elif kind == "ball":
            piece = manifold3d.Manifold.sphere(0.5 * size, 16)
        else:
            piece = manifold3d.Manifold.cylinder(size, 0.4 * size, 0.3 * size, 12, True)
        piece = piece.rotate((30.0, 20.0, 10.0)) if is_turned else piece
        changed = manifold3d.Manifold.batch_boolean([result, piece.translate(place)], operation)
        result = result if changed.is_empty() else changed
    return result


def mesh_of(solid: manifold3d.Manifold) -> Mesh:
    """The same body as it stands there, vertices not merged."""
    raw = solid.to_mesh64()
    return Mesh(np.asarray(raw.vert_properties)[:, :3], np.asarray(raw.tri_verts, dtype=np.int64))


def planes_at(heights: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([heights[:, None] * normal, np.tile(normal, (len(heights), 1))])


@settings(max_examples=25, deadline=None)
@given(bodies, directions)
def test_simpsons_rule_between_vertex_heights_gives_the_exact_volume(
    pieces: list[tuple[str, tuple[int, int, int], int, manifold3d.OpType, bool]], direction: tuple[int, int, int]
) -> None:
    mesh = mesh_of(solid_of(pieces))
    assume(mesh.is_closed)
    normal = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    along = np.unique(mesh.vertices @ normal)
    levels = along[np.concatenate([[True], np.diff(along) > 1e-6])]  # between these the area is quadratic in height
    above, middle, below = (
        np.array([section.area_mm2 for section in slice_mesh(mesh, planes_at(heights, normal), side)])
        for heights, side in (
            (levels[:-1], "above"), (0.5 * (levels[:-1] + levels[1:]), "above"), (levels[1:], "below"),
        )
    )  # fmt: skip
    volume = float((np.diff(levels) * (above + 4.0 * middle + below) / 6.0).sum())
    assert volume == pytest.approx(mesh.volume, rel=1e-6, abs=1e-6)
    assert slice_mesh(mesh, planes_at(levels[-1:], normal), "above")[0].area_mm2 == pytest.approx(0.0, abs=1e-4)


@settings(max_examples=25, deadline=None)
@given(bodies, st.lists(st.floats(-3.0, 3.0), min_size=1, max_size=8))
def test_areas_are_those_of_manifold3d(
    pieces: list[tuple[str, tuple[int, int, int], int, manifold3d.OpType, bool]], heights: list[float]
) -> None:
    solid = solid_of(pieces)
    mesh = mesh_of(solid)
    clear = [h for h in heights if np.abs(mesh.vertices[:, 2] - h).min() > 1e-6]
    assume(clear)
    for height, section in zip(
        clear, slice_mesh(mesh, planes_at(np.array(clear), np.array([0.0, 0.0, 1.0]))), strict=True
    ):
        assert section.area_mm2 == pytest.approx(solid.slice(height).area(), rel=1e-6, abs=1e-6)
        assert section.to_shapely().area == pytest.approx(section.area_mm2, rel=1e-6, abs=1e-6)
        for loop in section.loops:
            closed = np.roll(loop.points, -1, axis=0) - loop.points
            assert np.abs(closed.sum(axis=0)).max() < 1e-9
            left = np.cross(section.normal, closed)
            assert np.einsum("ij,ij->i", left, mesh.normals[loop.facets]).max() < 1e-9
