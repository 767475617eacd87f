"""Distance, volume and inside of the part against shapes with closed formulas and against trimesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from sim.process.target import Target
from tests.unit.sim.parity import inside_grid

Array = NDArray[np.float64]
PARTS = Path(__file__).resolve().parents[3] / "config" / "parts"


def target_of(mesh: trimesh.Trimesh) -> Target:
    return Target(np.asarray(mesh.vertices), np.asarray(mesh.faces), 0.25)


def test_distance_to_a_box_is_exact() -> None:
    target = target_of(trimesh.creation.box((8.0, 6.0, 4.0)))
    points = np.array([[5.0, 0.0, 0.0], [0.0, 0.0, 1.5], [5.0, 4.0, 0.0], [5.0, 4.0, 3.0], [3.9, 0.0, 0.0]])
    expected = [1.0, -0.5, np.sqrt(2.0), np.sqrt(3.0), -0.1]
    assert target.signed_distance(points) == pytest.approx(expected, abs=1e-9)


def test_distance_to_a_tube_follows_its_radii() -> None:
    target = target_of(trimesh.creation.annulus(5.0, 8.0, 6.0, sections=512))
    r = np.array([4.0, 4.9, 5.2, 6.5, 7.7, 8.3])
    points = np.column_stack([r * np.cos(0.7), r * np.sin(0.7), np.full_like(r, 0.3)])
    assert target.signed_distance(points) == pytest.approx(np.maximum(5.0 - r, r - 8.0), abs=1e-3)


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_inside_of_the_grid_agrees_with_the_formula_of_a_box(turn: float) -> None:
    mesh = trimesh.creation.box((5.0, 3.0, 4.0))
    matrix = trimesh.transformations.rotation_matrix(turn, [1.0, 0.5, 0.2])  # type: ignore[no-untyped-call]
    mesh.apply_transform(matrix)
    target, origin, cell, shape = target_of(mesh), np.array([-5.05, -5.03, -5.01]), 0.5, (21, 21, 21)
    inside = inside_grid(target.corners, origin, cell, shape)
    grid = np.stack(np.meshgrid(*(origin[d] + cell * np.arange(21) for d in range(3)), indexing="ij"), axis=-1)
    local = grid.reshape(-1, 3) @ matrix[:3, :3]
    assert np.array_equal(inside.reshape(-1), (np.abs(local) < [2.5, 1.5, 2.0]).all(axis=1))


def test_inside_of_the_grid_holds_the_volume() -> None:
    target = target_of(trimesh.creation.icosphere(4, 5.0))
    inside = inside_grid(target.corners, np.array([-6.0, -6.0, -6.0]), 0.2, (61, 61, 61))
    assert inside.sum() * 0.2**3 == pytest.approx(target.volume_mm3, rel=0.005)
    assert target.volume_mm3 == pytest.approx(4.0 / 3.0 * np.pi * 125.0, rel=0.01)


def test_samples_are_spread_by_area() -> None:
    points = target_of(trimesh.creation.box((10.0, 10.0, 1.0))).samples
    on_top = np.isclose(points[:, 2], 0.5).mean()
    assert on_top == pytest.approx(100.0 / 240.0, abs=0.01)
    assert (np.isclose(np.abs(points), [5.0, 5.0, 0.5]).any(axis=1)).all()


def winding_number(corners: Array, point: Array) -> float:
    """1 inside a closed surface, 0 outside, whatever its facets look like (van Oosterom and Strackee, 1983)."""
    a, b, c = (corners[:, n] - point for n in range(3))
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    below = la * lb * lc + (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
    return float(np.arctan2((a * np.cross(b, c)).sum(axis=1), below).sum() / (2.0 * np.pi))


@pytest.mark.parametrize("part", ["hinge", "bearing", "pipe", "double_arc"])
def test_distance_to_a_shipped_part_is_that_of_its_nearest_facet_of_all(part: str) -> None:
    mesh = trimesh.load_mesh(PARTS / f"{part}.stl")
    random = np.random.default_rng(3)
    low, high = mesh.bounds
    target = target_of(mesh)
    anywhere = low - 3.0 + (high - low + 6.0) * random.random((60, 3))
    beside = target.samples[:: len(target.samples) // 60] + random.normal(0.0, 0.3, target.samples[:: len(target.samples) // 60].shape)
    points = np.vstack([anywhere, beside])
    found = target.signed_distance(points)
    for point, distance in zip(points, found.tolist(), strict=True):
        nearest = trimesh.triangles.closest_point(target.corners, np.tile(point, (len(target.corners), 1)))  # type: ignore[no-untyped-call]
        assert abs(distance) == pytest.approx(np.linalg.norm(nearest - point, axis=1).min(), abs=1e-9)
        assert (distance < 0.0) == (winding_number(target.corners, point) > 0.5)


def test_sign_beside_a_sharp_spike_comes_from_the_whole_corner() -> None:
    spike = trimesh.creation.cone(0.4, 8.0, sections=5)
    target = target_of(spike)
    tip = np.array([0.0, 0.0, 8.0])
    directions = np.random.default_rng(2).normal(size=(200, 3))
    above = tip + directions / np.linalg.norm(directions, axis=1)[:, None] * 0.05
    expected = [winding_number(target.corners, point) < 0.5 for point in above]
    assert (target.signed_distance(above) > 0.0).tolist() == expected


@pytest.mark.parametrize(("cell_mm", "bands"), [(0.2, 3.0), (0.5, 3.0), (0.2, 0.5)])
def test_field_of_the_part_is_exact_within_the_band_and_its_side_beyond(cell_mm: float, bands: float) -> None:
    mesh = trimesh.creation.annulus(4.0, 5.2, 6.0, sections=96)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.5, [1.0, 0.3, 0.0]))  # type: ignore[no-untyped-call]
    target, origin, band = target_of(mesh), np.array([-7.03, -7.01, -7.02]), bands * cell_mm
    field = target.field_on(origin, cell_mm, band, (int(14.0 / cell_mm),) * 3)
    values = field.dense((0, 0, 0), field.shape)
    index = np.random.default_rng(1).integers(0, field.shape[0], (4000, 3))
    exact = np.clip(target.signed_distance(origin + cell_mm * index), -band, band)
    assert values[tuple(index.T)] == pytest.approx(exact, abs=1e-6)
    assert np.array_equal(values < 0.0, inside_grid(target.corners, origin, cell_mm, field.shape))
    assert len(field.occupied()) < np.prod(field.blocks.directory.shape)


def test_field_of_the_finest_facets_is_exact_as_well() -> None:
    target = target_of(trimesh.creation.icosphere(5, 3.0))
    field = target.field_on(np.full(3, -4.0), 0.5, 1.5, (17, 17, 17))
    grid = np.stack(np.meshgrid(*(-4.0 + 0.5 * np.arange(n) for n in field.shape), indexing="ij"), axis=-1)
    exact = np.clip(target.signed_distance(grid.reshape(-1, 3)), -1.5, 1.5)
    assert field.dense((0, 0, 0), field.shape).ravel() == pytest.approx(exact, abs=1e-6)


def test_distance_along_a_surface_is_the_same_as_point_by_point() -> None:
    target = target_of(trimesh.load_mesh(PARTS / "pipe.stl"))
    ball = trimesh.creation.icosphere(5, 9.0)
    points = np.asarray(ball.vertices)[np.lexsort(ball.vertices.T)] + target.samples[500]
    assert target.surface_distance(points, 0.4) == pytest.approx(target.signed_distance(points), abs=1e-12)


def test_mesh_without_area_is_refused() -> None:
    with pytest.raises(ValueError, match="no facet with an area"):
        Target(np.zeros((3, 3)), np.array([[0, 1, 2]]), 0.25)
