"""Bead of a single track from power, speed and powder rate: a parabola whose area follows from mass conservation.

The laws are written out in `config/material.py`, their figures and sources stand in the material file.
"""

from __future__ import annotations

from dataclasses import dataclass

from config import Material


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
