"""Bead of a single track: what the twin lays down (`bead_at`), and the nominal law that planning starts from (`bead_section`).

The twin's bead: width and melted depth of the pool under a moving Gaussian source (`moving_source`, Eagar & Tsai 1983), the powder
that falls into it (`jet`, Lin 1999), its cross-section from conservation of mass, as a parabola of the pool's width.
Latent heat counts as heat capacity between base temperature and liquidus; the spot grows off focus and by the tilt (equal area).
Metal that would stand steeper than a half circle on the pool's width wets beyond it (contact angle 90 degrees: choice).
The nominal law is written out in `config/material.py`; figures and sources of both stand in the material file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from numba import njit

from config import Material
from config.cell import Tool
from sim.process.jet import jet_radius_mm, share_in_pool
from sim.process.moving_source import SourceTable, melted, source_table

STEEPEST = math.pi / 8.0  # area / width^2 of a half circle
SIGMAS_IN_SPOT = 4.0  # the spot's diameter, to 1/e2 of the peak, is four standard deviations


@dataclass(frozen=True)
class BeadSection:
    """Cross-section of a single track on a flat surface, mm and mm2. All zero: nothing is molten."""

    width_mm: float
    height_mm: float
    area_mm2: float


NO_BEAD = BeadSection(0.0, 0.0, 0.0)


def bead_section(material: Material, power_w: float, powder_g_min: float, speed_mm_s: float) -> BeadSection:
    """Cross-section that a head moving at `speed_mm_s` leaves behind.

    Below the material's least power nothing melts; without powder the track is melted but no metal is added (area 0, width kept).
    """
    bead = material.bead
    if power_w < bead.min_power_w or speed_mm_s <= 0.0:
        return NO_BEAD
    width = bead.width_coefficient * power_w**bead.width_power_exponent * speed_mm_s**bead.width_speed_exponent
    area = bead.catch_efficiency * powder_g_min / 60.0 / (material.density_g_mm3 * speed_mm_s)
    return BeadSection(width, 1.5 * area / width, area)


class MeltLaw(NamedTuple):
    """Constants of one material under one head, for `bead_at`; lengths mm, heat J, mass g, temperature K."""

    table: SourceTable
    spot_mm: float  # radius to 1/e2
    beam_tan: float
    absorptivity: float
    melting_k: float
    conductivity: float  # W/(mm K)
    hot_density: float  # g/mm3
    specific_heat: float  # J/(g K)
    latent_heat: float  # J/g
    density: float  # g/mm3, of the cold bead
    jet_mm: float  # radius to 1/e2 at the focus
    jet_tan: float
    sticking: float
    powder_cooling: float


def melt_law(material: Material, tool: Tool) -> MeltLaw:
    """The law for one material and one deposition head (its spot is the tool's diameter)."""
    metal, head = material.thermal, material.head
    return MeltLaw(
        source_table(),
        0.5 * tool.diameter_mm,
        math.tan(math.radians(head.beam_half_angle_deg)),
        head.absorptivity,
        metal.liquidus_k,
        metal.conductivity_w_mm_k,
        metal.hot_density_g_mm3,
        metal.specific_heat_j_g_k,
        metal.latent_heat_j_g,
        material.density_g_mm3,
        0.5 * head.jet_diameter_mm,
        math.tan(math.radians(head.jet_half_angle_deg)),
        head.sticking,
        head.powder_cooling,
    )


@njit(cache=True)
def pool_at(
    law: MeltLaw, power_w: float, speed_mm_s: float, defocus_mm: float, incidence_cos: float, base_k: float
) -> tuple[float, float]:
    """Width and depth of the pool without powder, mm; (0, 0) if nothing melts or the surface is seen from behind."""
    to_melt = law.melting_k - base_k
    if power_w <= 0.0 or speed_mm_s <= 0.0 or incidence_cos <= 0.0 or to_melt <= 0.0:
        return 0.0, 0.0
    radius = math.sqrt(law.spot_mm * law.spot_mm + (law.beam_tan * defocus_mm) ** 2)
    sigma = 2.0 * radius / SIGMAS_IN_SPOT / math.sqrt(min(incidence_cos, 1.0))
    heat = law.specific_heat + law.latent_heat / to_melt
    diffusivity = law.conductivity / (law.hot_density * heat)
    strength = law.absorptivity * power_w / (law.conductivity * sigma * to_melt)
    half, depth = melted(law.table, strength, 0.5 * speed_mm_s * sigma / diffusivity)
    return 2.0 * sigma * half, sigma * depth


@njit(cache=True)
def catch_at(law: MeltLaw, pool_width_mm: float, defocus_mm: float, incidence_cos: float) -> float:
    """Share of the powder that becomes bead."""
    return law.sticking * share_in_pool(
        pool_width_mm, jet_radius_mm(law.jet_mm, law.jet_tan, defocus_mm), incidence_cos
    )


@njit(cache=True)
def bead_at(
    law: MeltLaw,
    power_w: float,
    powder_g_min: float,
    speed_mm_s: float,
    defocus_mm: float,
    incidence_cos: float,
    base_k: float,
) -> tuple[float, float, float, float]:
    """Width mm, height mm and area mm2 of the bead, and the depth mm to which what lies below is molten; zeros: nothing melts.

    defocus_mm : height of the focus above the surface along the tool axis   incidence_cos : tool axis . surface normal
    base_k : temperature of what the bead is laid on. Without powder: width and depth of the melted track, height and area 0.
    """
    width, depth = pool_at(law, power_w, speed_mm_s, defocus_mm, incidence_cos, base_k)
    if width <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    area = catch_at(law, width, defocus_mm, incidence_cos) * powder_g_min / (60.0 * law.density * speed_mm_s)
    width = max(width, math.sqrt(area / STEEPEST))
    height = 1.5 * area / width
    return width, height, area, max(depth - law.powder_cooling * height, 0.0)
