"""Metal removed where a turning cutter sweeps: the stock minus the exact swept volume of a flat, bull-nose or ball end mill."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

FIELD = NDArray[np.float32]


@njit(cache=True, nogil=True)
def cutter_distance(radial: float, axial: float, radius: float, corner: float) -> float:
    """Signed distance (mm, negative inside) to an end mill that reaches upward for ever.

    radial, axial : distance from the axis, and height above the cutter's end, mm. corner : 0 flat, = radius ball.
    """
    r = radial - (radius - corner)
    z = corner - axial
    outside = np.sqrt(max(r, 0.0) ** 2 + max(z, 0.0) ** 2)
    return float(outside + min(max(r, z), 0.0) - corner)


@njit(cache=True, nogil=True)
def remove_piece(
    field: FIELD,
    origin: NDArray[np.float64],
    cell: float,
    band: float,
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    axis: NDArray[np.float64],
    radius: float,
    corner: float,
    reach: float,
) -> float:
    """Cut along one straight piece with constant axis.

    field : (nx, ny, nz) float32, mm   Changed in place.
    origin : (3,) float, mm; start, end : (3,) float, mm, cutter end; axis : (3,) float, unit vector from the end to the spindle
    reach : mm   Length of the cutter above its end.
    Pieces that move along the axis have to be short against the cell: the sweep is exact across the axis only.
    Returns the greatest depth at which the cutter met metal, mm (0: cut air).
    """
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    for d in range(3):
        side = radius * np.sqrt(max(0.0, 1.0 - axis[d] * axis[d])) + band
        least = min(start[d], end[d]) + min(0.0, axis[d] * reach) - side
        most = max(start[d], end[d]) + max(0.0, axis[d] * reach) + side
        low[d] = max(0, int(np.floor((least - origin[d]) / cell)))
        high[d] = min(field.shape[d] - 1, int(np.ceil((most - origin[d]) / cell)))
    along = end - start
    lift = along[0] * axis[0] + along[1] * axis[1] + along[2] * axis[2]
    across = along - lift * axis
    length2 = across[0] ** 2 + across[1] ** 2 + across[2] ** 2
    deepest = 0.0
    for i in range(low[0], high[0] + 1):
        dx0 = origin[0] + i * cell - start[0]
        for j in range(low[1], high[1] + 1):
            dy0 = origin[1] + j * cell - start[1]
            for k in range(low[2], high[2] + 1):
                value = field[i, j, k]
                if value >= band:
                    continue
                dz0 = origin[2] + k * cell - start[2]
                axial = dx0 * axis[0] + dy0 * axis[1] + dz0 * axis[2]
                dx, dy, dz = dx0 - axial * axis[0], dy0 - axial * axis[1], dz0 - axial * axis[2]
                s = 0.5
                if length2 > 0.0:
                    s = min(1.0, max(0.0, (dx * across[0] + dy * across[1] + dz * across[2]) / length2))
                    dx, dy, dz = dx - s * across[0], dy - s * across[1], dz - s * across[2]
                    axial -= s * lift
                else:
                    axial -= min(0.0, lift)
                if axial > reach:
                    continue
                inside = -cutter_distance(np.sqrt(dx * dx + dy * dy + dz * dz), axial, radius, corner)
                if inside > value:
                    if inside > 0.0 and value < 0.0:
                        deepest = max(deepest, min(inside, -value))
                    field[i, j, k] = min(band, inside)
    return deepest
