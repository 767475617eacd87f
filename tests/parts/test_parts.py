"""The parts that are made here: closed, of the volume that they must have, the same every time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from planner.mesh import load
from planner.recipe import load_recipe
from tests.parts import PARTS
from tests.parts.__main__ import main

WITH_VOLUME = [name for name, sample in PARTS.items() if sample.volume_mm3 is not None]
PLATE_MM = 120.0


@pytest.mark.parametrize("name", PARTS)
def test_part_is_closed_stands_on_the_plate_and_fits_it(name: str) -> None:
    mesh = PARTS[name].mesh(32)
    low, high = mesh.bounds
    assert mesh.is_closed
    assert low[2] == 0.0
    assert float((high - low).max()) <= 0.5 * PLATE_MM


@pytest.mark.parametrize("name", WITH_VOLUME)
def test_volume_tends_to_the_smooth_part_with_the_square_of_the_segments(name: str) -> None:
    exact = PARTS[name].volume_mm3
    assert exact is not None
    off = [abs(PARTS[name].mesh(segments).volume / exact - 1.0) for segments in (32, 64, 128)]
    assert off[2] < 1.1e-3
    assert off[2] < 1e-9 or np.allclose([off[0] / off[1], off[1] / off[2]], 4.0, rtol=0.15)


def test_facets_grow_with_the_square_of_the_segments() -> None:
    counts = [len(PARTS["bent_pipe"].mesh(segments).facets) for segments in (32, 64, 128)]
    assert np.allclose(np.diff(np.log2(counts)), 2.0, atol=0.05)


def test_parts_and_recipes_are_written_and_read_back_the_same(tmp_path: Path) -> None:
    assert main([str(tmp_path), "48", "tee", "dome"]) == 0
    for name in ("tee", "dome"):
        written, made = load(tmp_path / f"{name}.stl", "mm"), PARTS[name].mesh(48)
        assert written.is_closed
        assert written.volume == pytest.approx(made.volume, rel=1e-6)
        assert load_recipe(tmp_path / f"{name}.toml") == PARTS[name].recipe


def test_unknown_part_is_refused_with_the_names_of_all(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["nowhere", "teapot"]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1 and "teapot" in said[0] and "bladed_hub" in said[0]
