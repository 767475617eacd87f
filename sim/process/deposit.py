"""Metal added under the melt pool: what the pool receives settles as a cap over the surface that it finds, and no volume is lost.

The stock is a narrow-band signed distance (mm, negative in metal) on a grid. The pool is a disc of the bead's width that travels with the
spot. Each piece of path brings a volume; it fills the columns under the disc up to one common level plus the parabolic cap of the bead, so
a track on a flat plate is the parabola of `melt`, a second layer stands on the first with an upright wall, and overlapping tracks fill
the valley between them.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

FIELD = NDArray[np.float32]
OPEN_BELOW = -1e30  # mm: metal without an underside in reach
LEVEL_STEPS = 40  # halvings of the level's bracket: 1e-12 of it remains


@njit(cache=True, nogil=True)
def _surface_below(column: FIELD, start: int, cell: float, deepest: int) -> float:
    """Height (cells, from index 0) of the highest metal at or below `start`, or -1 if none down to `deepest`."""
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
def _level(height: NDArray[np.float64], cap: NDArray[np.float64], count: int, volume: float, column_area: float, rise: float) -> float:
    """Level at which caps over the columns hold `volume` (mm3): bisection on a monotone sum."""
    low = height[0]
    high = height[0]
    for i in range(count):
        low = min(low, height[i] - cap[i])
        high = max(high, height[i])
    high += volume / (column_area * count) + rise
    for _ in range(LEVEL_STEPS):
        middle = 0.5 * (low + high)
        held = 0.0
        for i in range(count):
            held += max(0.0, middle + cap[i] - height[i])
        if held * column_area > volume:
            high = middle
        else:
            low = middle
    return float(low)


@njit(cache=True, nogil=True)
def highest(field: FIELD, band: float, box: NDArray[np.int64], top: int) -> int:
    """Index along z of the highest plane with metal in its band, not below `top`; only columns of `box` ((2, 2) int) may be higher."""
    while top + 1 < field.shape[2]:
        found = False
        for i in range(box[0, 0], box[1, 0] + 1):
            for j in range(box[0, 1], box[1, 1] + 1):
                found |= field[i, j, top + 1] < band
        if not found:
            break
        top += 1
    return top


@njit(cache=True, nogil=True)
def _pool(
    field: FIELD, origin: NDArray[np.float64], cell: float, start: NDArray[np.float64], end: NDArray[np.float64],
    axis: NDArray[np.float64], radius: float, cap_height: float, reach: float,
) -> tuple[int, NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:  # fmt: skip
    """Columns under the pool of one piece.

    How many, their indices (n, 2), heights along the axis (mm), caps (mm), which are empty, and which hold others: those with metal
    through the spot's plane. What the pool itself left hanging a moment ago holds nothing.
    """
    nx, ny, nz = field.shape
    side = 1.5 * radius
    x0 = max(0, int(np.floor((min(start[0], end[0]) - side - origin[0]) / cell)))
    x1 = min(nx - 1, int(np.ceil((max(start[0], end[0]) + side - origin[0]) / cell)))
    y0 = max(0, int(np.floor((min(start[1], end[1]) - side - origin[1]) / cell)))
    y1 = min(ny - 1, int(np.ceil((max(start[1], end[1]) + side - origin[1]) / cell)))
    most = max(0, x1 - x0 + 1) * max(0, y1 - y0 + 1)
    index = np.empty((most, 2), np.int64)
    height = np.empty(most)
    cap = np.empty(most)
    hanging = np.zeros(most, np.bool_)
    holds = np.zeros(most, np.bool_)
    count = 0
    along = end - start
    along = along - axis * (along[0] * axis[0] + along[1] * axis[1] + along[2] * axis[2])
    length2 = along[0] ** 2 + along[1] ** 2 + along[2] ** 2
    spot_level = start[0] * axis[0] + start[1] * axis[1] + start[2] * axis[2]
    for i in range(x0, x1 + 1):
        for j in range(y0, y1 + 1):
            x = origin[0] + i * cell
            y = origin[1] + j * cell
            at = (spot_level - x * axis[0] - y * axis[1]) / axis[2]  # height at which the column meets the spot's plane
            k_spot = (at - origin[2]) / cell
            begin = int(np.ceil(k_spot + 1.0))
            deepest = max(0, int(np.floor(k_spot - reach / cell)))
            if begin < 0 or deepest >= nz - 1:
                continue
            k = _surface_below(field[i, j], begin, cell, deepest)
            z = origin[2] + k * cell if k >= 0.0 else at
            dx, dy, dz = x - start[0], y - start[1], z - start[2]
            depth = dx * axis[0] + dy * axis[1] + dz * axis[2]
            dx, dy, dz = dx - depth * axis[0], dy - depth * axis[1], dz - depth * axis[2]
            if length2 > 0.0:
                s = min(1.0, max(0.0, (dx * along[0] + dy * along[1] + dz * along[2]) / length2))
                dx, dy, dz = dx - s * along[0], dy - s * along[1], dz - s * along[2]
            distance2 = (dx * dx + dy * dy + dz * dz) / (radius * radius)
            if distance2 < 1.0:
                index[count, 0], index[count, 1] = i, j
                height[count] = spot_level + depth
                cap[count] = cap_height * (1.0 - distance2)
                hanging[count] = k < 0.0
                below = max(0, int(np.floor(k_spot)) - 1)
                holds[count] = 0.0 <= k <= k_spot or (k > k_spot and field[i, j, below] < 0.0)
                count += 1
    return count, index, height, cap, hanging, holds


@njit(cache=True, nogil=True)
def add_piece(
    field: FIELD, origin: NDArray[np.float64], cell: float, band: float, start: NDArray[np.float64], end: NDArray[np.float64],
    axis: NDArray[np.float64], radius: float, cap_height: float, volume: float, reach: float, adhesion: float,
) -> float:  # fmt: skip
    """Add `volume` along one straight piece of the spot's path.

    field : (nx, ny, nz) float32, mm   Changed in place. Columns run along the last index, and axis[2] > 0 is the largest component.
    origin : (3,) float, mm   Centre of cell (0, 0, 0), same frame as start, end (mm) and axis (unit vector, spot to head).
    radius, cap_height : mm   Half width and height of the bead on a flat plate.
    reach : mm   Metal is looked for this far below the spot; a column without any is unsupported.
    adhesion : mm   Unsupported columns this close to supported ones hold by the pool's surface tension, from the spot's level on.
    Returns the volume that found metal to hold on to, mm3.
    """
    count, index, height, cap, hanging, holds = _pool(field, origin, cell, start, end, axis, radius, cap_height, reach)
    if not holds[:count].any():
        return 0.0
    kept = count
    if hanging[:count].any():
        kept = _drop_unsupported(index, height, cap, hanging, holds, count, adhesion / cell)
    held = volume * kept / count
    level = _level(height, cap, kept, held, cell * cell / axis[2], cap_height)
    for c in range(kept):
        rise = level + cap[c] - height[c]
        if rise <= 0.0:
            continue
        i, j = index[c, 0], index[c, 1]
        flat = (origin[0] + i * cell) * axis[0] + (origin[1] + j * cell) * axis[1]
        top = (height[c] + rise - flat) / axis[2]
        found = (height[c] - flat) / axis[2]
        bottom = found if hanging[c] else _underside(field[i, j], origin[2], cell, found, top - 2.0 * band / axis[2])
        _fill_column(field[i, j], origin[2], cell, band, bottom, found, top, axis[2])
    return float(held)


@njit(cache=True, nogil=True)
def add_pieces(
    field: FIELD, origin: NDArray[np.float64], cell: float, band: float, path: NDArray[np.float64], bead: NDArray[np.float64],
    reach: float, adhesion: float,
) -> float:  # fmt: skip
    """Add several pieces in order of time; see `add_piece`. Returns the volume that stuck, mm3.

    path : (n, 9) float   start, end (mm) and axis of each piece   bead : (n, 3) float   half width, height (mm), volume (mm3)
    reach : in heights of the bead   adhesion : in widths of the bead
    """
    held = 0.0
    for n in range(path.shape[0]):
        radius, cap_height, volume = bead[n, 0], bead[n, 1], bead[n, 2]
        held += add_piece(
            field, origin, cell, band, path[n, 0:3], path[n, 3:6], path[n, 6:9], radius, cap_height, volume,
            reach * cap_height, adhesion * 2.0 * radius,
        )  # fmt: skip
    return float(held)


@njit(cache=True, nogil=True)
def _underside(column: FIELD, z0: float, cell: float, surface: float, deepest: float) -> float:
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
def _fill_column(column: FIELD, z0: float, cell: float, band: float, bottom: float, surface: float, top: float, cosine: float) -> None:
    """Raise one column's surface to `top` (mm); below the old surface only cells whose nearest surface it was sink deeper into the metal."""
    last = min(column.shape[0] - 1, int(np.ceil((top + band / cosine - z0) / cell)))
    first = int(np.floor((surface - band / cosine - z0) / cell))
    if bottom > OPEN_BELOW:
        first = min(first, int(np.floor((bottom - band / cosine - z0) / cell)))
    for k in range(last, max(0, first) - 1, -1):
        z = z0 + k * cell
        inside = max(z - top, bottom - z) * cosine
        beside_wall = z < surface and column[k] > (z - surface) * cosine + 0.05 * cell
        if inside < column[k] and not beside_wall:
            column[k] = max(-band, inside)


@njit(cache=True, nogil=True)
def _drop_unsupported(
    index: NDArray[np.int64],
    height: NDArray[np.float64],
    cap: NDArray[np.float64],
    hanging: NDArray[np.bool_],
    holds: NDArray[np.bool_],
    count: int,
    adhesion_cells: float,
) -> int:
    """Keep columns with metal, and empty ones close to those that hold, in place; returns how many."""
    keep = np.ones(count, np.bool_)
    for a in range(count):
        if hanging[a]:
            keep[a] = False
            for b in range(count):
                if holds[b]:
                    away = (index[a, 0] - index[b, 0]) ** 2 + (index[a, 1] - index[b, 1]) ** 2
                    if away <= adhesion_cells * adhesion_cells:
                        keep[a] = True
                        break
    kept = 0
    for a in range(count):
        if keep[a]:
            index[kept, 0], index[kept, 1] = index[a, 0], index[a, 1]
            height[kept], cap[kept], hanging[kept] = height[a], cap[a], hanging[a]
            kept += 1
    return kept
