"""Inside or outside of a mesh for a whole grid, by counting crossings: apart from the twin's own way, to test it against."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


def inside_grid(corners: Array, origin: Array, cell_mm: float, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Whether each grid point is inside, by parity of crossings along z (half-open rule, exact). corners : (m, 3, 3) mm -> shape bool."""
    flips = np.zeros(shape, dtype=np.uint8)
    count_crossings(corners, origin, cell_mm, flips)
    inside: NDArray[np.bool_] = np.bitwise_xor.accumulate(flips, axis=2).astype(bool)
    return inside


@njit(nogil=True)
def count_crossings(corners: Array, origin: Array, cell: float, flips: NDArray[np.uint8]) -> None:
    """Toggle, for each facet and each grid column through it, the first grid point above the crossing."""
    nx, ny, nz = flips.shape
    for f in range(corners.shape[0]):
        a, b, c = corners[f, 0], corners[f, 1], corners[f, 2]
        i0 = max(0, int(np.ceil((min(a[0], b[0], c[0]) - origin[0]) / cell)))
        i1 = min(nx - 1, int(np.floor((max(a[0], b[0], c[0]) - origin[0]) / cell)))
        for i in range(i0, i1 + 1):
            x = origin[0] + i * cell
            # the facet's cut by the plane of this column row: two points on edges that straddle x (x >= is above)
            n = 0
            y = np.empty(2)
            z = np.empty(2)
            for e in range(3):
                p, q = corners[f, e], corners[f, (e + 1) % 3]
                if (p[0] >= x) != (q[0] >= x):
                    if p[0] > q[0]:
                        p, q = q, p
                    t = (x - p[0]) / (q[0] - p[0])
                    y[n] = p[1] + t * (q[1] - p[1])
                    z[n] = p[2] + t * (q[2] - p[2])
                    n += 1
            if n < 2:
                continue
            for j in range(max(0, int((min(y[0], y[1]) - origin[1]) / cell) - 1), min(ny - 1, int((max(y[0], y[1]) - origin[1]) / cell) + 1) + 1):
                v = origin[1] + j * cell
                if (y[0] >= v) != (y[1] >= v):
                    first = 0 if y[0] < y[1] else 1
                    t = (v - y[first]) / (y[1 - first] - y[first])
                    height = z[first] + t * (z[1 - first] - z[first])
                    k = max(0, int(np.ceil((height - origin[2]) / cell)))
                    if k < nz:
                        flips[i, j, k] ^= 1
