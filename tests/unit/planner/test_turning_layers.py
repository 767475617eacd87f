"""Layers that turn with the piece, measured on a torus, whose planes, sections and volume are known exactly."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from planner.errors import PlanningError
from planner.mesh.mesh import Mesh
from planner.process import Settings
from planner.recipe import Recipe
from planner.slicing.turned_outlines import plan_outlines
from planner.slicing.turning import TurnedLayer, turned_layers
from tests.unit.planner.small_parts import box
from tests.unit.planner.turned_parts import BEND_MM, Floats, bend, bend_path, from_centreline

QUARTER = bend(90.0)
TUBE_MM = 5.0
AXIS = np.array([-BEND_MM, 0.0, 0.0])


def layers_of(mesh: Mesh, path: Floats, recipe: Recipe) -> list[TurnedLayer]:
    return turned_layers(mesh, path, Settings.from_recipe(recipe), recipe)[0]


@pytest.fixture(scope="module")
def quarter() -> list[TurnedLayer]:
    return layers_of(QUARTER, bend_path(90.0), Recipe())


def thickness_over_disc(layer: TurnedLayer) -> Floats:
    """How far the top plane is from points all over the disc that the bottom plane cuts out of the torus, along its normal."""
    normal = layer.bottom[3:]
    turn = np.arctan2(-normal[0], normal[2])
    away = np.array([np.cos(turn), 0.0, np.sin(turn)])
    radius, angle = np.meshgrid(np.linspace(0.0, TUBE_MM, 6), np.linspace(0.0, 2.0 * np.pi, 37))
    disc = (BEND_MM + (radius * np.cos(angle)).reshape(-1, 1)) * away
    disc[:, 1] = (radius * np.sin(angle)).ravel()
    disc[:, 0] -= BEND_MM
    return np.asarray((layer.top[:3] - disc) @ layer.top[3:] / (normal @ layer.top[3:]))


def test_thickness_of_every_layer_lies_within_the_materials_bounds_all_over_its_section(
    quarter: list[TurnedLayer],
) -> None:
    for layer in quarter:
        thickness = thickness_over_disc(layer)
        assert thickness.min() >= 0.3 and thickness.max() <= 1.0
        np.testing.assert_allclose([thickness.min(), thickness.max()], layer.thickness_mm, rtol=5e-3)
        assert thickness.max() / thickness.min() == pytest.approx(30.0 / 20.0, rel=1e-3)
    fewest = 0.5 * np.pi * (BEND_MM + TUBE_MM) / 1.0
    assert fewest <= len(quarter) <= 1.05 * fewest + 1.0


def test_neighbours_share_a_plane_and_all_planes_go_through_the_axis_of_the_bend(quarter: list[TurnedLayer]) -> None:
    for lower, upper in pairwise(quarter):
        np.testing.assert_array_equal(lower.top, upper.bottom)
    for layer in quarter:
        assert abs((layer.bottom[:3] - AXIS) @ layer.bottom[3:]) < 1e-3
        turn = layer.build_from_layer[:3, :3]
        np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-12)
        np.testing.assert_allclose(turn[:, 2], layer.bottom[3:], atol=1e-12)
        np.testing.assert_allclose(layer.layer_from_build @ np.append(layer.bottom[:3], 1.0), [0, 0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(quarter[0].bottom[3:], [0.0, 0.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(quarter[-1].top[3:], [-1.0, 0.0, 0.0], atol=1e-9)


def test_volumes_of_the_layers_add_up_to_that_of_the_torus(quarter: list[TurnedLayer]) -> None:
    volume = 0.0
    for layer in quarter:
        middle = layer.region.areas[1]
        volume += middle.area * float(layer.height_at([[middle.centroid.x, middle.centroid.y]])[0])
    assert volume == pytest.approx(np.pi * TUBE_MM**2 * BEND_MM * 0.5 * np.pi, rel=3e-4)  # Pappus


def test_each_layer_rests_on_the_one_below_with_nearly_all_of_its_section(quarter: list[TurnedLayer]) -> None:
    disc = np.pi * TUBE_MM**2
    for layer in quarter:
        assert layer.region.overlap_mm2 == pytest.approx(disc, rel=5e-3)
        assert layer.region.overhang_mm2 < 0.005 * disc


def test_contours_and_walls_of_the_plan_lie_on_the_torus(quarter: list[TurnedLayer]) -> None:
    recipe = Recipe()
    u = np.linspace(0.0, 1.0, 181)
    for layer, (contours, walls) in zip(quarter[:6], plan_outlines(QUARTER, quarter[:6], recipe), strict=True):
        assert len(contours) == len(walls) == 1
        for curve, plane in ((walls[0].bottom, layer.bottom), (walls[0].top, layer.top)):
            points = curve.evaluate(u)
            assert np.abs((points - plane[:3]) @ plane[3:]).max() < 2e-3
            assert np.abs(from_centreline(points) - TUBE_MM).max() < 4e-3  # the facets: 1e-2
        outline = contours[0].curve.evaluate(np.linspace(*contours[0].curve.domain, 181))
        assert np.abs((outline - layer.bottom[:3]) @ layer.bottom[3:]).max() < 1e-9
        assert np.abs(from_centreline(outline) - TUBE_MM).max() < recipe.cusp_mm


def test_a_fixed_layer_height_holds_at_the_centroid_and_layers_are_even() -> None:
    half = bend(45.0, steps=16)
    layers = layers_of(half, bend_path(45.0), Recipe(layer_height_mm=0.7))
    at_centre = [float(layer.height_at([[0.0, 0.0]])[0]) for layer in layers]
    assert max(at_centre) <= 0.7 and min(at_centre) > 0.67
    assert len(layers) == int(np.ceil(0.25 * np.pi * BEND_MM / 0.7))
    assert max(layer.thickness_mm[1] for layer in layers_of(half, bend_path(45.0), Recipe(layer_height_mm=1.0))) <= 1.0


def test_layers_by_the_ruled_rule_keep_the_bounds_too() -> None:
    third = bend(30.0, steps=16)
    for layer in layers_of(third, bend_path(30.0, 7), Recipe(layer_rule="ruled")):
        thickness = thickness_over_disc(layer)
        assert thickness.min() >= 0.3 and thickness.max() <= 1.0


def test_a_bend_too_sharp_for_the_material_is_refused_with_its_place() -> None:
    with pytest.raises(PlanningError, match=r"bends too fast at \(-1[0-9.]+, .* 3.55 times .* allows 3") as caught:
        layers_of(bend(40.0, 14.0), bend_path(40.0, 9), Recipe())
    assert "cut the piece there" in caught.value.hint and "\n" not in str(caught.value)


def test_planes_that_cross_inside_the_piece_are_refused() -> None:
    path = np.array([[0.0, 0, 0, 0, 0, 1], [0, 0, 3, -0.6, 0, 0.8], [0, 0, 8, 0.6, 0, 0.8], [0, 0, 40, 0, 0, 1]])
    with pytest.raises(PlanningError, match=r"turn|bends"):
        layers_of(
            box(30.0, 10.0, 20.0).transformed(np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 10], [0, 0, 0, 1]])),
            path,
            Recipe(),
        )
