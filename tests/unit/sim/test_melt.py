"""The bead against mass conservation and against the laws as the material file states them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from config import load_material
from sim.process.melt import NO_BEAD, bead_section

MATERIALS = ("316L", "inconel718", "ti6al4v")


@pytest.mark.parametrize("name", MATERIALS)
@given(power=st.floats(600.0, 2000.0), powder=st.floats(1.0, 30.0), speed=st.floats(3.0, 30.0))
def test_caught_powder_is_the_metal_of_the_bead(name: str, power: float, powder: float, speed: float) -> None:
    material = load_material(name)
    bead = bead_section(material, power, powder, speed)
    caught_g_per_s = material.bead.catch_efficiency * powder / 60.0
    assert bead.area_mm2 * speed * material.density_g_mm3 == pytest.approx(caught_g_per_s)
    assert 2.0 / 3.0 * bead.width_mm * bead.height_mm == pytest.approx(bead.area_mm2)  # area under a parabola


@pytest.mark.parametrize("name", MATERIALS)
def test_usual_bead_fits_the_layer_that_the_material_file_states(name: str) -> None:
    material = load_material(name)
    window = material.deposition
    bead = bead_section(material, window.laser_w.usual, window.powder_g_min.usual, window.speed_mm_s.usual)
    layer = bead.area_mm2 / (material.bead.step_over * bead.width_mm)
    assert 1.0 < bead.width_mm < 4.0
    assert window.layer_height_mm.min <= layer <= 1.3 * window.layer_height_mm.max


def test_more_power_widens_and_more_speed_narrows_the_bead() -> None:
    material = load_material("316L")
    usual = bead_section(material, 1200.0, 12.0, 12.0)
    assert bead_section(material, 1500.0, 12.0, 12.0).width_mm > usual.width_mm > bead_section(material, 1200.0, 12.0, 15.0).width_mm


def test_below_its_least_power_and_at_standstill_nothing_is_laid_down() -> None:
    material = load_material("316L")
    assert bead_section(material, material.bead.min_power_w - 1.0, 12.0, 12.0) == NO_BEAD
    assert bead_section(material, 1200.0, 12.0, 0.0) == NO_BEAD


def test_laser_without_powder_melts_but_adds_nothing() -> None:
    bead = bead_section(load_material("316L"), 1200.0, 0.0, 12.0)
    assert bead.area_mm2 == bead.height_mm == 0.0
    assert bead.width_mm > 1.0
