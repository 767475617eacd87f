"""Cuts against planes, slots, cylinders and swept cutters that are known exactly."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from sim.process.sweep import cutter_distance
from tests.unit.sim.metal_bench import UP, block, plate, track, vector

CELL = 0.25
LOW, HIGH = vector(-8.0, -6.0, -4.0), vector(8.0, 6.0, 2.0)


def test_faced_plane_lies_where_the_cutter_ran() -> None:
    stock = block(LOW, HIGH, CELL)
    for y in (-6.0, -2.0, 2.0, 6.0):
        stock.cut(vector(-14.0, y, 0.93), vector(14.0, y, 0.93), UP, UP, 4.0, 0.0, 40.0)
    x, y = (g.ravel() for g in np.meshgrid(np.linspace(-7.0, 7.0, 30), np.linspace(-5.0, 5.0, 30)))
    assert np.abs(stock.distance(np.column_stack([x, y, np.full_like(x, 0.93)]))).max() < 0.1 * CELL
    assert stock.volume_mm3(-6.0) == pytest.approx(16.0 * 12.0 * 4.93, rel=0.005)


def test_slot_has_its_width_depth_and_round_ends() -> None:
    stock = block(LOW, HIGH, CELL)
    before = stock.volume_mm3(-6.0)
    depth = stock.cut(vector(-4.0, 0.3, 0.5), vector(4.0, 0.3, 0.5), UP, UP, 2.0, 0.0, 40.0)
    assert depth == pytest.approx(1.5, abs=CELL) or depth == pytest.approx(stock.band_mm, abs=0.01)
    x = np.linspace(-3.5, 3.5, 40)
    for wall in (0.3 + 2.0, 0.3 - 2.0):
        assert np.abs(stock.distance(np.column_stack([x, np.full_like(x, wall), np.full_like(x, 1.3)]))).max() < 0.1 * CELL
    angle = np.linspace(-0.4 * np.pi, 0.4 * np.pi, 30)
    end = np.column_stack([4.0 + 2.0 * np.cos(angle), 0.3 + 2.0 * np.sin(angle), np.full_like(angle, 1.3)])
    assert np.abs(stock.distance(end)).max() < 0.15 * CELL
    removed = 1.5 * (8.0 * 4.0 + np.pi * 4.0)
    assert before - stock.volume_mm3(-6.0) == pytest.approx(removed, rel=0.01)


def test_cylinder_milled_from_a_block_is_round() -> None:
    stock = block(vector(-6.0, -6.0, -1.0), vector(6.0, 6.0, 3.0), CELL)
    angle = np.linspace(0.0, 2.0 * np.pi, 241)
    for offset in (6.0, 4.0):
        ring = np.column_stack([(3.7 + offset) * np.cos(angle), (3.7 + offset) * np.sin(angle), np.full_like(angle, -2.0)])
        for a, b in itertools.pairwise(ring):
            stock.cut(a, b, UP, UP, 4.0, 0.0, 40.0)
    probe = np.array([[3.7 * np.cos(a), 3.7 * np.sin(a), z] for a in np.linspace(0.0, 6.2, 70) for z in (0.0, 1.0, 2.0)])
    assert np.abs(stock.distance(probe)).max() < 0.2 * CELL
    assert stock.volume_mm3(-3.0) == pytest.approx(np.pi * 3.7**2 * 4.0, rel=0.01)


@pytest.mark.parametrize("corner", [0.0, 0.5, 2.0])
@pytest.mark.parametrize(
    ("start", "end"), [((-3.0, 0.0, 1.0), (3.0, 1.0, -1.0)), ((-2.0, 0.0, -0.5), (2.0, 0.0, 1.5)), ((0.0, 0.0, 2.5), (0.0, 0.0, -1.0))]
)
def test_oblique_plunges_and_ramps_sweep_what_many_small_steps_sweep(
    corner: float, start: tuple[float, float, float], end: tuple[float, float, float]
) -> None:
    stock = block(LOW, HIGH, CELL)
    stock.cut(vector(*start), vector(*end), UP, UP, 2.0, corner, 40.0)
    x, y, z = stock.points()
    expected = block(LOW, HIGH, CELL).field.astype(np.float64)
    for share in np.linspace(0.0, 1.0, 400):
        tip = vector(*start) + share * (vector(*end) - vector(*start))
        radial = np.hypot(x[:, None] - tip[0], y[None, :] - tip[1])
        r = radial[:, :, None] - (2.0 - corner)
        h = corner - (z - tip[2])[None, None, :]
        cutter = np.hypot(np.maximum(r, 0.0), np.maximum(h, 0.0)) + np.minimum(np.maximum(r, h), 0.0) - corner
        expected = np.maximum(expected, -cutter)
    expected = np.clip(expected, -stock.band_mm, stock.band_mm)
    assert np.abs(stock.field - expected).max() < 0.02


def test_cutter_with_a_turning_axis_leaves_the_ruled_wall() -> None:
    """Side milling from upright to 12 degrees along x: the wall at x is the cutter's flank there."""
    stock = block(LOW, HIGH, CELL)
    radius, pieces = 2.0, 60
    angle = np.radians(np.linspace(0.0, 12.0, pieces + 1))
    x = np.linspace(-12.0, 12.0, pieces + 1)
    axis = np.column_stack([0.0 * x, np.sin(angle), np.cos(angle)])
    tip = np.column_stack([x, np.full_like(x, 5.0), np.full_like(x, -2.0)])
    for i in range(pieces):
        stock.cut(tip[i], tip[i + 1], axis[i], axis[i + 1], radius, 0.0, 40.0)
    for at in (-6.0, 0.0, 6.0):
        a = np.radians(12.0 * (at + 12.0) / 24.0)
        flank = [at, 5.0, -2.0] + 2.0 * vector(0.0, np.sin(a), np.cos(a)) - radius * vector(0.0, np.cos(a), -np.sin(a))
        assert abs(stock.distance(flank[None, :])[0]) < 0.2 * CELL


def test_cutter_distance_is_a_distance() -> None:
    assert cutter_distance(5.0, 3.0, 4.0, 0.0) == pytest.approx(1.0)
    assert cutter_distance(7.0, -4.0, 4.0, 0.0) == pytest.approx(5.0)
    assert cutter_distance(0.0, -1.0, 4.0, 4.0) == pytest.approx(1.0)
    assert cutter_distance(0.0, 4.0, 4.0, 4.0) == pytest.approx(-4.0)
    assert cutter_distance(4.0, 0.0, 4.0, 1.0) == pytest.approx(np.sqrt(2.0) - 1.0)


def test_cutting_air_meets_no_metal() -> None:
    stock = block(LOW, HIGH, CELL)
    assert stock.cut(vector(-8.0, 0.0, 2.3), vector(8.0, 0.0, 2.3), UP, UP, 4.0, 0.0, 40.0) == 0.0


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
