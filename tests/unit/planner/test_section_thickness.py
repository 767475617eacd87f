"""Layer heights: the facet rule, the bounds, and level faces hit exactly."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from planner.errors import PlanningError, RecipeError
from planner.mesh import Mesh, load
from planner.slicing.thickness import layer_cusps, layer_heights

PARTS = Path(__file__).resolve().parents[3] / "config" / "parts"
UP = (0.0, 0.0, 1.0)


def stairs(*tops: float) -> Mesh:
    boxes = [trimesh.creation.box(bounds=[[10 * i, 0, 0], [10 * i + 10, 10, top]]) for i, top in enumerate(tops)]
    return Mesh.from_trimesh(trimesh.boolean.union(boxes, engine="manifold"))


def test_a_prism_takes_the_thickest_even_layers() -> None:
    heights = layer_heights(Mesh.from_trimesh(trimesh.creation.box((5, 5, 10))), UP, 0.05, 0.3, 1.0)
    np.testing.assert_allclose(heights, np.linspace(-5, 5, 11))


def test_a_cone_takes_the_layers_of_its_slope() -> None:
    cone = Mesh.from_trimesh(trimesh.creation.cone(radius=10.0, height=10.0, sections=256))
    thickness = np.diff(layer_heights(cone, UP, 0.1, 0.05, 1.0))
    np.testing.assert_allclose(thickness, 0.1 * np.sqrt(2.0), rtol=0.01)


def test_layers_of_a_sphere_count_as_the_rule_integrates_and_keep_the_cusp() -> None:
    ball = Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=6, radius=23.0))
    heights = layer_heights(ball, UP, 0.04, 0.001, 5.0)
    assert 23.0 / 0.04 <= len(heights) - 1 <= 1.04 * 23.0 / 0.04
    assert layer_cusps(ball, UP, heights).max() <= 0.04 * (1 + 1e-9)
    assert np.diff(heights).max() < 5.0


def test_level_faces_are_boundaries_and_the_ends_are_the_part() -> None:
    heights = layer_heights(stairs(3.7, 5.0, 9.33), UP, 0.1, 0.3, 1.0)
    for level in (0.0, 3.7, 5.0, 9.33):
        assert np.abs(heights - level).min() < 1e-6  # the union rounds to 32 bits
    assert (heights[0], heights[-1]) == pytest.approx((0.0, 9.33))
    assert (np.diff(heights) >= 0.3 - 1e-9).all()
    assert (np.diff(heights) <= 1.0 + 1e-9).all()


def test_level_faces_within_the_cusp_of_each_other_are_one() -> None:
    heights = layer_heights(stairs(4.0, 4.05, 9.0), UP, 0.1, 0.3, 1.0)
    assert (np.abs(heights - 4.0).min() < 1e-6) != (np.abs(heights - 4.05).min() < 1e-6)


def test_level_faces_too_near_for_the_thinnest_layer_are_refused_with_their_place() -> None:
    with pytest.raises(PlanningError, match=r"0\.2 mm between the level faces at 4 and 4\.2 mm .* near \("):
        layer_heights(stairs(4.0, 4.2, 9.0), UP, 0.05, 0.3, 1.0)


def test_the_bounds_win_over_the_rule_and_the_cusp_tells() -> None:
    cone = Mesh.from_trimesh(trimesh.creation.cone(radius=10.0, height=10.0, sections=64))
    heights = layer_heights(cone, UP, 0.02, 0.3, 1.0)
    np.testing.assert_allclose(np.diff(heights), 0.3, rtol=0.02)
    assert layer_cusps(cone, UP, heights).max() == pytest.approx(0.3 / np.sqrt(2.0), rel=0.02)


@pytest.mark.parametrize("name", ["bearing", "double_arc", "hinge", "pipe"])
@pytest.mark.parametrize("direction", [(1, 0, 0), (0, 1, 0), (0, 0, 2), (0.6, 0, 0.8)])
def test_layers_of_the_parts_keep_cusp_or_least_thickness(name: str, direction: tuple[float, float, float]) -> None:
    mesh = load(PARTS / f"{name}.stl")
    heights = layer_heights(mesh, direction, 0.05, 0.02, 0.5)
    thickness, cusps = np.diff(heights), layer_cusps(mesh, direction, heights)
    along = mesh.vertices @ (np.asarray(direction) / np.linalg.norm(direction))
    assert (heights[0], heights[-1]) == (along.min(), along.max())
    assert thickness.min() >= 0.02 - 1e-9
    assert thickness.max() <= 0.5 + 1e-9
    assert ((cusps <= 0.05 + 1e-9) | (thickness <= 0.04)).all()


def test_a_direction_or_bounds_that_are_none_are_refused() -> None:
    mesh = stairs(3.0)
    with pytest.raises(RecipeError, match="no direction"):
        layer_heights(mesh, (0, 0, 0), 0.1, 0.3, 1.0)
    with pytest.raises(RecipeError, match="least <= greatest"):
        layer_heights(mesh, UP, 0.1, 1.0, 0.3)
