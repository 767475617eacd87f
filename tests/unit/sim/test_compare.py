"""As-built against the part, where the deviation is known: a tube built too thick, a block with a slot too much."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from sim import as_built
from sim.compare import compare, difference, measure, paths_along
from sim.deviation import BINS, REACH_TOLERANCES, histogram
from sim.process.stock import Stock
from sim.process.target import Target
from tests.unit.sim.metal_bench import MATERIAL, UP, vector

Array = NDArray[np.float64]
CELL = 0.25


def target_of(mesh: trimesh.Trimesh) -> Target:
    mesh.apply_translation([0.0, 0.0, -mesh.bounds[0, 2]])
    return Target(np.asarray(mesh.vertices), np.asarray(mesh.faces), 0.25)


def stock_of(target: Target, box: tuple[list[float], list[float]]) -> Stock:
    low, high = target.bounds
    stock = Stock(np.array([low - 2.0, high + 2.0]), CELL, MATERIAL, np.array([[-50.0, -50.0, -10.0], [50.0, 50.0, 0.0]]))
    stock.fill_box(np.array(box))
    return stock


def test_stock_that_is_the_part_deviates_by_nothing() -> None:
    target = target_of(trimesh.creation.box((10.0, 8.0, 3.0)))
    deviation = compare(stock_of(target, ([-5.0, -4.0, -1.0], [5.0, 4.0, 3.0])), target)
    assert deviation.p50_mm < 1e-6
    assert deviation.p99_mm < 0.3 * CELL  # at sharp edges a grid rounds
    assert deviation.missing_mm3 + deviation.excess_mm3 < 0.004 * deviation.part_mm3


def thick_tube(points: Array) -> Array:
    """Signed distance to a tube from 4 to 7.1 mm, 4 mm high."""
    r, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    return np.maximum(np.maximum(4.0 - r, r - 7.1), np.maximum(z - 4.0, -1.0 - z))


def test_tube_that_is_too_thick_stands_out_by_its_excess() -> None:
    target = target_of(trimesh.creation.annulus(4.0, 7.0, 4.0, sections=256))
    stock = stock_of(target, ([-6.0, -6.0, -1.0], [-5.9, -5.9, 0.0]))
    stock.unite(thick_tube)
    deviation = compare(stock, target)
    assert deviation.p95_mm == pytest.approx(0.1, abs=0.02)
    assert deviation.max_excess_mm == pytest.approx(0.1, abs=0.05)
    assert deviation.excess_mm3 == pytest.approx(np.pi * (7.1**2 - 7.0**2) * 4.0, rel=0.08)
    assert deviation.missing_mm3 < 0.002 * deviation.part_mm3


def test_slot_that_should_not_be_there_is_missing_metal() -> None:
    target = target_of(trimesh.creation.box((12.0, 8.0, 4.0)))
    stock = stock_of(target, ([-6.0, -4.0, -1.0], [6.0, 4.0, 4.0]))
    stock.cut(vector(-9.0, 0.0, 3.6), vector(9.0, 0.0, 3.6), UP, UP, 1.5, 0.0, 30.0)
    deviation = compare(stock, target)
    assert deviation.missing_mm3 == pytest.approx(12.0 * 3.0 * 0.4, rel=0.05)
    assert deviation.max_missing_mm == pytest.approx(0.4, abs=0.05)
    assert deviation.max_excess_mm < 0.05


def test_metal_missing_far_beyond_the_band_is_measured_to_what_stands() -> None:
    target = target_of(trimesh.creation.box((10.0, 8.0, 6.0)))
    deviation = compare(stock_of(target, ([-5.0, -4.0, -1.0], [5.0, 4.0, 2.5])), target)
    assert deviation.max_missing_mm == pytest.approx(3.5, abs=0.1 * CELL)
    assert deviation.missing_mm3 == pytest.approx(280.0, rel=0.01)


def test_metal_that_buries_the_part_is_excess_as_deep_as_it_is() -> None:
    target = target_of(trimesh.creation.box((6.0, 6.0, 3.0)))
    low, high = np.array([-5.0, -5.0, -1.0]), np.array([5.0, 5.0, 4.6])
    deviation = compare(stock_of(target, (low.tolist(), high.tolist())), target)
    assert deviation.p50_mm == pytest.approx(2.0, abs=0.45)  # sides stand out by 2 mm, the top by 1.6
    assert deviation.max_excess_mm == pytest.approx(np.linalg.norm([2.0, 2.0, 1.6]), abs=1.5 * CELL)  # as built: the corner


def test_blob_that_stands_away_from_the_part_counts_as_excess() -> None:
    target = target_of(trimesh.creation.box((10.0, 8.0, 3.0)))
    stock = stock_of(target, ([-5.0, -4.0, -1.0], [5.0, 4.0, 3.0]))
    assert compare(stock, target).max_excess_mm < 0.1
    stock.fill_box(np.array([[6.0, -0.5, -1.0], [6.8, 0.5, 1.5]]))
    measured = measure(stock, target)
    assert measured.whole.max_excess_mm == pytest.approx(1.8, abs=0.15)
    assert measured.whole.excess_mm3 == pytest.approx(0.8 * 1.0 * 1.5, rel=0.2)


def paths_of(layers: int, height_mm: float, half: float = 5.0) -> tuple[Array, NDArray[np.int64]]:
    """A hatch of straight tracks over a square in each layer, at the layer's top."""
    y = np.arange(-half, half + 0.1, 1.0)
    rows = [(n, (n + 1) * height_mm, v) for n in range(layers) for v in y]
    starts = np.array([[-half, v, z] for _, z, v in rows])
    return paths_along(starts, starts + vector(2.0 * half, 0.0, 0.0), np.array([n for n, _, _ in rows]))


def test_layers_share_out_samples_and_volumes_and_the_missing_one_is_named() -> None:
    target = target_of(trimesh.creation.box((10.0, 10.0, 4.0)))
    stock = stock_of(target, ([-5.0, -5.0, -1.0], [5.0, 5.0, 3.0]))
    measured = measure(stock, target, paths_of(4, 1.0))
    assert [layer.layer for layer in measured.layers] == [0, 1, 2, 3]
    assert sum(layer.samples for layer in measured.layers) == measured.whole.samples
    assert sum(layer.missing_mm3 for layer in measured.layers) == pytest.approx(measured.whole.missing_mm3)
    assert sum(layer.excess_mm3 for layer in measured.layers) == pytest.approx(measured.whole.excess_mm3)
    assert measured.layers[3].missing_mm3 == pytest.approx(50.0, rel=0.1)  # what lies nearer to its path than to that of layer 2
    assert measured.layers[2].missing_mm3 == pytest.approx(50.0, rel=0.1)
    assert measured.layers[3].max_missing_mm == pytest.approx(1.0, abs=0.05)
    assert measured.layers[0].p99_mm < 0.1


def test_only_what_a_cutter_left_counts_as_milled() -> None:
    target = target_of(trimesh.creation.box((12.0, 8.0, 4.0)))
    stock = stock_of(target, ([-6.0, -4.0, -1.0], [6.0, 4.0, 4.5]))
    assert measure(stock, target).milled is None
    stock.cut(vector(-9.0, 0.0, 4.2), vector(9.0, 0.0, 4.2), UP, UP, 3.0, 0.0, 30.0, 7)
    milled = measure(stock, target).milled
    assert milled is not None
    assert milled.p50_mm == pytest.approx(0.2, abs=0.01)
    assert milled.samples / 16.0 == pytest.approx(12.0 * 6.5, abs=6.0)  # 16 samples to the square millimetre; the walls' feet too
    assert milled.excess_mm3 == pytest.approx(12.0 * 6.0 * 0.2, rel=0.15)


def test_histogram_counts_every_sample_once_and_the_tails_at_its_ends() -> None:
    values = np.array([-9.0, -0.41, -0.39, 0.0, 0.0, 0.39, 0.41, 9.0])
    made = histogram(values, 0.1)
    assert len(made.counts) == BINS and len(made.edges_mm) == BINS + 1
    assert made.edges_mm[0] == pytest.approx(-0.1 * REACH_TOLERANCES) and made.edges_mm[-1] == pytest.approx(0.1 * REACH_TOLERANCES)
    assert 4.0 < REACH_TOLERANCES < 4.1 and {-0.1, 0.1} <= set(made.edges_mm)  # what lies beyond the tolerance can be counted
    assert (made.counts[0], made.counts[BINS // 2], made.counts[-1], sum(made.counts)) == (2, 2, 2, len(values))
    target = target_of(trimesh.creation.box((10.0, 8.0, 3.0)))
    measured = measure(stock_of(target, ([-5.0, -4.0, -1.0], [5.0, 4.0, 3.0])), target, tolerance_mm=0.1)
    assert sum(measured.histogram.counts) == measured.whole.samples
    assert measured.histogram.counts[BINS // 2] > 0.9 * measured.whole.samples


def test_two_stocks_differ_by_their_surfaces_and_volumes() -> None:
    target = target_of(trimesh.creation.box((10.0, 8.0, 3.0)))
    one = stock_of(target, ([-5.0, -4.0, -1.0], [5.0, 4.0, 3.0]))
    assert difference(one, stock_of(target, ([-5.0, -4.0, -1.0], [5.0, 4.0, 3.0]))) == pytest.approx((0.0, 0.0), abs=0.002 * CELL)
    higher = stock_of(target, ([-5.0, -4.0, -1.0], [5.0, 4.0, 3.1]))
    found = difference(one, higher)
    assert found.max_mm == pytest.approx(0.1, abs=0.5 * CELL)  # corners of a box are cut off within a cell, not alike on both
    assert found.volume_mm3 == pytest.approx(8.0, rel=0.08)  # the rim of a box is rounded by half a cell
    bare = stock_of(target, ([0.0, 0.0, -1.0], [0.1, 0.1, 0.0]))
    assert difference(one, bare).max_mm == difference(bare, one).max_mm == pytest.approx(3.0, abs=0.05)


def test_stocks_on_different_grids_are_refused() -> None:
    one = target_of(trimesh.creation.box((10.0, 8.0, 3.0)))
    other = target_of(trimesh.creation.box((12.0, 8.0, 3.0)))
    box = ([-5.0, -4.0, -1.0], [5.0, 4.0, 3.0])
    with pytest.raises(ValueError, match="different grids"):
        difference(stock_of(one, box), stock_of(other, box))


def test_as_built_is_written_as_surface_figures_and_picture(tmp_path: Path) -> None:
    target = target_of(trimesh.creation.box((6.0, 5.0, 2.0)))
    stock = stock_of(target, ([-3.0, -2.5, -1.0], [3.0, 2.5, 2.0]))
    figures = as_built.write(stock, target, 0.2, tmp_path / "out", "block")
    assert figures["passed"] is True
    assert json.loads((tmp_path / "out" / "as_built.json").read_text()) == figures
    assert not (tmp_path / "out" / "as_built.npz").exists()
    assert trimesh.load_mesh(tmp_path / "out" / "as_built.stl").volume == pytest.approx(60.0, rel=0.05)
    first = (tmp_path / "out" / "as_built.png").read_bytes()
    assert first.startswith(b"\x89PNG")
    as_built.write(stock, target, 0.2, tmp_path / "out", "block")
    assert (tmp_path / "out" / "as_built.png").read_bytes() == first


def test_bare_plate_is_a_part_that_is_missing(tmp_path: Path) -> None:
    target = target_of(trimesh.creation.box((6.0, 5.0, 2.0)))
    figures = as_built.write(stock_of(target, ([0.0, 0.0, -1.0], [0.1, 0.1, 0.0])), target, 0.2, tmp_path, "block")
    assert figures["passed"] is False
    assert figures["missing_mm3"] == pytest.approx(60.0, rel=0.08)
    assert not (tmp_path / "as_built.stl").exists()


def test_field_written_beside_is_the_stock_again(tmp_path: Path) -> None:
    target = target_of(trimesh.creation.box((6.0, 5.0, 2.0)))
    stock = stock_of(target, ([-3.0, -2.5, -1.0], [3.0, 2.5, 2.0]))
    stock.cut(vector(-9.0, 0.0, 1.5), vector(9.0, 0.0, 1.5), UP, UP, 1.0, 0.0, 30.0, 7)
    as_built.write_field(stock.field, tmp_path)
    read = as_built.read_field(tmp_path / "as_built.npz")
    assert difference(stock, read) == pytest.approx((0.0, 0.0), abs=0.002 * CELL)
    points = target.samples
    assert np.array_equal(read.distance(points), stock.distance(points))
    assert np.array_equal(read.marks(points), stock.marks(points))
