"""What hangs over nothing: the rule by itself, and walls that lean with and without the head tilted along them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.process.deposit import deposit
from sim.process.pool import HANGING, HOLDING
from sim.process.sag import ADHESION_WIDTHS, DROOP_HEIGHTS, droop_mm, hang_lengths
from sim.process.stock import Stock
from tests.unit.sim.metal_bench import BEAD, LAW, MATERIAL, POWDER_G_MIN, POWER_W, SPEED_MM_S, UP, block, vector

Array = NDArray[np.float64]

LAYER = 0.9 * BEAD.area_mm2 / BEAD.width_mm  # a wall of single tracks grows by a little more
LAYERS = 12
HALF = 5.0


def wall(lean_deg: float, axis: Array, down: Array) -> Stock:
    """A single-track wall that leans towards +y, laid along x on a plate."""
    a = np.radians(lean_deg)
    tangent = vector(0.0, np.sin(a), np.cos(a))
    stock = Stock(np.array([[-9.0, -4.0, -1.5], [9.0, 16.0, 12.0]]), 0.25, MATERIAL, np.array([[-50.0, -50.0, -9.0], [50.0, 50.0, 0.0]]))
    upright = abs(axis @ UP) > 0.999
    for layer in range(LAYERS):
        at = tangent * (layer * LAYER / np.cos(a) if upright else layer * LAYER)  # layers are as thick along the axis
        deposit(
            stock, LAW, at - vector(HALF, 0.0, 0.0), at + vector(HALF, 0.0, 0.0), axis, POWER_W, POWDER_G_MIN,
            2.0 * HALF / SPEED_MM_S, down=down,
        )  # fmt: skip
    return stock


def built_share(stock: Stock, lean_deg: float, along_axis: bool) -> float:
    """Share of the wall's middle line, from the third to the last layer but one, that is metal."""
    a = np.radians(lean_deg)
    length = (LAYERS - 2) * LAYER / (1.0 if along_axis else np.cos(a))
    s = np.linspace(2.0 * LAYER, length, 60)
    points = np.column_stack([0.0 * s, s * np.sin(a), s * np.cos(a)])
    return float((stock.distance(points) < 0.0).mean())


@pytest.mark.parametrize("lean_deg", [15.0, 30.0])
def test_wall_that_leans_no_more_than_the_material_holds_stands_without_tilting(lean_deg: float) -> None:
    assert lean_deg <= MATERIAL.deposition.max_overhang_deg
    stock = wall(lean_deg, UP, -UP)
    assert built_share(stock, lean_deg, along_axis=False) == 1.0
    assert stock.lost_powder_mm3 < 0.04 * stock.deposited_mm3


def test_wall_that_leans_sixty_degrees_fails_with_the_head_upright() -> None:
    stock = wall(60.0, UP, -UP)
    assert built_share(stock, 60.0, along_axis=False) < 0.7
    top = (LAYERS - 2) * LAYER
    beyond = np.array([[x, y, z] for x in (-3.0, 0.0, 3.0) for y in np.arange(-2.0, 15.0, 0.25) for z in np.arange(top - LAYER, top, 0.2)])
    assert (stock.distance(beyond) > 0.0).all()
    y = (LAYERS - 1) * LAYER * np.tan(np.radians(60.0))
    fallen = np.array([[x, y, 0.1] for x in (-3.0, 0.0, 3.0)])
    assert (stock.distance(fallen) < 0.0).all()  # the last track lies on the plate beside it
    missing = 2.0 * HALF * BEAD.area_mm2 * LAYERS - stock.deposited_mm3
    assert missing > 0.3 * stock.deposited_mm3


def test_same_wall_holds_with_the_table_turned_so_that_it_grows_upright() -> None:
    a = np.radians(60.0)
    axis = vector(0.0, np.sin(a), np.cos(a))
    stock = wall(60.0, axis, -axis)
    assert built_share(stock, 60.0, along_axis=True) == 1.0
    assert stock.deposited_mm3 > 0.9 * 2.0 * HALF * BEAD.area_mm2 * LAYERS


def test_same_wall_holds_with_the_head_tilted_over_a_part_that_lies_still_but_runs_downhill() -> None:
    a = np.radians(60.0)
    axis = vector(0.0, np.sin(a), np.cos(a))
    turned, still = wall(60.0, axis, -axis), wall(60.0, axis, -UP)
    assert built_share(still, 60.0, along_axis=True) == 1.0
    side = vector(0.0, np.cos(a), -np.sin(a))  # out of the wall's lower side
    reach = np.arange(0.5, 2.5, 0.01)
    lower = [float(reach[s.distance(5.0 * LAYER * axis + reach[:, None] * side) < 0.0].max()) for s in (turned, still)]
    assert 0.0 <= lower[1] - lower[0] < 0.5


def test_bead_half_over_an_edge_droops_beneath_its_plane_and_more_so_with_gravity_along_the_axis() -> None:
    def lowest(down: Array) -> float:
        stock = block(vector(-6.0, -4.0, -3.0), vector(6.0, 0.0, 0.0), 0.1)
        deposit(stock, LAW, vector(-4.0, 0.0, 0.0), vector(4.0, 0.0, 0.0), UP, POWER_W, POWDER_G_MIN, 8.0 / SPEED_MM_S, down=down)
        z = np.arange(-1.5, 0.3, 0.01)
        hanging = np.column_stack([np.zeros_like(z), np.full_like(z, 0.8 * ADHESION_WIDTHS * BEAD.width_mm), z])
        return float(z[stock.distance(hanging) < 0.0].min())

    beneath, sideways = lowest(-UP), lowest(vector(0.0, 1.0, 0.0))
    assert sideways == pytest.approx(0.0, abs=0.06)
    assert -DROOP_HEIGHTS * BEAD.height_mm - 0.1 < beneath < -0.05


def test_droop_begins_at_the_overhang_that_holds_and_ends_where_metal_falls() -> None:
    width, high, hold = 2.6, 0.9, np.tan(np.radians(30.0))
    hang = np.linspace(0.0, ADHESION_WIDTHS * width, 50)
    droop = np.array([droop_mm(float(u), width, high, hold) for u in hang])
    assert (droop[hang <= high * hold] == 0.0).all()
    assert (np.diff(droop) >= 0.0).all()
    assert droop[-1] == pytest.approx(DROOP_HEIGHTS * high)
    assert np.isinf(droop_mm(ADHESION_WIDTHS * width + 0.01, width, high, hold))


def test_hang_lengths_are_the_distances_from_the_nearest_holding_column() -> None:
    rng = np.random.default_rng(4)
    kind = np.where(rng.random((14, 17)) < 0.12, HOLDING, HANGING).astype(np.int8)
    found = hang_lengths(kind, 5)
    anchors = np.argwhere(kind == HOLDING)
    for i, j in np.argwhere(kind == HANGING):
        true = np.linalg.norm(anchors - [i, j], axis=1).min()
        assert found[i, j] == pytest.approx(true) if true <= 5.0 else found[i, j] > 5.0
