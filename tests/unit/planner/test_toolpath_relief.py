"""Layers of varying height: beads follow the height by speed and powder, never too low, their width kept."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from planner.errors import RecipeError
from planner.plan import Operation
from planner.process import Settings
from planner.recipe import Recipe
from planner.slicing.regions import LayerRegion, layer_regions
from planner.toolpath.deposit import deposit_operations
from tests.unit.planner.small_parts import box, tube

Floats = NDArray[np.float64]

RECIPE = Recipe(process="deposit")
SETTINGS = Settings.from_recipe(RECIPE)
LENGTH_MM = 20.0
LEAST_MM, MOST_MM = 0.35, 0.9


def wedge(xy: Floats) -> Floats:
    """Height that rises along x from the least to the greatest, over a part of the length centred at 0."""
    return np.asarray(LEAST_MM + (MOST_MM - LEAST_MM) * np.clip(xy[:, 0] / LENGTH_MM + 0.5, 0.0, 1.0))


def layer_of(shape: str) -> LayerRegion:
    mesh = box(LENGTH_MM, 12.0, MOST_MM) if shape == "box" else tube(8.0, 10.0, MOST_MM)
    low = float(mesh.vertices[:, 2].min())
    return layer_regions(mesh, np.array([low, low + MOST_MM]))[0]


def made(shape: str) -> list[Operation]:
    layer = layer_of(shape)
    operations, dropped = deposit_operations(layer, SETTINGS.bead_for(MOST_MM), SETTINGS, height_at=wedge)
    assert not dropped
    return operations


def area_mm2(rows: Floats) -> Floats:
    """Cross-section that set-points lay down, by conservation of mass."""
    law = SETTINGS.material.bead
    return np.asarray(law.catch_efficiency * rows[:, 3] / 60.0 / (SETTINGS.material.density_g_mm3 * rows[:, 1]))


def width_mm(rows: Floats) -> Floats:
    law = SETTINGS.material.bead
    return np.asarray(law.width_coefficient * rows[:, 2] ** law.width_power_exponent * rows[:, 1] ** law.width_speed_exponent)


@pytest.mark.parametrize("shape", ["box", "tube"])
def test_beads_of_a_wedge_bring_the_metal_that_each_place_takes_and_hardly_more(shape: str) -> None:
    places, shares, widths = [], [], []
    reference = SETTINGS.bead_for(MOST_MM)
    for operation in made(shape):
        for step in operation.passes:
            lit = step.setpoints[step.setpoints[:, 2] > 0.0]
            ends = np.append(step.setpoints[1:, 0], step.tip.length)[step.setpoints[:, 2] > 0.0]
            for row, end in zip(lit, ends, strict=True):
                xy = step.tip.evaluate(step.tip.at_arc_length(np.linspace(row[0] + 1e-6, end - 1e-6, 40)))[:, :2]
                places.append(xy)
                shares.append(np.full(40, area_mm2(row[None])[0]))
                widths.append(width_mm(row[None])[0])
    high = wedge(np.concatenate(places)) * (1.0 + SETTINGS.overbuild)
    if shape == "box":
        wanted = high * reference.step_mm
        excess = np.concatenate(shares) / wanted
        evened = 0.04  # of a bead's metal: lines lie evenly over the region, not a step apart, and bring what it takes
        assert excess.min() > 1.0 - evened
        assert excess.max() < 1.0 + 2 * 0.04 + 0.03 + evened
        assert np.ptp(widths) < 0.02 * reference.width_mm
    else:
        excess = np.concatenate(shares) / (2.0 * high)
        assert excess.min() > 0.95 and excess.max() < 1.15


def test_rows_are_no_denser_than_changes_of_height_ask_for() -> None:
    most = int(np.ceil(np.log(MOST_MM / LEAST_MM) / np.log(1.04))) + 3
    for operation in made("box"):
        for step in operation.passes:
            assert len(step.setpoints) <= 2 * most + 2
            assert (np.diff(step.setpoints[:, 0]) > 0.0).all()


def test_setpoints_stay_inside_the_material_s_window() -> None:
    facts = SETTINGS.material.deposition
    for operation in made("box"):
        rows = np.vstack([step.setpoints for step in operation.passes])
        lit = rows[rows[:, 2] > 0.0]
        for column, window in ((1, facts.speed_mm_s), (2, facts.laser_w), (3, facts.powder_g_min)):
            assert lit[:, column].min() >= window.min - 1e-9 and lit[:, column].max() <= window.max + 1e-9


def test_even_height_gives_the_level_layer_s_passes() -> None:
    layer, bead = layer_of("box"), SETTINGS.bead_for(MOST_MM)
    level, _ = deposit_operations(layer, bead, SETTINGS)
    even, _ = deposit_operations(layer, bead, SETTINGS, height_at=lambda xy: np.full(len(xy), MOST_MM))
    for first, second in zip(level, even, strict=True):
        for one, other in zip(first.passes, second.passes, strict=True):
            np.testing.assert_allclose(one.setpoints, other.setpoints, rtol=1e-9)


def test_height_that_no_bead_of_the_window_makes_is_refused_in_one_line() -> None:
    layer = layer_of("box")
    with pytest.raises(RecipeError, match="at most"):
        deposit_operations(layer, SETTINGS.bead_for(MOST_MM), SETTINGS, height_at=lambda xy: np.full(len(xy), 4.0))


def test_region_of_the_layer_is_covered_as_before() -> None:
    layer = layer_of("box")
    bead = SETTINGS.bead_for(MOST_MM)
    operations, _ = deposit_operations(layer, bead, SETTINGS, height_at=wedge)
    lines = [shapely.LineString(step.tip.evaluate(step.tip.sample(0.01))[:, :2]) for op in operations for step in op.passes]
    covered = shapely.union_all([line.buffer(0.5 * bead.width_mm) for line in lines])
    assert shapely.difference(layer.region, covered).area < 0.01 * layer.region.area
