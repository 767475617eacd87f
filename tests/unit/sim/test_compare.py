"""As-built against the part, where the deviation is known: a tube built too thick, a block with a slot too much."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from sim import as_built
from sim.compare import compare
from sim.process.stock import Stock
from sim.process.surface import built_mesh
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


def test_surface_of_the_stock_is_closed_and_looks_outward() -> None:
    target = target_of(trimesh.creation.box((10.0, 8.0, 3.0)))
    vertices, facets = built_mesh(stock_of(target, ([-5.0, -4.0, -1.0], [5.0, 4.0, 3.0])), 0.0)
    surface = trimesh.Trimesh(vertices, facets, process=False)
    assert surface.is_watertight
    assert surface.volume == pytest.approx(240.0, rel=0.03)


def test_as_built_is_written_as_surface_figures_and_picture(tmp_path: Path) -> None:
    target = target_of(trimesh.creation.box((6.0, 5.0, 2.0)))
    stock = stock_of(target, ([-3.0, -2.5, -1.0], [3.0, 2.5, 2.0]))
    figures = as_built.write(stock, target, 0.2, tmp_path / "out", "block")
    assert figures["passed"] is True
    assert json.loads((tmp_path / "out" / "as_built.json").read_text()) == figures
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
