"""Lumped temperature of part and plate: laser heat in, the table, air and radiation out; what the next bead is laid on.

One temperature for all of it. Heat capacity: the plate's and the deposited metal's. Surface of the part: that of a wall of
WALL_MM, both sides (choice: a compact part has less, and loses little by air anyway). The step is linear-implicit, stable at any length.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from config import Material

STEFAN_BOLTZMANN = 5.670374419e-8  # W/(m2 K4), CODATA 2018
WALL_MM = 6.0  # two or three tracks side by side: what thin parts are built of


class HeatLaw(NamedTuple):
    """Constants of the balance, SI but for mass in g."""

    ambient_k: float
    plate_j_k: float
    plate_w_k: float
    metal_j_g_k: float
    area_m2_g: float
    convection_w_m2_k: float
    radiation_w_m2_k4: float


def heat_law(material: Material) -> HeatLaw:
    """The material's figures in the units of the kernel."""
    facts, metal = material.part_heat, material.thermal
    area_m2_g = 2.0 / (WALL_MM * material.density_g_mm3) * 1e-6
    return HeatLaw(
        facts.ambient_k,
        facts.plate_heat_capacity_j_k,
        facts.plate_conductance_w_k,
        metal.specific_heat_j_g_k,
        area_m2_g,
        facts.convection_w_m2_k,
        facts.emissivity * STEFAN_BOLTZMANN,
    )


def cold_state(law: HeatLaw) -> NDArray[np.float64]:
    """State before the first bead: (2,) float, [temperature K, deposited mass g]."""
    return np.array([law.ambient_k, 0.0])


@njit(cache=True)
def heat_step(law: HeatLaw, state: NDArray[np.float64], absorbed_w: float, dt_s: float) -> None:
    """Carry the state on by dt_s at constant absorbed power.  state : (2,) float, [temperature K, deposited mass g], changed in place."""
    temperature, mass = state[0], state[1]
    area = law.area_m2_g * mass
    rise = temperature - law.ambient_k
    radiated = (
        law.radiation_w_m2_k4
        * (temperature * temperature + law.ambient_k * law.ambient_k)
        * (temperature + law.ambient_k)
    )
    loss_w_k = law.plate_w_k + area * (law.convection_w_m2_k + radiated)
    capacity = law.plate_j_k + mass * law.metal_j_g_k
    goal = absorbed_w / loss_w_k
    state[0] = law.ambient_k + goal + (rise - goal) * math.exp(-dt_s * loss_w_k / capacity)


@njit(cache=True)
def add_metal(law: HeatLaw, state: NDArray[np.float64], mass_g: float) -> None:
    """Mix cold metal in: powder comes at ambient temperature and the laser's heat, counted by `heat_step`, warms it."""
    capacity = law.plate_j_k + state[1] * law.metal_j_g_k
    added = mass_g * law.metal_j_g_k
    state[0] = (capacity * state[0] + added * law.ambient_k) / (capacity + added)
    state[1] += mass_g
