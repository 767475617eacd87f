"""Cuts with the axis still against planes, slots, cylinders, spheres and sums of poses that are known exactly."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sim.process.removal import LOOKED, REMOVED
from sim.process.sweep import cutter_distance
from tests.unit.sim.cutting_bench import after_sweep, cells, filled_mm3, leaning, values
from tests.unit.sim.metal_bench import UP, block, plate, track, vector

CELL = 0.25
EXACT = 0.1 * CELL  # what is asked of a surface
LOW, HIGH = vector(-8.0, -6.0, -4.0), vector(8.0, 6.0, 2.0)


def test_faced_plane_lies_where_the_cutter_ran() -> None:
    stock = block(LOW, HIGH, CELL)
    for y in (-6.0, -2.0, 2.0, 6.0):
        stock.cut(vector(-14.0, y, 0.93), vector(14.0, y, 0.93), UP, UP, 4.0, 0.0, 40.0)
    x, y = (g.ravel() for g in np.meshgrid(np.linspace(-7.0, 7.0, 30), np.linspace(-5.0, 5.0, 30)))
    plane = np.column_stack([x, y, np.full_like(x, 0.93)])
    assert np.abs(stock.distance(plane)).max() < EXACT
    assert np.abs(stock.field.gradient(plane) - UP).max() < 0.01
    assert stock.volume_mm3(-6.0) == pytest.approx(16.0 * 12.0 * 4.93, rel=0.005)


def test_slot_has_its_width_depth_and_round_ends() -> None:
    stock = block(LOW, HIGH, CELL)
    before, cells_before = stock.volume_mm3(-6.0), filled_mm3(stock)
    cut = stock.cut(vector(-4.0, 0.3, 0.5), vector(4.0, 0.3, 0.5), UP, UP, 2.0, 0.0, 40.0)
    assert cut.engaged_mm == stock.band_mm
    assert cut.removed_mm3 == pytest.approx(cells_before - filled_mm3(stock), rel=1e-4)
    x = np.linspace(-3.5, 3.5, 40)
    for wall in (0.3 + 2.0, 0.3 - 2.0):
        assert np.abs(stock.distance(np.column_stack([x, np.full_like(x, wall), np.full_like(x, 1.3)]))).max() < EXACT
    angle = np.linspace(-0.45 * np.pi, 0.45 * np.pi, 60)
    end = np.column_stack([4.0 + 2.0 * np.cos(angle), 0.3 + 2.0 * np.sin(angle), np.full_like(angle, 1.3)])
    assert np.abs(stock.distance(end)).max() < EXACT
    assert np.abs(np.linalg.norm(stock.field.gradient(end), axis=1) - 1.0).max() < 0.03
    removed = 1.5 * (8.0 * 4.0 + np.pi * 4.0)
    assert before - stock.volume_mm3(-6.0) == pytest.approx(removed, rel=0.01)
    assert stock.removed_mm3 == cut.removed_mm3


def test_cylinder_milled_along_a_helix_with_short_flutes_is_round() -> None:
    stock = block(vector(-6.0, -6.0, -1.0), vector(6.0, 6.0, 3.0), CELL)
    turn = np.linspace(0.0, 6.0, 6 * 120 + 1)
    height = np.maximum(3.0 - turn, -1.5)  # 1 mm a turn, down through the whole block
    for offset in (6.0, 4.0):
        path = np.column_stack([(3.7 + offset) * np.cos(2.0 * np.pi * turn), (3.7 + offset) * np.sin(2.0 * np.pi * turn), height])
        upright = np.tile(UP, (len(path) - 1, 1))
        stock.cut_pieces(np.hstack([path[:-1], path[1:], upright, upright]), 4.0, 0.0, 1.6)
    probe = np.array([[3.7 * np.cos(a), 3.7 * np.sin(a), z] for a in np.linspace(0.0, 6.2, 170) for z in np.linspace(-0.6, 2.6, 9)])
    assert np.abs(stock.distance(probe)).max() < EXACT  # away from the edges at top and bottom
    assert np.abs(np.linalg.norm(stock.field.gradient(probe), axis=1) - 1.0).max() < 0.03
    assert stock.volume_mm3(-3.0) == pytest.approx(np.pi * 3.7**2 * 4.0, rel=0.005)


def test_sphere_milled_with_a_ball_along_parallels_is_a_sphere() -> None:
    """Parallels 0.35 mm apart leave cusps of 0.35^2 / 8 (1/3 + 1/5) = 0.008 mm, their chords 0.005 mm."""
    ball, sphere = 3.0, 5.0
    stock = block(vector(-6.0, -6.0, -2.0), vector(6.0, 6.0, 6.0), CELL)
    for radius in (9.0, 7.0):  # the corners first
        ring = [vector((ball + radius) * np.cos(a), (ball + radius) * np.sin(a), -6.0) for a in np.linspace(0.0, 2.0 * np.pi, 91)]
        for a, b in itertools.pairwise(ring):
            stock.cut(a, b, UP, UP, ball, ball, 40.0)
    for polar in np.arange(0.0, np.radians(80.0), 0.35 / sphere):
        around = np.linspace(0.0, 2.0 * np.pi, 91)
        r = (sphere + ball) * np.sin(polar)
        path = np.column_stack([r * np.cos(around), r * np.sin(around), np.full(91, (sphere + ball) * np.cos(polar) - ball)])
        upright = np.tile(UP, (90, 1))
        stock.cut_pieces(np.hstack([path[:-1], path[1:], upright, upright]), ball, ball, 40.0)
    polar, around = (g.ravel() for g in np.meshgrid(np.radians(np.linspace(1.0, 75.0, 60)), np.linspace(0.0, 6.2, 80)))
    away = np.column_stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)])
    assert np.abs(stock.distance(sphere * away)).max() < EXACT
    assert np.abs((stock.field.gradient(sphere * away) * away).sum(axis=1) - 1.0).max() < 0.06


@pytest.mark.parametrize("corner", [0.0, 0.5, 2.0])
@pytest.mark.parametrize(
    ("start", "end"), [((-3.0, 0.0, 1.0), (3.0, 1.0, -1.0)), ((-2.0, 0.0, -0.5), (2.0, 0.0, 1.5)), ((0.0, 0.0, 2.5), (0.0, 0.0, -1.0))]
)
def test_oblique_plunges_and_ramps_sweep_what_many_small_steps_sweep(
    corner: float, start: tuple[float, float, float], end: tuple[float, float, float]
) -> None:
    stock = block(vector(-4.0, -3.0, -2.0), vector(4.0, 3.0, 2.0), CELL)
    expected = after_sweep(stock, vector(*start), vector(*end), (UP, UP), (2.0, corner, 3.0), 200)
    stock.cut(vector(*start), vector(*end), UP, UP, 2.0, corner, 3.0)
    assert np.abs(values(stock) - expected).max() < EXACT


@settings(max_examples=8, deadline=None, derandomize=True)
@given(
    points=st.tuples(*(st.floats(-4.0, 4.0) for _ in range(6))),
    tilt=st.tuples(st.floats(0.0, 89.0), st.floats(0.0, 360.0)),
    corner=st.sampled_from([0.0, 0.4, 1.5]),
    flute=st.floats(2.0, 9.0),
)
def test_any_straight_cut_leaves_what_the_sum_of_poses_leaves(
    points: tuple[float, ...], tilt: tuple[float, float], corner: float, flute: float
) -> None:
    stock = block(vector(-4.0, -3.0, -3.0), vector(4.0, 3.0, 3.0), 0.4)
    start, end, axis = vector(*points[:3]), vector(*points[3:]), leaning(*tilt)
    expected = after_sweep(stock, start, end, (axis, axis), (1.5, corner, flute), 150)
    stock.cut(start, end, axis, axis, 1.5, corner, flute)
    assert np.abs(values(stock) - expected).max() < 0.1 * 0.4


def test_cutter_distance_is_a_distance() -> None:
    assert cutter_distance(5.0, 3.0, 4.0, 0.0) == pytest.approx(1.0)
    assert cutter_distance(7.0, -4.0, 4.0, 0.0) == pytest.approx(5.0)
    assert cutter_distance(0.0, -1.0, 4.0, 4.0) == pytest.approx(1.0)
    assert cutter_distance(0.0, 4.0, 4.0, 4.0) == pytest.approx(-4.0)
    assert cutter_distance(4.0, 0.0, 4.0, 1.0) == pytest.approx(np.sqrt(2.0) - 1.0)
    assert cutter_distance(7.0, 14.0, 4.0, 0.0, 10.0) == pytest.approx(5.0)
    assert cutter_distance(0.0, 9.0, 4.0, 0.0, 10.0) == pytest.approx(-1.0)


def test_cutting_air_meets_no_metal() -> None:
    stock = block(LOW, HIGH, CELL)
    cut = stock.cut(vector(-8.0, 0.0, 2.3), vector(8.0, 0.0, 2.3), UP, UP, 4.0, 0.0, 40.0)
    assert cut.engaged_mm == cut.gouge_mm == cut.removed_mm3 == 0.0


def test_metal_above_the_flutes_is_not_cut() -> None:
    stock = block(LOW, HIGH, CELL)
    stock.cut(vector(-12.0, 0.0, -2.0), vector(12.0, 0.0, -2.0), UP, UP, 2.0, 0.0, 1.5)
    assert stock.distance(np.array([[0.0, 0.0, -1.25]]))[0] == pytest.approx(stock.band_mm, abs=EXACT)
    assert stock.distance(np.array([[0.0, 0.0, -0.5], [0.0, 0.0, -2.0]])) == pytest.approx([0.0, 0.0], abs=EXACT)
    assert stock.distance(np.array([[0.0, 0.0, 0.5]]))[0] == pytest.approx(-stock.band_mm, abs=EXACT)


def test_metal_added_and_then_milled_leaves_exactly_the_target() -> None:
    stock = plate(20.0, 0.2, 4.0)
    for layer in range(2):
        for i in range(6):
            y = (i - 2.5) * 1.6
            track(stock, vector(-6.0, y, 0.9 * layer), vector(6.0, y, 0.9 * layer))
    for y in (-4.0, 0.0, 4.0):
        stock.cut(vector(-12.0, y, 1.2), vector(12.0, y, 1.2), UP, UP, 4.0, 0.0, 40.0)
    corners = [(9.0, 7.0), (-9.0, 7.0), (-9.0, -7.0), (9.0, -7.0), (9.0, 7.0)]  # round a block of 10 by 6
    for a, b in itertools.pairwise(corners):
        stock.cut(vector(*a, 0.0), vector(*b, 0.0), UP, UP, 4.0, 0.0, 40.0)
    assert stock.volume_mm3(0.0) == pytest.approx(10.0 * 6.0 * 1.2, rel=0.01)
    probe = np.array([[x, y, 1.2] for x in (-4.0, 0.0, 4.0) for y in (-2.0, 0.0, 2.0)] + [[5.0, 0.0, 0.7], [0.0, -3.0, 0.5]])
    assert np.abs(stock.distance(probe)).max() < 0.02


def test_cut_before_the_bead_is_not_the_bead_before_the_cut() -> None:
    steps = [
        lambda stock: track(stock, vector(-5.0, 0.0, 0.0), vector(5.0, 0.0, 0.0)),
        lambda stock: stock.cut(vector(-9.0, 0.0, 0.3), vector(9.0, 0.0, 0.3), UP, UP, 4.0, 0.0, 40.0),
    ]
    volume = []
    for order in (steps, steps[::-1]):
        stock = plate(16.0, 0.2, 3.0)
        for step in order:
            step(stock)
        volume.append(stock.volume_mm3(0.35))
    assert volume[0] < 0.5
    assert volume[1] > 2.0


@pytest.mark.parametrize("cell", [0.25, 0.2])
@pytest.mark.parametrize("below", [0.0, 0.04, 0.11])
def test_free_block_milled_flush_or_past_its_underside_has_the_volume_and_the_distances_of_the_box(cell: float, below: float) -> None:
    stock = block(vector(-6.0, -5.0, 0.0), vector(6.0, 5.0, 6.0), cell)
    for y in (-4.0, -1.0, 2.0, 5.0):
        stock.cut(vector(-9.0, y, 4.0), vector(9.0, y, 4.0), UP, UP, 2.0, 0.0, 30.0)
    for a, b in (((6.0, -7.0), (6.0, 7.0)), ((-6.0, 7.0), (-6.0, -7.0)), ((-8.0, 5.0), (8.0, 5.0)), ((8.0, -5.0), (-8.0, -5.0))):
        stock.cut(vector(*a, -below), vector(*b, -below), UP, UP, 2.0, 0.0, 30.0)
    area = 2.0 * (8.0 * 6.0 + 8.0 * 4.0 + 6.0 * 4.0)
    assert stock.volume_mm3(-2.0) == pytest.approx(8.0 * 6.0 * 4.0, abs=0.1 * cell * area)
    assert stock.volume_mm3(-2.0) == pytest.approx(8.0 * 6.0 * 4.0, abs=1.5)
    out = np.abs(cells(stock) - vector(0.0, 0.0, 2.0)) - vector(4.0, 3.0, 2.0)
    truth = np.linalg.norm(np.maximum(out, 0.0), axis=-1) + np.minimum(out.max(axis=-1), 0.0)
    error = np.abs(values(stock) - np.clip(truth, -stock.band_mm, stock.band_mm))
    assert error.max() < 1.01 * cell  # beyond edges, beside the surface; and over the faces:
    assert error[np.count_nonzero(out > -stock.band_mm, axis=-1) == 1].max() < 1e-5
    assert stock.field.memory_bytes > 0
    assert not (values(stock)[out.max(axis=-1) > 1.1 * stock.band_mm] < stock.band_mm).any()


def test_gradient_below_a_shelf_that_was_cut_off_flush_is_that_of_what_is_left() -> None:
    stock = block(vector(-6.0, -4.0, 0.1), vector(6.0, 4.0, 4.1), CELL)
    stock.cut(vector(4.0, -8.0, 0.1), vector(4.0, 8.0, 0.1), UP, UP, 4.0, 0.0, 30.0)  # leaves x < 0
    z, x = (g.ravel() for g in np.meshgrid(np.linspace(-0.4, 0.4, 9), np.linspace(1.2, 5.0, 20)))
    assert (stock.distance(np.column_stack([x, 0.0 * x, z])) > stock.band_mm - EXACT).all()
    wall = np.array([[away, y, height] for away in (0.1, 0.3, 0.5) for y in (-2.0, 0.0, 2.0) for height in (1.2, 2.0, 3.0)])
    assert np.abs(stock.field.gradient(wall) - vector(1.0, 0.0, 0.0)).max() < 0.02
    assert np.abs(stock.distance(wall) - wall[:, 0]).max() < EXACT


@pytest.mark.parametrize("axis", [UP, leaning(8.0)], ids=["upright", "leaning"])
def test_wall_milled_five_times_costs_no_more_each_time_and_nothing_is_left_to_do(axis: NDArray[np.float64]) -> None:
    stock = block(vector(-6.0, -6.0, -1.0), vector(6.0, 6.0, 3.0), CELL)
    around = np.linspace(0.0, 2.0 * np.pi, 73)
    ring = np.column_stack([8.0 * np.cos(around), 8.0 * np.sin(around), np.full_like(around, -1.5)])
    axes = np.tile(axis, (72, 1))
    path = np.hstack([ring[:-1], ring[1:], axes, axes])
    looked = [float(stock.cut_pieces(path, 3.0, 0.0, 30.0)[:, LOOKED].sum()) for _ in range(5)]
    assert all(later <= earlier for earlier, later in itertools.pairwise(looked))
    assert looked[4] < 0.7 * looked[0]
    assert stock.cut_pieces(path, 3.0, 0.0, 30.0)[:, REMOVED].sum() == pytest.approx(0.0, abs=1e-6)
