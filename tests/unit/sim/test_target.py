"""Distance, volume and inside of the part against shapes with closed formulas and against trimesh."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from sim.process.target import Target


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
    matrix = trimesh.transformations.rotation_matrix(turn, [1.0, 0.5, 0.2])
    mesh.apply_transform(matrix)
    target, origin, cell, shape = target_of(mesh), np.array([-5.05, -5.03, -5.01]), 0.5, (21, 21, 21)
    inside = target.inside_grid(origin, cell, shape)
    grid = np.stack(np.meshgrid(*(origin[d] + cell * np.arange(21) for d in range(3)), indexing="ij"), axis=-1)
    local = grid.reshape(-1, 3) @ matrix[:3, :3]
    assert np.array_equal(inside.reshape(-1), (np.abs(local) < [2.5, 1.5, 2.0]).all(axis=1))


def test_inside_of_the_grid_holds_the_volume() -> None:
    target = target_of(trimesh.creation.icosphere(4, 5.0))
    inside = target.inside_grid(np.array([-6.0, -6.0, -6.0]), 0.2, (61, 61, 61))
    assert inside.sum() * 0.2**3 == pytest.approx(target.volume_mm3, rel=0.005)
    assert target.volume_mm3 == pytest.approx(4.0 / 3.0 * np.pi * 125.0, rel=0.01)


def test_samples_are_spread_by_area() -> None:
    target = target_of(trimesh.creation.box((10.0, 10.0, 1.0)))
    points = target.samples[target.spread]
    on_top = np.isclose(points[:, 2], 0.5).mean()
    assert on_top == pytest.approx(100.0 / 240.0, abs=0.01)
    assert (np.isclose(np.abs(points), [5.0, 5.0, 0.5]).any(axis=1)).all()
