"""The side that a recipe names is the side on which upright walls lie."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
import shapely
import trimesh

from planner.errors import PlanningError
from planner.mesh import Mesh
from planner.pipeline import plan
from planner.recipe import Recipe
from planner.slicing.regions import LayerRegion, built_region, layer_regions

BALL = Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=4, radius=8.0))
UP = (0.0, 0.0, 1.0)
LEVELS = np.array([-6.0, -5.0, -3.5, 1.0, 2.0, 4.5, 6.0])


def radii(low: float, high: float) -> tuple[float, float]:
    """Least and greatest radius of the ball between two heights, mm."""
    ends = [float(np.sqrt(64.0 - z * z)) for z in (low, high)]
    return min(ends), 8.0 if low < 0.0 < high else max(ends)


def outline(region: LayerRegion) -> np.ndarray:
    points = shapely.get_coordinates(region.region.boundary)
    return np.asarray(np.hypot(points[:, 0], points[:, 1]))


@pytest.mark.parametrize("side", ["outside", "inside", "both"])
def test_a_ball_s_layers_lie_on_the_side_that_was_asked_for(side: Literal["outside", "inside", "both"]) -> None:
    for region in layer_regions(BALL, LEVELS, side=side):
        least, most = radii(region.z_bottom, region.z_top)
        if region.z_bottom < 0.0 < region.z_top:
            most = float(outline(region).max())  # the equator is in none of the three sections
        away = outline(region)
        middle = float(np.sqrt(64.0 - (0.5 * (region.z_bottom + region.z_top)) ** 2))
        wanted = {"outside": most, "inside": least, "both": middle}[side]
        np.testing.assert_allclose(away, wanted, atol=0.04)  # the facets' sagitta
        for area in region.areas:
            if side == "outside":
                assert shapely.difference(area, region.region).area < 1e-3
            if side == "inside":
                assert shapely.difference(region.region, area).area < 1e-3


def test_sections_that_hold_none_of_the_others_are_united_or_cut() -> None:
    boxes = [shapely.MultiPolygon([shapely.box(x, 0.0, x + 4.0, 2.0)]) for x in (0.0, 1.0, 2.0)]
    assert built_region(boxes, "outside").area == pytest.approx(12.0)
    assert built_region(boxes, "inside").area == pytest.approx(4.0)
    assert built_region(boxes, "both").equals(boxes[1])


def leaning() -> Mesh:
    """A square column of 8 mm that leans by 0.5 mm in x on each mm of height."""
    body = trimesh.creation.box((8.0, 8.0, 4.0))
    vertices = np.asarray(body.vertices).copy()
    vertices[:, 0] += 0.5 * vertices[:, 2]
    return Mesh.from_trimesh(trimesh.Trimesh(vertices, body.faces))


@pytest.mark.parametrize(("side", "shift"), [("outside", 0.25), ("inside", -0.25), ("both", 0.0)])
def test_contours_of_a_deposited_plan_lie_on_the_recipe_s_side_of_a_leaning_column(
    side: Literal["outside", "inside", "both"], shift: float
) -> None:
    made = plan(leaning(), Recipe(process="deposit", layer_height_mm=1.0, tolerance_side=side, build_direction=UP))
    for layer in made.layers:
        width = float(np.ptp(layer.contours[0].curve.evaluate(np.linspace(0.0, 1.0, 401))[:, 0]))
        assert width == pytest.approx(8.0 + 2.0 * shift, abs=2e-3)
        assert layer.contours[0].deviation_mm < 1e-3


@pytest.mark.parametrize(("process", "side", "share"), [
    ("hybrid", "both", 1.0), ("deposit", "outside", 1.0), ("deposit", "both", 0.5), ("deposit", "inside", 0.0),
])  # fmt: skip
def test_contours_of_a_part_that_widens_upwards_are_those_of_the_section_that_the_side_asks_for(
    process: Literal["hybrid", "deposit"], side: Literal["outside", "inside", "both"], share: float
) -> None:
    turned = np.linspace(0.0, 2.0 * np.pi, 128, endpoint=False)
    rings = [np.column_stack([r * np.cos(turned), r * np.sin(turned), np.full(128, r - 4.0)]) for r in (4.0, 12.0)]
    hull = trimesh.Trimesh(np.vstack(rings)).convex_hull
    made = plan(Mesh.from_trimesh(hull), Recipe(process=process, layer_height_mm=1.0, tolerance_side=side, build_direction=UP))
    for layer in made.layers:
        width = float(np.ptp(layer.contours[0].curve.evaluate(np.linspace(0.0, 1.0, 801))[:, 0]))
        low, high = 4.0 + layer.bottom[2], 4.0 + layer.top[2]
        assert 0.5 * width == pytest.approx(low + share * (high - low), abs=5e-3)


def test_a_hybrid_plan_has_metal_wherever_the_part_is_whatever_the_side() -> None:
    made = plan(leaning(), Recipe(layer_height_mm=1.0, tolerance_side="inside", build_direction=UP))
    for layer in made.layers:
        assert float(np.ptp(layer.contours[0].curve.control_points[:, 0])) == pytest.approx(8.5, abs=2e-3)


def test_a_layer_that_leans_by_its_own_width_has_no_inside() -> None:
    body = trimesh.creation.box((2.0, 20.0, 4.0))
    vertices = np.asarray(body.vertices).copy()
    vertices[:, 0] += 4.0 * vertices[:, 2]
    with pytest.raises(PlanningError, match="no outline lies on the side"):
        slanted = Mesh.from_trimesh(trimesh.Trimesh(vertices, body.faces))
        plan(slanted, Recipe(process="deposit", layer_height_mm=1.0, tolerance_side="inside", build_direction=UP))
