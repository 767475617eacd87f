"""The same part in a finer mesh gives the same contours, led through no more nodes than their bend needs."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh

from planner.mesh.mesh import mesh_of
from planner.slicing.contours import fitted_curves, lots, section_curves_many
from planner.slicing.slicer import slice_mesh

PARTS = Path(__file__).resolve().parents[3] / "config" / "parts"


def test_a_section_of_a_fine_ball_is_a_circle_through_few_nodes() -> None:
    ball = trimesh.creation.icosphere(subdivisions=6, radius=23.0)
    sections = slice_mesh(ball, [[0.0, 0.0, z, 0.0, 0.0, 1.0] for z in (-11.3, 0.7, 19.2)])
    for section, curves in zip(sections, fitted_curves(sections, mesh_of(ball)), strict=True):
        (curve,) = curves
        z = float(section.origin[2])
        assert len(section.loops[0].points) > 2 * len(curve.breaks)
        points = curve.evaluate(np.linspace(0.0, 1.0, 3000))
        assert np.abs(np.hypot(points[:, 0], points[:, 1]) - np.sqrt(23.0**2 - z * z)).max() < 2e-4


@pytest.mark.parametrize("name", ["pipe", "bearing"])
def test_a_part_with_its_facets_cut_in_sixteen_keeps_its_sections(name: str) -> None:
    coarse = trimesh.load_mesh(PARTS / f"{name}.stl")
    fine = coarse.subdivide().subdivide()
    low, high = coarse.bounds[:, 2]
    planes = [[0.0, 0.0, z, 0.0, 0.0, 1.0] for z in low + (high - low) * np.array([0.13, 0.37, 0.61, 0.83])]
    found = [section_curves_many(slice_mesh(mesh, planes), mesh_of(mesh)) for mesh in (coarse, fine)]
    for rough, smooth in zip(*found, strict=True):
        assert len(rough) == len(smooth)
        most = max(item.deviation_mm for item in rough)
        assert max(item.deviation_mm for item in smooth) <= most + 1e-3
        assert sum(len(item.curve.breaks) for item in smooth) <= 1.5 * sum(len(item.curve.breaks) for item in rough)


def test_lots_hold_every_section_once_and_in_order() -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=23.0)
    sections = slice_mesh(ball, [[0.0, 0.0, z, 0.0, 0.0, 1.0] for z in np.linspace(-22.0, 24.0, 400)])
    parts = list(lots(sections))
    assert [section for part in parts for section in part] == sections
    assert len(parts) > 1 and all(first for first, _ in pairwise(parts))


def test_curves_of_a_section_are_kept_as_long_as_the_section_is() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=23.0)
    mesh = mesh_of(ball)
    section = slice_mesh(ball, [[0.0, 0.0, 1.3, 0.0, 0.0, 1.0]])[0]
    assert fitted_curves([section], mesh)[0][0] is fitted_curves([section, section], mesh)[1][0]
