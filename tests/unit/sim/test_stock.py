"""The stock: clamped solids, gouges of a known depth, marks, memory that goes with the surface, and a state that can be kept."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from sim.process.solid import unite_field
from sim.process.stock import Stock
from sim.process.target import Target
from tests.unit.sim.cutting_bench import leaning, values
from tests.unit.sim.metal_bench import MATERIAL, UP, block, plate, track, vector

CELL = 0.25
EXACT = 0.1 * CELL


def part(mesh: trimesh.Trimesh) -> Target:
    return Target(np.asarray(mesh.vertices), np.asarray(mesh.faces), 0.25)


def guarded() -> Stock:
    """A block of 12 x 10 x 6 round a part of 8 x 6 x 4, both standing on z = 0."""
    stock = block(vector(-6.0, -5.0, 0.0), vector(6.0, 5.0, 6.0), CELL)
    box = trimesh.creation.box((8.0, 6.0, 4.0))
    box.apply_translation([0.0, 0.0, 2.0])
    stock.guard(part(box))
    return stock


@pytest.mark.parametrize("below", [0.0, 0.07, 0.2, 0.5])
def test_gouge_is_as_deep_as_the_cutter_went_below_the_part(below: float) -> None:
    stock = guarded()
    cut = stock.cut(vector(-9.0, 0.0, 4.0 - below), vector(9.0, 0.0, 4.0 - below), UP, UP, 2.0, 0.0, 30.0)
    assert cut.gouge_mm == pytest.approx(below, abs=EXACT)
    if below > 0.0:
        assert abs(cut.at[0]) < 4.0 + CELL
        assert abs(cut.at[1]) < 2.0 + CELL
        assert cut.at[2] == pytest.approx(4.0 - 0.5 * below, abs=stock.band_mm)


def test_gouge_of_a_tilted_ball_into_a_wall_is_told_and_a_deep_one_is_the_band() -> None:
    stock = guarded()
    centre = vector(0.0, 3.0 + 2.0 - 0.15, 3.0)  # of the ball, 0.15 mm into the wall at y = 3
    axis = leaning(30.0, 90.0)
    cut = stock.cut(centre - 2.0 * axis, centre - 2.0 * axis + vector(1.0, 0.0, 0.0), axis, axis, 2.0, 2.0, 30.0)
    assert cut.gouge_mm == pytest.approx(0.15, abs=EXACT)
    assert cut.at[1] == pytest.approx(3.0, abs=stock.band_mm)
    assert stock.cut(vector(0.0, 0.0, 7.0), vector(0.0, 0.0, 1.0), UP, UP, 2.0, 0.0, 30.0).gouge_mm == stock.band_mm


def test_part_milled_to_size_is_not_gouged_and_without_a_target_nothing_is() -> None:
    stock = guarded()
    for y in (-4.0, -1.0, 2.0, 5.0):
        assert stock.cut(vector(-9.0, y, 4.0), vector(9.0, y, 4.0), UP, UP, 2.0, 0.0, 30.0).gouge_mm == 0.0
    for a, b in (((6.0, -7.0), (6.0, 7.0)), ((-6.0, 7.0), (-6.0, -7.0)), ((-8.0, 5.0), (8.0, 5.0)), ((8.0, -5.0), (-8.0, -5.0))):
        assert stock.cut(vector(*a, -1.0), vector(*b, -1.0), UP, UP, 2.0, 0.0, 30.0).gouge_mm == 0.0
    assert stock.volume_mm3(-1.0) == pytest.approx(8.0 * 6.0 * 4.0, rel=0.01)
    bare = block(vector(-3.0, -3.0, 0.0), vector(3.0, 3.0, 3.0), CELL)
    assert bare.cut(vector(-9.0, 0.0, 1.0), vector(9.0, 0.0, 1.0), UP, UP, 2.0, 0.0, 30.0).gouge_mm == 0.0


def test_cutting_where_the_part_is_missing_already_is_no_gouge() -> None:
    stock = guarded()
    stock.cut(vector(-9.0, 0.0, 3.0), vector(9.0, 0.0, 3.0), UP, UP, 2.0, 0.0, 30.0)
    assert stock.cut(vector(-9.0, 0.0, 3.5), vector(9.0, 0.0, 3.5), UP, UP, 1.0, 0.0, 30.0).gouge_mm == 0.0


def test_surfaces_tell_what_made_them() -> None:
    stock = plate(20.0, 0.2, 4.0)
    track(stock, vector(-6.0, 0.0, 0.0), vector(6.0, 0.0, 0.0))
    stock.cut(vector(2.0, -6.0, 0.4), vector(2.0, 6.0, 0.4), UP, UP, 1.5, 0.0, 30.0, 3)
    assert stock.marks(np.array([[-5.0, 5.0, 0.0], [6.0, -6.0, 0.05]])).tolist() == [0, 0]
    assert stock.marks(np.array([[2.0, 0.0, 0.4], [1.8, 0.3, 0.35]])).tolist() == [-3, -3]
    on_bead = np.array([[-3.0, 0.0, stock.band_mm]])
    on_bead[0, 2] = 0.4
    assert (stock.marks(on_bead) >= 0).all()


def test_turned_plate_and_mesh_lie_where_they_are_clamped() -> None:
    stock = Stock(np.array([[-6.0, -6.0, -2.0], [6.0, 6.0, 6.0]]), CELL, MATERIAL)
    c, s = np.cos(0.3), np.sin(0.3)
    frame = np.array([[c, s, 0.0, 0.0], [-s, c, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    stock.fill_box(np.array([[-4.0, -3.0, -9.0], [4.0, 3.0, 0.0]]), frame)
    wall = np.array([[4.0, y, z] for y in (-2.0, 0.0, 2.0) for z in (-1.2, -1.0)]) @ frame[:3, :3]
    assert np.abs(stock.distance(wall)).max() < 1e-5
    ball = part(trimesh.creation.icosphere(5, 3.0))
    unite_field(stock.field, ball.field_on(stock.origin, CELL, stock.band_mm, stock.field.shape))
    top = np.array([[3.0 * np.sin(p) * np.cos(a), 3.0 * np.sin(p) * np.sin(a), 3.0 * np.cos(p)] for p in (0.0, 0.4, 0.8) for a in (0.0, 2.0, 4.0)])
    assert np.abs(stock.distance(top)).max() < EXACT


def test_solid_given_by_its_distance_is_united_wherever_it_is() -> None:
    stock = Stock(np.array([[-6.0, -6.0, -6.0], [6.0, 6.0, 6.0]]), CELL, MATERIAL)
    stock.unite(lambda points: np.linalg.norm(points - vector(1.0, 0.0, 0.5), axis=1) - 4.0)
    assert stock.volume_mm3(-9.0) == pytest.approx(4.0 / 3.0 * np.pi * 64.0, rel=0.002)
    stock.unite(lambda points: np.linalg.norm(points + 4.0, axis=1) - 0.5, np.array([[-4.5] * 3, [-3.5] * 3]))
    assert stock.distance(np.array([[-4.0, -4.0, -3.5], [1.0, 0.0, 4.5]])) == pytest.approx([0.0, 0.0], abs=EXACT)


def test_memory_and_blocks_grow_with_the_surface_not_the_volume() -> None:
    blocks = []
    for size in (12.0, 24.0, 48.0):
        stock = block(np.zeros(3), np.full(3, size), CELL)
        stock.cut(vector(-9.0, 0.5 * size, 0.5 * size), vector(size + 9.0, 0.5 * size, 0.5 * size), UP, UP, 0.2 * size, 0.0, 90.0)
        blocks.append(len(stock.field.occupied()))
    assert np.log2(blocks[1] / blocks[0]) < 2.3
    assert np.log2(blocks[2] / blocks[1]) < 2.2


def test_tenth_of_a_millimetre_on_fifty_stays_far_below_two_gigabytes() -> None:
    """Measured on 16 mm: blocks go with the surface, so 50 mm take (50 / 16)^2 as much."""
    stock = block(np.zeros(3), np.full(3, 16.0), 0.1)
    stock.guard(part(trimesh.creation.box(bounds=[[2.0] * 3, [14.0] * 3])))
    stock.cut(vector(-9.0, 8.0, 10.0), vector(25.0, 8.0, 10.0), UP, UP, 5.0, 0.0, 90.0)
    assert stock.memory_bytes * (50.0 / 16.0) ** 2 < 0.5e9
    assert stock.volume_mm3(-1.0) == pytest.approx(16.0**3 - 16.0 * 10.0 * 6.0, rel=1e-3)


def test_restored_stock_goes_on_as_if_nothing_had_been_in_between() -> None:
    stock = block(vector(-4.0, -4.0, -2.0), vector(4.0, 4.0, 2.0), CELL)
    stock.cut(vector(-9.0, 1.0, 1.0), vector(9.0, 1.0, 1.0), UP, UP, 2.0, 0.0, 30.0, 2)
    state = stock.snapshot()
    last = (vector(0.0, -9.0, 0.0), vector(0.0, 9.0, 0.4), leaning(10.0), leaning(-10.0), 1.0, 1.0, 30.0, 4)
    first = stock.cut(*last)
    after, removed = values(stock), stock.removed_mm3
    stock.cut(vector(-9.0, 0.0, -1.0), vector(9.0, 0.0, -1.0), UP, UP, 3.0, 0.0, 30.0)
    stock.restore(state)
    again = stock.cut(*last)
    assert np.array_equal(values(stock), after)
    assert again[:3] == first[:3]
    assert stock.removed_mm3 == removed
