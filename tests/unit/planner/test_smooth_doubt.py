"""Contours of united bodies are never farther from the facets than these can stand for; those of clean surfaces stay."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from planner.mesh.mesh import Mesh, mesh_of
from planner.mesh.smooth import smooth_surface
from planner.slicing import slice_mesh
from planner.slicing.contours import ContourStyle, doubted, fitted_curves, section_curves_many
from planner.slicing.section import Section
from tests.unit.planner import smooth_surfaces as known

Floats = NDArray[np.float64]
RADIUS = 5.0
ANGLES = (0.0, 0.6, -0.7)
AXIS = np.array([1.0, 0.3, 0.0]) / np.hypot(1.0, 0.3)
TURNS = [Rotation.from_rotvec(angle * AXIS).as_matrix() for angle in ANGLES]


def fork() -> Mesh:
    """Three tilted cylinders R 5, 40 mm long, united: slivers a millionth of a millimetre high along their seams."""
    bodies = [trimesh.creation.cylinder(RADIUS, 40.0, sections=48, transform=placed(turn)) for turn in TURNS]
    return mesh_of(trimesh.boolean.union(bodies, engine="manifold"))


def placed(turn: Floats) -> Floats:
    """The (4, 4) matrix of a rotation about the origin."""
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    return matrix


def inside_fork(points: Floats) -> Floats:
    """Signed distance, to first order, from the three true cylinders together: (n,) float, mm."""
    fields = []
    for turn in TURNS:
        own = points @ turn
        fields.append(np.maximum(np.hypot(own[:, 0], own[:, 1]) - RADIUS, np.abs(own[:, 2]) - 20.0))
    return np.asarray(np.min(fields, axis=0))


def cut(mesh: Mesh, normal: Floats, count: int) -> list[Section]:
    """The mesh cut at so many heights along the unit normal."""
    height = mesh.vertices @ normal
    levels = np.linspace(height.min(), height.max(), count + 2)[1:-1]
    return slice_mesh(mesh, np.array([np.concatenate([level * normal, normal]) for level in levels]))


@pytest.mark.parametrize("way", [(0.0, 0.0, 1.0), (0.3, 0.2, 0.93), (0.5, -0.2, 0.7)])
def test_contours_of_united_cylinders_stay_within_a_tenth_of_a_millimetre_of_facets_and_truth(
    way: tuple[float, float, float],
) -> None:
    mesh = fork()
    normal = np.array(way) / np.linalg.norm(way)
    sections = cut(mesh, normal, 40)
    for curves in section_curves_many(sections, mesh):
        for made in curves:
            edges = made.curve.breaks
            points = made.curve.evaluate((edges[:-1, None] + np.arange(16) / 16 * np.diff(edges)[:, None]).ravel())
            assert np.abs(inside_fork(points)).max() < 0.1
            assert made.deviation_mm < 0.1
    assert doubted(sections) > 0


@pytest.mark.parametrize("name", known.SHAPES)
def test_no_contour_of_a_clean_surface_is_doubted(name: str) -> None:
    mesh = known.SHAPES[name]().mesh
    for way in known.DIRECTIONS:
        sections = cut(mesh, known.direction(way), 12)
        fitted_curves(sections, mesh)
        assert doubted(sections) == 0


def test_the_least_rounded_prism_that_reads_as_a_circle_is_not_doubted() -> None:
    mesh = mesh_of(trimesh.creation.cylinder(10.0, 20.0, sections=12))
    sections = cut(mesh, np.array([0.0, 0.0, 1.0]), 5)
    for curves in fitted_curves(sections, mesh):
        points = curves[0].evaluate(np.linspace(0.0, 1.0, 400))
        assert np.abs(np.hypot(points[:, 0], points[:, 1]) - 10.0).max() < 1e-4
    assert doubted(sections) == 0


def test_contours_that_follow_the_facets_by_the_recipe_are_not_counted_as_doubted() -> None:
    mesh, style = fork(), ContourStyle(fit="facets")
    sections = cut(mesh, np.array([0.0, 0.0, 1.0]), 5)
    fitted_curves(sections, mesh, style)
    assert doubted(sections, style) == 0


def test_facets_of_a_cylinder_rise_by_their_sagitta() -> None:
    mesh = known.cylinder().mesh
    wall = np.abs(mesh.normals[:, 2]) < 0.5
    sagitta = known.RADIUS * (1.0 - np.cos(np.pi / 48))
    assert np.allclose(smooth_surface(mesh, 35.0).rises[wall], sagitta, rtol=2e-3)
