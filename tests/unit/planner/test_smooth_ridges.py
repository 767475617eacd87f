"""Edges that bend alone are corners however blunt; those that share the bend of a surface are none."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from planner.mesh.crease import crease_edges, edge_bends
from planner.mesh.mesh import Mesh, mesh_of
from planner.mesh.ridge import ridge_edges
from tests.unit.planner import smooth_parts as parts
from tests.unit.planner import smooth_surfaces as known

CREASE_DEG = 35.0
make = trimesh.creation


def ridges(mesh: Mesh) -> NDArray[np.bool_]:
    """Which edges are ridges: (m, 3) bool."""
    return ridge_edges(mesh, edge_bends(mesh), float(np.radians(CREASE_DEG)))


def stretched(axes: tuple[float, float, float]) -> trimesh.Trimesh:
    """A unit ball of 1280 facets with these half axes, mm."""
    ball = make.icosphere(subdivisions=3, radius=1.0)
    return trimesh.Trimesh(ball.vertices * axes, ball.faces, process=False)


SMOOTH: dict[str, Callable[[], trimesh.Trimesh]] = {
    "UV sphere, coarse": lambda: make.uv_sphere(radius=10.0, count=[8, 12]),
    "icosphere 2": lambda: make.icosphere(subdivisions=2, radius=10.0),
    "torus": lambda: make.torus(20.0, 6.0, 48, 32),
    "torus, coarse": lambda: make.torus(20.0, 6.0, 24, 16),
    "torus, thick": lambda: make.torus(10.0, 8.0, 32, 12),
    "dodecagon": lambda: make.cylinder(10.0, 20.0, sections=12),
    "cone": lambda: make.cone(10.0, 20.0, sections=48),
    "capsule": lambda: make.capsule(height=10.0, radius=3.0),
    "ellipsoid": lambda: stretched((30.0, 10.0, 6.0)),
    "lens": lambda: stretched((30.0, 30.0, 6.0)),
    "needle": lambda: stretched((5.0, 5.0, 40.0)),
}


@pytest.mark.parametrize("name", SMOOTH)
def test_facets_of_a_smooth_surface_have_no_ridges_between_them(name: str) -> None:
    assert not ridges(mesh_of(SMOOTH[name]())).any()


@pytest.mark.parametrize("name", known.SHAPES)
def test_surfaces_whose_sections_are_tested_have_no_ridges(name: str) -> None:
    assert not ridges(known.SHAPES[name]().mesh).any()


def test_coarse_parts_of_varying_curvature_have_no_ridges() -> None:
    for shape in (
        parts.vase(16, 10),
        parts.ellipsoid(24, 12),
        parts.hyperboloid(16, 8),
        parts.filleted_cylinder(24, 3),
    ):
        assert not ridges(shape.mesh).any()


@pytest.mark.parametrize("bend_deg", [4.0, 10.0, 30.0])
def test_the_ridge_of_a_roof_is_one_edge_and_a_crease(bend_deg: float) -> None:
    rise = 10.0 * np.tan(np.radians(0.5 * bend_deg))
    mesh = known.prism(np.array([[10.0, -10.0], [10.0, 10.0], [0.0, 10.0 + rise], [-10.0, 10.0], [-10.0, -10.0]]))
    found = ridges(mesh)
    assert found.sum() == 2
    facet, edge = (int(value) for value in np.argwhere(found)[0])
    ends = mesh.corners[facet, [edge, (edge + 1) % 3]]
    assert np.allclose(ends[:, 0], 0.0) and np.allclose(ends[:, 1], 10.0 + rise)
    assert crease_edges(mesh, CREASE_DEG)[found].all()


def test_the_seam_of_a_ball_standing_out_of_a_box_is_a_crease_though_it_bends_less() -> None:
    ball = make.icosphere(subdivisions=3, radius=12.0)
    mesh = mesh_of(trimesh.boolean.union([make.box((20.0, 20.0, 20.0)), ball], engine="manifold"))
    ends = np.stack([mesh.corners, np.roll(mesh.corners, -1, axis=1)], axis=2)
    in_face = np.abs(np.abs(ends).max(axis=3) - 10.0).max(axis=2) < 1e-5
    seam = in_face & (edge_bends(mesh) > np.radians(10.0)) & (np.sort(np.abs(ends), axis=3)[..., 1].max(axis=2) < 9.0)
    assert seam.sum() > 300
    assert (edge_bends(mesh)[seam] < np.radians(CREASE_DEG)).any()
    assert crease_edges(mesh, CREASE_DEG)[seam].mean() > 0.99
