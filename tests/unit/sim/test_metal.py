"""Traces of a machine against the metal that they leave: starts, stops, standing, marks, cuts."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from config import load_cell
from sim.process.metal import Metal
from sim.trace import Trace
from tests.unit.sim.metal_bench import BEAD, LAW, MATERIAL, height, plate, vector

Array = NDArray[np.float64]

CELL = load_cell("trunnion_tcp")
HEAD = next(tool.number for tool in CELL.tools if tool.kind == "deposition")
CUTTER = next(tool for tool in CELL.tools if tool.kind == "end_mill")


def trace(
    points: Array, seconds: float | Array, power_w: float | Array = 1200.0, powder: float | Array = 12.0, tool: int = HEAD, line: int = 1
) -> Trace:
    """Straight moves through points (k + 1, 3) with the head upright over a table that lies flat."""
    k = len(points) - 1
    up = np.tile(vector(0.0, 0.0, 1.0), (k, 1))
    each = [np.broadcast_to(np.asarray(v, dtype=np.float64), k).copy() for v in (power_w, powder, seconds)]
    joints = np.zeros((k, 5))
    return Trace(points[:-1], points[1:], up, up, -up, *each, np.full(k, line), joints, joints, tool, 0.0, True)


def metal(cell_mm: float = 0.25, top_mm: float = 9.0) -> Metal:
    return Metal(plate(20.0, cell_mm, top_mm), CELL, np.eye(4))


def added(made: Metal) -> float:
    return made.stock.volume_mm3(-1.0) - plate(20.0, made.stock.cell_mm, 9.0).volume_mm3(-1.0)


def straight(length_mm: float, parts: int) -> Array:
    return np.column_stack([np.linspace(-0.5 * length_mm, 0.5 * length_mm, parts + 1), np.zeros(parts + 1), np.zeros(parts + 1)])


def test_what_is_laid_does_not_depend_on_how_the_motion_is_cut_into_steps() -> None:
    whole, parted = metal(), metal()
    whole.apply(trace(straight(10.0, 1), 10.0 / 12.0))
    for a, b in zip(straight(10.0, 37)[:-1], straight(10.0, 37)[1:], strict=True):
        parted.apply(trace(np.array([a, b]), 10.0 / 37.0 / 12.0))
    whole.finish()
    parted.finish()
    assert parted.stock.deposited_mm3 == pytest.approx(whole.stock.deposited_mm3, rel=1e-4)
    x = np.column_stack([np.linspace(-6.0, 6.0, 200), np.zeros(200), np.full(200, 0.5)])
    assert np.abs(whole.stock.distance(x) - parted.stock.distance(x)).max() < 0.02


def test_light_at_standstill_leaves_a_blob_that_grows_with_the_dwell() -> None:
    tall, wide, volume = [], [], []
    for dwell in (0.2, 0.6, 1.5, 3.0):
        made = metal()
        made.apply(trace(np.zeros((2, 3)), dwell))
        made.finish()
        tall.append(height(made.stock, 0.0, 0.0, 8.9))
        y = np.arange(-6.0, 6.0, 0.02)
        inside = made.stock.distance(np.column_stack([0.0 * y, y, np.full_like(y, 0.2)])) < 0.0
        wide.append(np.ptp(y[inside]) if inside.any() else 0.0)
        volume.append(added(made))
        assert volume[-1] == pytest.approx(made.stock.deposited_mm3, rel=0.01)
    assert (np.diff(tall) > 0.0).all() and (np.diff(wide) > 0.0).all() and (np.diff(volume) > 0.0).all()
    rate = 12.0 / 60.0 / MATERIAL.density_g_mm3
    assert volume[-1] < 3.0 * rate


def test_stop_in_the_middle_of_a_track_swells_it_there() -> None:
    steady, stopped = metal(), metal()
    steady.apply(trace(straight(12.0, 2), 0.5))
    stopped.apply(trace(np.array([[-6.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [6.0, 0.0, 0.0]]), np.array([0.5, 0.5, 0.5])))
    steady.finish()
    stopped.finish()
    assert height(stopped.stock, 0.0, 0.0, 8.9) > 1.5 * height(steady.stock, 0.0, 0.0, 8.9)
    assert height(stopped.stock, -4.5, 0.0, 8.9) == pytest.approx(height(steady.stock, -4.5, 0.0, 8.9), abs=0.02)


@pytest.mark.parametrize("late_mm", [2.0, 4.0])
def test_light_that_comes_late_begins_the_bead_late(late_mm: float) -> None:
    made = metal(0.2)
    points = np.array([[-6.0, 0.0, 0.0], [-6.0 + late_mm, 0.0, 0.0], [6.0, 0.0, 0.0]])
    made.apply(trace(points, np.linalg.norm(np.diff(points, axis=0), axis=1) / 12.0, np.array([0.0, 1200.0])))
    made.finish()
    x = np.arange(-8.0, 8.0, 0.02)
    metal_at = x[made.stock.distance(np.column_stack([x, 0.0 * x, np.full_like(x, 0.1)])) < 0.0]
    assert -6.0 + late_mm - 0.5 * BEAD.width_mm - 0.1 < metal_at.min() < -6.0 + late_mm + 0.3
    assert metal_at.max() == pytest.approx(6.0 + 0.5 * BEAD.width_mm, abs=0.4)


def test_powder_without_light_is_lost_and_light_without_powder_adds_nothing() -> None:
    made = metal()
    made.apply(trace(straight(8.0, 4), 0.2, 0.0))
    made.finish()
    assert added(made) == 0.0
    assert made.powder_g == pytest.approx(12.0 / 60.0 * 0.8)
    made.apply(trace(straight(8.0, 4), 0.2, 1200.0, 0.0))
    made.finish()
    assert added(made) == 0.0
    assert made.stock.marks(np.zeros((1, 3)))[0] == 1
    assert made.base_k > LAW.heat.ambient_k


def test_cells_carry_the_layer_that_made_them_and_cutters_the_tool() -> None:
    made = metal()
    made.layer_of_line = np.array([0, 0, 4, 7], dtype=np.int16)
    made.apply(trace(straight(8.0, 3), 0.25, line=2))
    made.apply(trace(straight(8.0, 3) + vector(0.0, 6.0, 0.0), 0.25, line=3))
    made.finish()
    tops = np.array([[0.0, y, height(made.stock, 0.0, y, 8.9)] for y in (0.0, 6.0)])
    assert made.stock.marks(tops).tolist() == [5, 8]
    path = np.array([[-12.0, 0.0, 0.4], [12.0, 0.0, 0.4]])
    made.apply(trace(path, 3.0, 0.0, 0.0, CUTTER.number, 9))
    made.finish()
    assert made.stock.marks(vector(0.0, 0.0, 0.4)[None, :])[0] == -CUTTER.number
    assert {cut.line for cut in made.engaged} == {9}
    assert 0.0 < max(cut.depth_mm for cut in made.engaged) < BEAD.height_mm - 0.3


def test_laid_tells_each_piece_of_the_trace() -> None:
    made = metal()
    made.apply(trace(straight(8.0, 8) + vector(0.0, 0.0, 1.0), 8.0 / 12.0 / 8.0, np.array([0.0] + 7 * [1200.0])))
    laid = made.laid
    assert all(column.shape == (8,) for column in laid)
    assert np.isnan(laid.defocus_mm[0]) and not np.isnan(laid.base_k).any()
    assert laid.defocus_mm[4:] == pytest.approx(1.0, abs=0.05)
    assert (laid.unsupported[1:] == 0.0).all() and (laid.catch[4:] > 0.5).all()


def test_restored_metal_goes_on_as_if_nothing_had_been() -> None:
    through, back = metal(), metal()
    first, then = trace(straight(8.0, 5), 0.13), trace(straight(8.0, 5) + vector(0.0, 1.6, 0.0), 0.13)
    for made in (through, back):
        made.apply(first)
    state = back.snapshot()
    back.apply(trace(straight(3.0, 2), 0.4))
    back.restore(state)
    for made in (through, back):
        made.apply(then)
        made.finish()
    ours, theirs = through.snapshot(), back.snapshot()
    assert all(np.array_equal(ours[key], theirs[key]) for key in ours)
