"""Cuts with a turning axis against sums of very many poses, and against cones and planes that they envelop."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from sim.process.sweep import Sweep, pieces_of, sweep_distance, sweep_of
from tests.unit.sim.cutting_bench import after_sweep, filled_mm3, leaning, swept, values
from tests.unit.sim.metal_bench import UP, block, vector

Array = NDArray[np.float64]

CELL = 0.25
EXACT = 0.1 * CELL
REACH = 40.0
CUTTERS = {"flat": (3.0, 0.0, REACH), "bull-nose": (3.0, 0.8, REACH), "ball": (3.0, 3.0, REACH)}
MOTIONS = {
    "tilts about its end": (vector(0.0, 0.0, 0.0), vector(0.0, 0.0, 0.0), leaning(0.0), leaning(25.0)),
    "tilts as it goes": (vector(-3.0, 0.0, 0.0), vector(3.0, 0.0, 0.0), leaning(5.0), leaning(20.0)),
    "tilts against its way": (vector(-3.0, 0.0, 0.0), vector(3.0, 0.0, 0.0), leaning(20.0), leaning(-5.0)),
    "swings across its way": (vector(-4.0, 0.0, 0.0), vector(4.0, 1.0, 0.5), leaning(10.0, 90.0), leaning(10.0, -60.0)),
    "dives as it tilts": (vector(0.0, 0.0, 2.0), vector(1.0, 0.0, -2.0), leaning(0.0), leaning(12.0, 45.0)),
    "hardly turns": (vector(-4.0, 0.0, 0.0), vector(4.0, 0.0, 0.0), leaning(30.0), leaning(30.5)),
}


@njit
def distances(sweep: Sweep, points: Array) -> Array:
    found = np.empty(len(points))
    for n in range(len(points)):
        found[n] = sweep_distance(sweep, points[n, 0], points[n, 1], points[n, 2])
    return found


@pytest.mark.parametrize("cutter", list(CUTTERS.values()), ids=list(CUTTERS))
@pytest.mark.parametrize("motion", list(MOTIONS.values()), ids=list(MOTIONS))
def test_distance_to_a_turning_sweep_is_that_of_the_sum_of_poses_up_to_the_reach(
    motion: tuple[Array, ...], cutter: tuple[float, float, float]
) -> None:
    cell = 0.1
    start, end, axis0, axis1 = motion
    random = np.random.default_rng(3)
    share, height, around = random.random(300), random.uniform(-0.3, REACH + 0.3, 300), random.uniform(0.0, 2.0 * np.pi, 300)
    axis = axis0 + share[:, None] * (axis1 - axis0)
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    side = np.cross(axis, vector(0.3, 1.0, 0.0))
    side /= np.linalg.norm(side, axis=1)[:, None]
    out = np.cos(around)[:, None] * side + np.sin(around)[:, None] * np.cross(axis, side)
    points = start + share[:, None] * (end - start) + height[:, None] * axis + random.uniform(2.6, 3.4, 300)[:, None] * out
    truth = swept(points, start, end, (axis0, axis1), cutter, 2001)
    parts = pieces_of(start, end, axis0, axis1, cutter[0], cutter[2], cell)
    found = np.full(300, np.inf)
    for part in range(parts):
        sweep = sweep_of(start, end, axis0, axis1, part / parts, (part + 1) / parts, np.array(cutter), cell)
        found = np.minimum(found, distances(sweep, points))
    near = np.abs(truth) < 3.0 * cell
    assert near.sum() > 40
    assert np.abs(found - truth)[near].max() < 0.1 * cell


@pytest.mark.parametrize("cutter", [(2.0, 0.0, 7.0), (2.0, 0.6, 7.0), (2.0, 2.0, 7.0)], ids=list(CUTTERS))
def test_metal_left_by_a_turning_cutter_is_that_left_by_the_sum_of_poses(cutter: tuple[float, float, float]) -> None:
    stock = block(vector(-4.0, -3.0, -1.5), vector(4.0, 3.0, 2.5), CELL)
    start, end, axes = vector(-3.0, -0.5, 0.0), vector(3.0, 0.5, -0.8), (leaning(25.0, 80.0), leaning(20.0, -120.0))
    before = filled_mm3(stock)
    expected = after_sweep(stock, start, end, axes, cutter, 250)
    cut = stock.cut(start, end, *axes, *cutter)
    assert np.abs(values(stock) - expected).max() < EXACT
    assert cut.removed_mm3 == pytest.approx(before - filled_mm3(stock), rel=1e-4)


def test_flank_milled_boss_is_a_cone() -> None:
    """Round a boss with the axis leaning outward by 12 degrees, the flank touches the cone r = 3 + (z - 3) tan 12 at every height."""
    lean, radius = np.radians(12.0), 3.0
    stock = block(vector(-5.5, -5.5, 0.0), vector(5.5, 5.5, 6.0), CELL)
    around = np.linspace(0.0, 2.0 * np.pi, 73)
    out = np.column_stack([np.cos(around), np.sin(around), 0.0 * around])
    axis = np.sin(lean) * out + np.cos(lean) * UP
    normal = np.cos(lean) * out - np.sin(lean) * UP  # of the cone, outward
    foot = (3.0 - 6.0 * np.tan(lean)) * out + vector(0.0, 0.0, -3.0)  # on the cone, below the block
    path = np.hstack([(foot + radius * normal)[:-1], (foot + radius * normal)[1:], axis[:-1], axis[1:]])
    for further in (2.0, 0.0):
        wide = path.copy()
        wide[:, :3] += further * out[:-1]
        wide[:, 3:6] += further * out[1:]
        stock.cut_pieces(wide, radius, 0.0, 20.0)
    angle, z = (g.ravel() for g in np.meshgrid(np.linspace(0.0, 6.2, 200), np.linspace(0.6, 5.4, 13)))
    r = 3.0 + (z - 3.0) * np.tan(lean)
    cone = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
    assert np.abs(stock.distance(cone)).max() < EXACT
    assert np.abs(np.linalg.norm(stock.field.gradient(cone), axis=1) - 1.0).max() < 0.04


def test_cutter_that_tilts_in_the_plane_of_its_way_leaves_flat_walls() -> None:
    stock = block(vector(-4.0, -4.0, 0.0), vector(4.0, 4.0, 6.0), CELL)
    stock.cut(vector(0.0, 0.0, -2.0), vector(0.0, 0.0, -2.0), leaning(-35.0), leaning(35.0), 1.5, 0.0, 20.0)
    x, z = (g.ravel() for g in np.meshgrid(np.linspace(-1.0, 1.0, 9), np.linspace(0.6, 5.4, 12)))
    for side in (-1.5, 1.5):
        assert np.abs(stock.distance(np.column_stack([x, np.full_like(x, side), z]))).max() < EXACT
