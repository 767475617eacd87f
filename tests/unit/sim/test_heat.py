"""The lumped part temperature against energy balances and a fine explicit integration."""

from __future__ import annotations

import math

import numpy as np
import pytest

from config import load_material
from sim.process.heat import STEFAN_BOLTZMANN, add_metal, cold_state, heat_law, heat_step

LAW = heat_law(load_material("316L"))


def test_without_losses_all_heat_stays() -> None:
    law = LAW._replace(plate_w_k=1e-9, convection_w_m2_k=0.0, radiation_w_m2_k4=0.0)
    state = np.array([300.0, 50.0])
    heat_step(law, state, 500.0, 100.0)
    assert (state[0] - 300.0) * (law.plate_j_k + 50.0 * law.metal_j_g_k) == pytest.approx(50_000.0, rel=1e-4)


def test_in_the_end_losses_are_what_is_absorbed() -> None:
    state = np.array([LAW.ambient_k, 200.0])
    for _ in range(4000):
        heat_step(LAW, state, 400.0, 10.0)
    rise = state[0] - LAW.ambient_k
    area = LAW.area_m2_g * state[1]
    lost = rise * (LAW.plate_w_k + LAW.convection_w_m2_k * area)
    lost += area * LAW.radiation_w_m2_k4 * (state[0] ** 4 - LAW.ambient_k**4)
    assert lost == pytest.approx(400.0, rel=1e-6)
    assert LAW.radiation_w_m2_k4 == pytest.approx(load_material("316L").part_heat.emissivity * STEFAN_BOLTZMANN)


def test_long_steps_agree_with_short_explicit_ones() -> None:
    coarse, fine = np.array([700.0, 150.0]), 700.0
    area, capacity = LAW.area_m2_g * 150.0, LAW.plate_j_k + 150.0 * LAW.metal_j_g_k
    for _ in range(30):
        heat_step(LAW, coarse, 200.0, 2.0)
    for _ in range(60_000):
        rise = fine - LAW.ambient_k
        loss = rise * (LAW.plate_w_k + LAW.convection_w_m2_k * area) + area * LAW.radiation_w_m2_k4 * (
            fine**4 - LAW.ambient_k**4
        )
        fine += 0.001 * (200.0 - loss) / capacity
    assert coarse[0] == pytest.approx(fine, abs=0.3)


def test_no_step_overshoots_however_long() -> None:
    state = np.array([900.0, 10.0])
    heat_step(LAW, state, 0.0, 1e9)
    assert state[0] == pytest.approx(LAW.ambient_k)


def test_cold_metal_takes_its_share_of_the_heat() -> None:
    state = np.array([600.0, 20.0])
    heat = (LAW.plate_j_k + 20.0 * LAW.metal_j_g_k) * (600.0 - LAW.ambient_k)
    add_metal(LAW, state, 30.0)
    assert state[1] == 50.0
    assert (LAW.plate_j_k + 50.0 * LAW.metal_j_g_k) * (state[0] - LAW.ambient_k) == pytest.approx(heat)


@pytest.mark.parametrize("name", ["316L", "inconel718", "ti6al4v"])
def test_an_hour_of_usual_layers_leaves_the_part_below_500_degrees(name: str) -> None:
    material = load_material(name)
    law, window = heat_law(material), material.deposition
    state = cold_state(law)
    absorbed = material.head.absorptivity * window.laser_w.usual
    caught = material.bead.catch_efficiency * window.powder_g_min.usual / 60.0
    for second in range(3600):  # 12 s of laser in a layer, then what is left of the least time
        lit = second % math.ceil(max(window.interpass_s, 13.0)) < 12
        heat_step(law, state, absorbed if lit else 0.0, 1.0)
        add_metal(law, state, caught if lit else 0.0)
    assert law.ambient_k + 20.0 < state[0] < 773.0
