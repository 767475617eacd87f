"""Plane cuts of closed meshes: bodies, caps, flush faces."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from planner.decompose.cutting import split
from planner.mesh.mesh import Mesh
from tests.unit.planner.decompose.shapes import part

Z = (0.0, 0.0, 1.0)


def plane(point: tuple[float, float, float], normal: tuple[float, float, float]) -> np.ndarray:
    unit = np.array(normal) / np.linalg.norm(normal)
    return np.concatenate([np.array(point), unit])


def single_precision(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices.astype(np.float32).astype(np.float64), mesh.facets)


@pytest.mark.parametrize("name", ["hinge", "pipe", "bearing", "double_arc"])
def test_bodies_of_any_cut_are_closed_and_make_up_the_part(name: str) -> None:
    mesh = part(name)
    rng = np.random.default_rng(3)
    for _ in range(12):
        normal = rng.normal(size=3)
        below, above = split(mesh, plane(tuple(mesh.bounds[0] + rng.random(3) * mesh.size), tuple(normal)))
        assert all(body.is_closed and body.volume > 0.0 for body in below + above)
        assert sum(body.volume for body in below + above) == pytest.approx(mesh.volume, rel=1e-7)


def test_plane_flush_with_a_face_cuts_off_just_what_stands_on_it() -> None:
    below, above = split(part("hinge"), plane((0.0, 0.0, 16.0), (0.0, 0.0, -1.0)))
    assert (len(below), len(above)) == (1, 2)
    assert [body.volume for body in above] == pytest.approx([1255.74, 1255.74], rel=1e-4)
    assert all(np.allclose(body.bounds[:, 2], (0.0, 16.0)) for body in above)


def test_plane_in_an_end_face_leaves_the_part_whole() -> None:
    mesh = part("hinge")
    below, above = split(mesh, plane((0.0, 0.0, 28.0), Z))
    assert len(below) == 1 and not above
    assert below[0].volume == pytest.approx(mesh.volume, rel=1e-12)


def test_faces_flat_to_single_precision_only_give_no_slivers() -> None:
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_rotvec([0.21, -0.35, 0.56]).as_matrix()
    mesh = single_precision(part("hinge").transformed(turn))
    at, along = turn[:3, :3] @ np.array([10.0, 35.0, 16.0]), turn[:3, :3] @ np.array([0.0, 0.0, -1.0])
    below, above = split(mesh, plane(tuple(at), tuple(along)))
    assert (len(below), len(above)) == (1, 2)
    assert all(body.volume > 1000.0 for body in below + above)


def test_caps_are_flat_and_share_the_vertices_of_both_sides() -> None:
    cut = plane((0.0, 3.0, 22.0), (0.0, 1.0, 1.0))
    below, above = split(part("hinge"), cut)

    def rim(bodies: list[Mesh]) -> set[tuple[float, ...]]:
        points = np.concatenate([body.vertices for body in bodies])
        near = np.abs((points - cut[:3]) @ cut[3:]) < 1e-9
        return set(map(tuple, np.round(points[near], 9).tolist()))

    assert rim(below) == rim(above)
    for body in below + above:
        height = (body.vertices - cut[:3]) @ cut[3:]
        assert ((np.abs(height) < 1e-12) | (np.abs(height) > 1e-5)).all()


def test_cap_of_a_hollow_section_keeps_its_hole() -> None:
    below, above = split(part("pipe"), plane((5.5, 0.0, 0.0), (1.0, 0.0, 0.0)))
    cap = np.abs(above[0].normals @ np.array([1.0, 0.0, 0.0]) + 1.0) < 1e-9
    assert len(below) == len(above) == 1
    assert above[0].areas[cap].sum() == pytest.approx(part("pipe").volume / 11.0, rel=1e-3)


def test_void_stays_with_the_body_around_it() -> None:
    outer, inner = trimesh.creation.box((20, 20, 20)), trimesh.creation.box((4, 4, 4))
    inner.apply_translation((0, 0, 6))
    inner.invert()
    vertices = np.concatenate([outer.vertices, inner.vertices])
    facets = np.concatenate([outer.faces, inner.faces + len(outer.vertices)])
    below, above = split(Mesh(vertices, facets), plane((0.0, 0.0, 0.0), Z))
    assert [len(below), len(above)] == [1, 1]
    assert above[0].volume == pytest.approx(4000.0 - 64.0)
    assert below[0].volume == pytest.approx(4000.0)


def test_same_cut_gives_the_same_bytes() -> None:
    cut = plane((0.0, 0.0, 37.0), Z)
    first, second = split(part("double_arc"), cut), split(part("double_arc"), cut)
    assert [body.sha256 for side in first for body in side] == [body.sha256 for side in second for body in side]
