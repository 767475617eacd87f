"""Beads against the volume that they bring and the shapes that they settle in."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from sim.process.deposit import deposit
from sim.process.sag import ADHESION_WIDTHS
from tests.unit.sim.metal_bench import BEAD, LAW, MATERIAL, UP, block, height, plate, track, vector

STEP = MATERIAL.bead.step_over * BEAD.width_mm
LAYER = BEAD.area_mm2 / STEP


@pytest.mark.parametrize("cell_mm", [0.1, 0.2, 0.3])
def test_straight_bead_keeps_its_volume(cell_mm: float) -> None:
    stock = plate(16.0, cell_mm)
    stock.cut(vector(-20.0, 0.0, -1.0), vector(20.0, 0.0, -1.0), UP, UP, 9.0, 0.0, 100.0)  # away from the plane of volume_mm3
    held = track(stock, vector(-5.0, 0.0, -1.0), vector(5.0, 0.0, -1.0))
    before = plate(16.0, cell_mm)
    before.cut(vector(-20.0, 0.0, -1.0), vector(20.0, 0.0, -1.0), UP, UP, 9.0, 0.0, 100.0)
    assert held == pytest.approx(10.0 * BEAD.area_mm2, rel=1e-4)  # the part warms up a little
    assert stock.volume_mm3(-1.2) - before.volume_mm3(-1.2) == pytest.approx(held, rel=1e-4)


def test_bead_on_a_flat_plate_is_the_parabola_of_the_melt_law() -> None:
    stock = plate(18.0, 0.1, 2.0)
    track(stock, vector(-6.0, 0.0, 0.0), vector(6.0, 0.0, 0.0))
    for y in (0.0, 0.4, -0.8, 1.0):
        expected = BEAD.height_mm * (1.0 - (2.0 * y / BEAD.width_mm) ** 2)
        assert height(stock, 0.0, y, 1.9) == pytest.approx(expected, abs=0.05)
    assert height(stock, 0.0, 0.5 * BEAD.width_mm + 0.1, 1.9) == pytest.approx(0.0, abs=0.02)


def test_bead_along_a_circle_keeps_its_volume_and_height() -> None:
    stock = plate(20.0, 0.2, 2.0)
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    ring = np.column_stack([6.0 * np.cos(angle), 6.0 * np.sin(angle), 0.0 * angle])
    held = sum(track(stock, a, b) for a, b in itertools.pairwise(ring))
    length = np.linalg.norm(np.diff(ring, axis=0), axis=1).sum()
    assert held == pytest.approx(length * BEAD.area_mm2, rel=1e-3)
    assert stock.volume_mm3(-1.0) - plate(20.0, 0.2, 2.0).volume_mm3(-1.0) == pytest.approx(held, rel=1e-4)
    for a in np.radians([45.0, 100.0, 200.0, 290.0]):
        assert height(stock, 6.0 * np.cos(a), 6.0 * np.sin(a), 1.9) == pytest.approx(BEAD.height_mm, abs=0.06)


def test_overlapping_beads_fill_a_layer_of_their_mean_height() -> None:
    stock = plate(24.0, 0.2, 3.0)
    for i in range(8):
        track(stock, vector(-8.0, (i - 3.5) * STEP, 0.0), vector(8.0, (i - 3.5) * STEP, 0.0))
    y = np.arange(-2.0 * STEP, 2.0 * STEP, 0.1)
    profile = np.array([height(stock, 0.3, float(v), 2.9) for v in y])
    assert profile.mean() == pytest.approx(LAYER, rel=0.03)
    assert np.ptp(profile) < 0.45 * BEAD.height_mm


def test_second_layer_stands_on_the_first_and_adds_as_much() -> None:
    stock = plate(18.0, 0.2, 3.0)
    track(stock, vector(-6.0, 0.0, 0.0), vector(6.0, 0.0, 0.0))
    first = stock.volume_mm3(-1.0)
    held = track(stock, vector(-6.0, 0.0, BEAD.height_mm), vector(6.0, 0.0, BEAD.height_mm))
    assert stock.volume_mm3(-1.0) - first == pytest.approx(held, rel=0.02)
    assert height(stock, 0.0, 0.0, 2.9) > 1.6 * BEAD.height_mm


@pytest.mark.parametrize("angle_deg", [20.0, 60.0, 90.0, 180.0])
def test_bead_under_a_tilted_axis_grows_along_the_axis(angle_deg: float) -> None:
    """A block is built upon from a tilted side: the same bead, turned."""
    a = np.radians(angle_deg)
    axis = vector(0.0, -np.sin(a), np.cos(a))
    along = vector(1.0, 0.0, 0.0)
    stock = block(vector(-8.0, -4.0, -4.0), vector(8.0, 4.0, 4.0), 0.2)
    stock.cut(8.0 * along + 3.0 * axis, -8.0 * along + 3.0 * axis, axis, axis, 9.0, 0.0, 20.0)
    before = stock.volume_mm3(-6.0)
    held = track(stock, 3.0 * axis - 4.0 * along, 3.0 * axis + 4.0 * along, axis)
    assert held == pytest.approx(8.0 * BEAD.area_mm2, rel=1e-4)
    assert stock.volume_mm3(-6.0) - before == pytest.approx(held, rel=0.05)
    crest = np.array([stock.distance((3.0 + h) * axis[None, :])[0] for h in (BEAD.height_mm - 0.1, BEAD.height_mm + 0.1)])
    assert crest[0] < 0.0 < crest[1]


def test_bead_over_nothing_is_lost() -> None:
    stock = block(vector(-4.0, -4.0, -2.0), vector(4.0, 4.0, 0.0))
    before = stock.snapshot()["value"].copy()
    assert track(stock, vector(-3.0, 6.5, 2.5), vector(3.0, 6.5, 2.5)) == 0.0
    assert np.array_equal(stock.snapshot()["value"], before)


def test_bead_over_an_edge_hangs_out_no_further_than_its_adhesion() -> None:
    stock = block(vector(-6.0, -4.0, -4.0), vector(6.0, 0.0, 0.0), 0.1)
    held = track(stock, vector(-4.0, 0.0, 0.0), vector(4.0, 0.0, 0.0))
    assert held < 8.0 * BEAD.area_mm2
    y = np.arange(0.0, 2.0, 0.02)
    overhang = np.array([(stock.distance(np.column_stack([0.0 * y, y, np.full_like(y, z)])) < 0.0) for z in (0.2, 0.4)])
    reach = y[overhang.any(axis=0)].max(initial=0.0)
    assert reach <= ADHESION_WIDTHS * BEAD.width_mm + stock.cell_mm


def test_later_layers_do_not_refill_what_was_milled_off_a_wall() -> None:
    stock = plate(20.0, 0.2, 4.0)
    for layer in range(2):
        for i in range(4):
            y = (i - 1.5) * STEP
            track(stock, vector(-6.0, y, layer * LAYER), vector(6.0, y, layer * LAYER))
    wall = 1.5 * STEP
    stock.cut(vector(-12.0, wall + 4.0, 0.1), vector(12.0, wall + 4.0, 0.1), UP, UP, 4.0, 0.0, 50.0)
    probe = np.array([[x, wall + off, z] for x in (-3.0, 0.0, 3.0) for off in (0.3, 0.6) for z in (0.5, 1.0)])
    assert (stock.distance(probe) > 0.0).all()
    track(stock, vector(-6.0, 0.6 * wall, 2.0 * LAYER), vector(6.0, 0.6 * wall, 2.0 * LAYER))
    assert (stock.distance(probe) > 0.0).all()


def test_powder_without_light_leaves_the_metal_as_it_is() -> None:
    stock = plate(12.0)
    before = stock.snapshot()
    deposit(stock, LAW, vector(-3.0, 0.0, 0.0), vector(3.0, 0.0, 0.0), UP, 0.0, 12.0, 0.5)
    deposit(stock, LAW, vector(-3.0, 0.0, 0.0), vector(3.0, 0.0, 0.0), UP, 0.9 * MATERIAL.bead.min_power_w, 12.0, 0.5)
    after = stock.snapshot()
    assert all(np.array_equal(before[key], after[key]) for key in before)


def test_light_without_powder_melts_the_surface_without_moving_it_and_marks_it() -> None:
    stock = plate(12.0)
    before = stock.snapshot()["value"].copy()
    track(stock, vector(-3.0, 0.0, 0.0), vector(3.0, 0.0, 0.0), powder_g_min=0.0)
    assert np.array_equal(stock.snapshot()["value"], before)
    assert stock.marks(vector(0.0, 0.0, 0.0)[None, :])[0] == 1
    assert stock.marks(vector(0.0, 4.0, 0.0)[None, :])[0] == 0


def test_corner_is_symmetric_about_its_bisector_and_keeps_its_volume() -> None:
    stock = plate(20.0, 0.2, 2.0)
    before = stock.volume_mm3(-1.0)
    held = track(stock, vector(-6.0, 0.0, 0.0), vector(0.0, 0.0, 0.0)) + track(stock, vector(0.0, 0.0, 0.0), vector(0.0, 6.0, 0.0))
    assert stock.volume_mm3(-1.0) - before == pytest.approx(held, rel=1e-3)
    for near, far in (((-3.0, 0.6), (-0.6, 3.0)), ((-4.0, -0.8), (0.8, 4.0))):
        assert height(stock, *near, 1.9) == pytest.approx(height(stock, *far, 1.9), abs=0.1)  # the second leg climbs the first
    crest = max(height(stock, x, -x, 1.9) for x in np.arange(-1.0, 1.0, 0.1))
    assert BEAD.height_mm < crest < 1.6 * BEAD.height_mm


def test_thin_wall_of_stacked_tracks_is_as_high_as_its_volume_says() -> None:
    stock = plate(24.0, 0.25, 9.0)
    rise = 0.9 * BEAD.area_mm2 / BEAD.width_mm  # nearly what a bead adds once the wall is as wide as the bead
    area = 0.0
    for layer in range(8):
        track(stock, vector(-9.0, 0.0, layer * rise), vector(9.0, 0.0, layer * rise))
        area += BEAD.area_mm2
    profile = np.array([height(stock, 0.0, float(y), 8.9) for y in np.arange(-2.0, 2.0, 0.05)])
    assert np.maximum(profile, 0.0).sum() * 0.05 == pytest.approx(area, rel=0.04)
    y = np.arange(-3.0, 3.0, 0.02)
    half_way = np.column_stack([0.0 * y, y, np.full_like(y, 2.5)])
    assert np.ptp(y[stock.distance(half_way) < 0.0]) == pytest.approx(BEAD.width_mm, abs=0.3)


def test_order_of_tracks_matters_as_the_second_lies_on_the_flank_of_the_first() -> None:
    def crests(order: tuple[float, float]) -> tuple[float, float]:
        stock = plate(16.0, 0.2, 2.0)
        for y in order:
            track(stock, vector(-5.0, y, 0.0), vector(5.0, y, 0.0))
        return height(stock, 0.0, -0.5 * STEP, 1.9), height(stock, 0.0, 0.5 * STEP, 1.9)

    left_first, right_first = crests((-0.5 * STEP, 0.5 * STEP)), crests((0.5 * STEP, -0.5 * STEP))
    assert left_first[1] > left_first[0] + 0.05
    assert left_first == pytest.approx(right_first[::-1], abs=0.02)


def test_bead_catches_less_the_farther_the_surface_is_from_the_focus_or_leans_away() -> None:
    def caught(gap_mm: float, lean_deg: float = 0.0) -> float:
        stock = plate(16.0, 0.2, 8.0)
        a = np.radians(lean_deg)
        axis = vector(0.0, np.sin(a), np.cos(a))
        return track(stock, gap_mm * axis - vector(4.0, 0.0, 0.0), gap_mm * axis + vector(4.0, 0.0, 0.0), axis)

    by_gap = [caught(gap) for gap in (0.0, 2.0, 4.0, 7.0)]
    assert all(nearer > farther for nearer, farther in itertools.pairwise(by_gap))
    assert by_gap[0] == pytest.approx(8.0 * BEAD.area_mm2, rel=1e-3)
    by_lean = [caught(0.0, lean) for lean in (0.0, 20.0, 40.0, 50.0)]
    assert all(steeper < flatter for flatter, steeper in itertools.pairwise(by_lean))


def test_bead_on_a_hot_part_is_wider() -> None:
    widths = []
    for base_k in (293.0, 600.0, 900.0):
        stock = plate(16.0, 0.2, 3.0)
        state = np.array([base_k, 0.0])
        deposit(stock, LAW, vector(-5.0, 0.0, 0.0), vector(5.0, 0.0, 0.0), UP, 1200.0, 12.0, 10.0 / 12.0, state=state)
        y = np.arange(-4.0, 4.0, 0.02)
        widths.append(np.ptp(y[stock.distance(np.column_stack([0.0 * y, y, np.full_like(y, 0.15)])) < 0.0]))
    assert widths[0] + 0.1 < widths[1] < widths[2] - 0.1


def test_blocks_buried_in_beads_are_given_back_and_memory_goes_with_the_surface() -> None:
    stock = plate(20.0, 0.2, 8.0)
    for layer in range(8):
        for i in range(7):
            y, z = (i - 3.0) * STEP, layer * LAYER
            track(stock, vector(-5.0, y, z), vector(5.0, y, z))
    volume = stock.volume_mm3(0.3)
    values = stock.field.dense((0, 0, 0), stock.field.shape)
    i, j, k = ((np.array(box) - at) / 0.2 for box, at in zip([(-4.0, 4.0), (-4.5, 4.5), (1.0, 4.0)], stock.origin, strict=True))
    buried = values[int(i[0]) : int(i[1]), int(j[0]) : int(j[1]), int(k[0]) : int(k[1])]
    assert np.mean(buried <= -stock.band_mm) > 0.98  # no seam between beads and layers is left
    signs = values < 0.0
    entries = stock.field.occupied()
    by_surface = 0
    for a, b, c in entries * 8:
        near = signs[max(a - 4, 0) : a + 12, max(b - 4, 0) : b + 12, max(c - 4, 0) : c + 12]
        by_surface += bool(near.any() and not near.all())
    assert by_surface > 0.97 * len(entries)
    assert stock.volume_mm3(0.3) == volume
