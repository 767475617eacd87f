"""What the pool does where nothing carries it: a rule of three steps, and the run of a pool on a slope.

Surface tension carries liquid metal over lengths below its capillary length sqrt(tension / (density g)) = 5 mm for steel
(de Gennes, Brochard-Wyart, Quere, Capillarity and Wetting Phenomena, 2004, ch. 2; 1.7 N/m and 7.0 g/cm3 of liquid steel: Iida, Guthrie,
The Physical Properties of Liquid Metals, 1988), so gravity hardly bends what hangs at all; what fails first is the wetting of the
edge. Choices, in terms of the length u that a column of the pool hangs out from the nearest one with metal beneath:

- u up to height * tan(max_overhang_deg), the material's overhang that holds without tilting: it stays where it is;
- beyond, it droops away from the head by DROOP_HEIGHTS of the bead's height times the square of the share of the way to the limit,
  and times the component of gravity along the tool axis: with gravity across the axis it does not droop, overhead it bulges up;
- beyond ADHESION_WIDTHS of the bead's width there is nothing to wet: the powder falls past and is lost.

Beneath is along the tool axis, where light and powder come from. Gravity across the axis makes the pool run: its surface tilts by the
Bond number (half width / capillary length)^2 times that component (the linear response of a sessile drop, ibid.).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.process.pool import HANGING, HOLDING

ADHESION_WIDTHS = 0.35
DROOP_HEIGHTS = 0.5
CAPILLARY_MM = 5.0
FAR = 1_000_000  # cells


@njit(cache=True, nogil=True)
def hang_lengths(kind: NDArray[np.int8], reach: int) -> NDArray[np.float64]:
    """(nx, ny) float, cells   Distance of each hanging column from the nearest holding one, exact up to `reach`; inf beyond, 0 for the others.

    kind : (nx, ny) int8, HANGING, RESTING, HOLDING or -1 for columns that are not under the pool
    """
    nx, ny = kind.shape
    along = np.full((nx, ny), FAR, np.int64)
    for i in range(nx):
        last = -FAR
        for j in range(ny):
            if kind[i, j] == HOLDING:
                last = j
            along[i, j] = j - last
        last = 2 * FAR
        for j in range(ny - 1, -1, -1):
            if kind[i, j] == HOLDING:
                last = j
            along[i, j] = min(along[i, j], last - j)
    out = np.zeros((nx, ny))
    for i in range(nx):
        for j in range(ny):
            if kind[i, j] != HANGING:
                continue
            nearest = np.inf
            for other in range(max(0, i - reach), min(nx, i + reach + 1)):
                if along[other, j] <= reach:
                    nearest = min(nearest, np.sqrt(float(along[other, j] ** 2 + (other - i) ** 2)))
            out[i, j] = nearest
    return out


@njit(cache=True, nogil=True)
def droop_mm(hang_mm: float, width_mm: float, height_mm: float, hold_tan: float) -> float:
    """How far a column that hangs out by `hang_mm` sinks with gravity along the tool axis, mm; inf: it falls.

    hold_tan : tangent of the overhang that holds
    """
    limit = ADHESION_WIDTHS * width_mm
    if hang_mm > limit:
        return np.inf
    free = min(height_mm * hold_tan, limit)
    if hang_mm <= free:
        return 0.0
    share = (hang_mm - free) / (limit - free)
    return DROOP_HEIGHTS * height_mm * share * share


@njit(cache=True, nogil=True)
def run_slope(width_mm: float) -> float:
    """Tilt of the pool's surface for gravity across the axis: the Bond number of the half width."""
    return (0.5 * width_mm / CAPILLARY_MM) ** 2
