"""One column of cells under the melt pool: where its metal begins and ends, how it is raised; and the level of the whole pool."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Column = NDArray[np.float32]

OPEN_BELOW = -1e30  # mm: metal without an underside in reach
NEWTON_STEPS = 60  # of the level: it falls from step to step and stops exactly after as many as there are kinks on its way
HANGING, RESTING, HOLDING = 0, 1, 2  # kinds of columns


@njit(cache=True, nogil=True)
def surface_below(column: Column, start: int, deepest: int) -> float:
    """Height (cells, from index 0) of the highest metal at or below `start`; metal there: of its top; -1: none down to `deepest`."""
    top = column.shape[0] - 1
    k = min(start, top)
    if column[k] < 0.0:
        while k < top and column[k + 1] < 0.0:
            k += 1
        if k == top:
            return float(top)
        return float(k + column[k] / (column[k] - column[k + 1]))
    while k > deepest and column[k] >= 0.0:
        k -= 1
    if column[k] >= 0.0:
        return -1.0
    return float(k + column[k] / (column[k] - column[k + 1]))


@njit(cache=True, nogil=True)
def is_metal(column: Column, height: float) -> bool:
    """Whether there is metal at a height in cells, by interpolation."""
    k = min(max(int(height), 0), column.shape[0] - 2)
    share = min(max(height - k, 0.0), 1.0)
    return bool(column[k] + share * (column[k + 1] - column[k]) < 0.0)


@njit(cache=True, nogil=True)
def underside(column: Column, z0: float, cell: float, surface: float, deepest: float) -> float:
    """Height (mm) of the lower end of the metal that carries `surface`; OPEN_BELOW where it goes on below `deepest`."""
    k = int(np.ceil((surface - z0) / cell)) - 1
    if k > 0 and column[k] >= 0.0:  # the surface lies on this point of the grid but for rounding
        k -= 1
    if k < 0 or column[k] >= 0.0:
        return surface
    while k > 0 and z0 + k * cell > deepest and column[k] < 0.0:
        k -= 1
    if column[k] < 0.0:
        return OPEN_BELOW
    above = column[k + 1]
    return z0 + (k + (column[k] / (column[k] - above) if above < 0.0 else 1.0)) * cell


@njit(cache=True, nogil=True)
def fill_column(
    column: Column, z0: float, cell: float, band: float, bottom: float, surface: float, top: float, cosine: float
) -> tuple[int, int]:
    """Raise one column's surface to `top` (mm); below the old surface only cells whose nearest surface it was sink deeper into the metal.

    Returns first and last cell that may have changed.
    """
    last = min(column.shape[0] - 1, int(np.ceil((top + band / cosine - z0) / cell)))
    first = int(np.floor((surface - band / cosine - z0) / cell))
    if bottom > OPEN_BELOW:
        first = min(first, int(np.floor((bottom - band / cosine - z0) / cell)))
    first = max(0, first)
    for k in range(first, last + 1):
        z = z0 + k * cell
        inside = max(z - top, bottom - z) * cosine
        beside_wall = z < surface and column[k] > (z - surface) * cosine + 0.05 * cell
        if inside < column[k] and not beside_wall:
            column[k] = max(-band, inside)
    return first, last


@njit(cache=True, nogil=True)
def level_of(free: Array, count: int, volume_mm: float) -> float:
    """Level at which columns that are free above `free` (mm) hold `volume_mm` (mm of column, all of them together).

    The sum of max(0, level - free) is convex and piecewise linear in the level: Newton's steps from above end exactly at it.
    """
    low = free[0]
    total = 0.0
    for i in range(count):
        low = min(low, free[i])
        total += free[i]
    level = min(low + volume_mm, (total + volume_mm) / count)  # both are above the level that is sought
    for _ in range(NEWTON_STEPS):
        held, wetted = 0.0, 0
        for i in range(count):
            if free[i] < level:
                held += level - free[i]
                wetted += 1
        if wetted == 0:
            break
        step = (held - volume_mm) / wetted
        level -= step
        if abs(step) < 1e-9:
            break
    return float(level)
