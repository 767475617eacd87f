"""Powder jet of a coaxial nozzle: a Gaussian beam of grains, and the share of it that falls into the melt pool.

Sources: the jet as a Gaussian with a waist at its focus: J. Lin, Concentration mode of the powder stream in coaxial laser cladding,
Optics & Laser Technology 31 (1999) 251; A. J. Pinkerton, L. Li, Modelling powder concentration distribution from a coaxial
deposition nozzle for laser-based rapid tooling, J. Manuf. Sci. Eng. 126 (2004) 33. Grains that land outside the pool bounce off.
"""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True)
def jet_radius_mm(waist_mm: float, half_angle_tan: float, defocus_mm: float) -> float:
    """Radius to 1/e2 of the peak at a distance from the focus, mm."""
    return math.sqrt(waist_mm * waist_mm + (half_angle_tan * defocus_mm) ** 2)


@njit(cache=True)
def share_in_pool(pool_width_mm: float, radius_mm: float, incidence_cos: float) -> float:
    """Share of the jet that lands in a pool as long as wide, seen along the jet: foreshortened to `incidence_cos` of its area.

    A round Gaussian within a circle of equal area: 1 - exp(-2 (half width)^2 cos / radius^2). 0 for a surface seen from behind.
    """
    if pool_width_mm <= 0.0 or incidence_cos <= 0.0:
        return 0.0
    half = 0.5 * pool_width_mm
    return 1.0 - math.exp(-2.0 * half * half * min(incidence_cos, 1.0) / (radius_mm * radius_mm))
