"""Curvature of the surfaces that meshes stand for, against the surfaces' own; distances to a mesh against brute force."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh

from planner.errors import InputError, MeshError
from planner.mesh import Mesh
from planner.mesh.crease import corner_normals
from planner.mesh.curvature import facet_curvatures, normal_curvatures
from planner.mesh.nearest import FacetTree


def tensors_of(mesh: Mesh) -> np.ndarray:
    return facet_curvatures(mesh, corner_normals(mesh, 35.0))


def along_and_around(mesh: Mesh, keep: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normal curvature of the kept facets along the meridian (in the plane of z and n) and around the axis."""
    normals = mesh.normals[keep]
    meridian = np.array([0.0, 0.0, 1.0]) - normals[:, 2:] * normals
    meridian /= np.linalg.norm(meridian, axis=1, keepdims=True)
    tensors = tensors_of(mesh)[keep]
    return normal_curvatures(tensors, meridian), normal_curvatures(tensors, np.cross(normals, meridian))


@pytest.mark.parametrize("subdivisions", [2, 4])
def test_a_sphere_bends_by_its_radius_in_every_direction(subdivisions: int) -> None:
    ball = Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=subdivisions, radius=23.0))
    tensors = tensors_of(ball)
    tangential = np.eye(3) - ball.normals[:, :, None] * ball.normals[:, None, :]
    np.testing.assert_allclose(tensors, tangential / 23.0, atol=1e-12)


def test_a_sphere_of_slivers_at_its_poles_bends_the_same() -> None:
    ball = Mesh.from_trimesh(trimesh.creation.uv_sphere(radius=23.0, count=[24, 48]))
    np.testing.assert_allclose(np.trace(tensors_of(ball), axis1=1, axis2=2), 2.0 / 23.0, rtol=1e-9)


def test_a_cylinder_bends_around_and_not_along_and_its_lids_not_at_all() -> None:
    rod = Mesh.from_trimesh(trimesh.creation.cylinder(5.0, 20.0, sections=48))
    wall = np.abs(rod.normals[:, 2]) < 0.5
    along, around = along_and_around(rod, wall)
    np.testing.assert_allclose(along, 0.0, atol=1e-12)
    np.testing.assert_allclose(around, 0.2, rtol=1e-9)
    assert np.abs(tensors_of(rod)[~wall]).max() == 0.0


def test_a_torus_bends_inward_at_its_hole_and_outward_outside() -> None:
    ring = Mesh.from_trimesh(trimesh.creation.torus(10.0, 3.0, major_sections=192, minor_sections=96))
    along, around = along_and_around(ring, np.abs(ring.normals[:, 2]) < 0.9)
    keep = np.abs(ring.normals[:, 2]) < 0.9
    radius = np.hypot(ring.centroids[keep, 0], ring.centroids[keep, 1])
    np.testing.assert_allclose(along, 1.0 / 3.0, rtol=5e-3)
    np.testing.assert_allclose(around, (1.0 - 10.0 / radius) / 3.0, atol=4e-3)
    assert around.min() < -0.1 < 0.07 < around.max()


def test_a_cone_bends_around_by_its_slant_and_not_along() -> None:
    cone = Mesh.from_trimesh(trimesh.creation.cylinder(10.0, 10.0, sections=192))
    shrunk = cone.vertices.copy()
    shrunk[:, :2] *= 1.0 - 0.05 * (shrunk[:, 2:] + 5.0)
    cone = Mesh(shrunk, cone.facets)
    wall = np.abs(cone.normals[:, 2]) < 0.9
    along, around = along_and_around(cone, wall)
    has_lower_edge = (cone.corners[wall][:, :, 2] < 0.0).sum(axis=1) == 2
    radius = np.where(has_lower_edge, 10.0, 5.0)  # of the rim that a facet shares an edge with: it sees no other
    np.testing.assert_allclose(along, 0.0, atol=2e-4)
    np.testing.assert_allclose(around * radius, 1.0 / np.hypot(1.0, 0.5), rtol=1e-3)


def test_a_saddle_bends_both_ways() -> None:
    steps = np.linspace(-2.0, 2.0, 81)
    x, y = (grid.ravel() for grid in np.meshgrid(steps, steps, indexing="ij"))
    corner = np.arange(81 * 81).reshape(81, 81)
    a, b, c, d = corner[:-1, :-1].ravel(), corner[1:, :-1].ravel(), corner[1:, 1:].ravel(), corner[:-1, 1:].ravel()
    sheet = Mesh(np.column_stack([x, y, 0.05 * (x**2 - y**2)]), np.concatenate([np.c_[a, b, c], np.c_[a, c, d]]))
    middle = int(np.argmin(np.linalg.norm(sheet.centroids, axis=1)))
    values = np.sort(np.linalg.eigvalsh(tensors_of(sheet)[middle]))
    np.testing.assert_allclose(values, [-0.1, 0.0, 0.1], atol=2e-3)


def test_corner_normals_of_another_mesh_are_refused() -> None:
    ball = Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=1))
    with pytest.raises(InputError, match="corner normals must be"):
        facet_curvatures(ball, np.zeros((3, 3, 3)))


def test_distances_to_a_mesh_are_those_of_all_facets_one_by_one() -> None:
    body = trimesh.creation.torus(10.0, 3.0, major_sections=24, minor_sections=12)
    mesh = Mesh.from_trimesh(body)
    points = np.random.default_rng(7).normal(size=(200, 3)) * 9.0
    count = len(mesh.facets)
    closest_point: Any = trimesh.triangles.closest_point
    feet = closest_point(np.tile(mesh.corners, (200, 1, 1)), np.repeat(points, count, axis=0))
    truth = np.linalg.norm(feet.reshape(200, count, 3) - points[:, None], axis=2).min(axis=1)
    distance, facet, foot = FacetTree(mesh).nearest(points)
    np.testing.assert_allclose(distance, truth, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(points - foot, axis=1), distance, atol=1e-12)
    again = closest_point(mesh.corners[facet], points)
    np.testing.assert_allclose(again, foot, atol=1e-9)


def test_a_mesh_without_facets_has_no_distance() -> None:
    with pytest.raises(MeshError, match="no facets"):
        FacetTree(Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)))
