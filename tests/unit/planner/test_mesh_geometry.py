"""The mesh itself: areas, volume, neighbours, hash, transforms, against analytic values and trimesh."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from planner.errors import MeshError
from planner.mesh import Mesh


def box(size: tuple[float, float, float] = (2.0, 3.0, 4.0)) -> Mesh:
    return Mesh.from_trimesh(trimesh.creation.box(size))


def test_a_box_has_the_area_volume_and_bounds_of_its_edges() -> None:
    mesh = box()
    assert mesh.volume == pytest.approx(24.0)
    assert mesh.areas.sum() == pytest.approx(52.0)
    np.testing.assert_allclose(mesh.bounds, [[-1, -1.5, -2], [1, 1.5, 2]])
    np.testing.assert_allclose(mesh.size, [2, 3, 4])
    assert (np.einsum("ij,ij->i", mesh.normals, mesh.centroids) > 0).all()


def test_neighbours_share_the_edge_in_opposite_directions() -> None:
    mesh = Mesh.from_trimesh(trimesh.creation.torus(10, 3))
    for j in range(3):
        across = mesh.adjacency[:, j]
        start, stop = mesh.facets[:, j], mesh.facets[:, (j + 1) % 3]
        found = np.zeros(len(mesh.facets), dtype=bool)
        for k in range(3):
            found |= (mesh.facets[across, k] == stop) & (mesh.facets[across, (k + 1) % 3] == start)
        assert found.all()


def test_an_edge_without_neighbour_is_open() -> None:
    mesh = box()
    opened = Mesh(mesh.vertices, mesh.facets[1:])
    assert not opened.is_closed
    assert (opened.adjacency < 0).sum() == 3


def test_two_boxes_that_touch_along_an_edge_keep_their_own_neighbours() -> None:
    left = trimesh.creation.box((1, 1, 1))
    right = left.copy()
    right.apply_translation((1, 1, 0))
    mesh = Mesh.from_trimesh(trimesh.util.concatenate([left, right]))
    is_left = mesh.centroids[:, 0] + mesh.centroids[:, 1] < 1.0
    assert mesh.is_closed
    assert (is_left[mesh.adjacency] == is_left[:, None]).all()


def test_a_mirror_keeps_the_outside_outside_and_scaling_scales_the_volume() -> None:
    mesh = box()
    assert mesh.transformed(np.diag([-1.0, 1.0, 1.0, 1.0])).volume == pytest.approx(24.0)
    assert mesh.transformed(np.diag([2.0, 2.0, 2.0, 1.0])).volume == pytest.approx(192.0)


def test_the_hash_is_that_of_the_content_alone() -> None:
    assert box().sha256 == box().sha256
    assert box().sha256 != box((2.0, 3.0, 4.0000001)).sha256
    mesh = box()
    assert Mesh(mesh.vertices, np.roll(mesh.facets, 1, axis=0)).sha256 != mesh.sha256


def test_the_way_to_trimesh_and_back_changes_nothing() -> None:
    mesh = box()
    assert Mesh.from_trimesh(mesh.to_trimesh()).sha256 == mesh.sha256


def test_a_mesh_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        box().vertices[0, 0] = 7.0


@pytest.mark.parametrize(
    ("vertices", "facets", "words"),
    [
        ([[0, 0, 0], [1, 0, 0], [np.nan, 1, 0]], [[0, 1, 2]], "not finite"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 3]], "outside"),
        ([[0, 0], [1, 0], [0, 1]], [[0, 1, 2]], r"\(n, 3\)"),
    ],
)
def test_arrays_that_are_no_mesh_are_refused(vertices: list, facets: list, words: str) -> None:
    with pytest.raises(MeshError, match=words):
        Mesh(np.array(vertices, dtype=float), np.array(facets))
