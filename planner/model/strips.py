"""Triangles between the two rings of a wall, along its rulings."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.model.rings import Ring

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def wall_triangles(bottom: Ring, top: Ring, width_mm: float) -> Ints:
    """Triangles (m, 3) of vertex numbers, outside to the right of the rings' direction; every side of both rings once.

    width_mm : places nearer than this along a ring are one: corners that a ruling joins are joined by an edge.
    """
    return strip_between(*bottom.entries(width_mm), *top.entries(width_mm))


@njit(cache=True)
def strip_between(u_low: Floats, low: Ints, u_high: Floats, high: Ints) -> Ints:  # pragma: no cover
    """Triangles between two closed rows of vertices, always on to the vertex whose parameter comes next.

    u_low, u_high : (n,), (m,) float, ascending within one round;  low, high : vertex numbers. Triangles that name one
    vertex twice are left out: their sides cancel.
    """
    n, m = low.shape[0], high.shape[0]
    facets = np.empty((n + m, 3), np.int64)
    count, i, j = 0, 0, 0
    while i < n or j < m:
        next_low = u_low[i + 1] if i + 1 < n else u_low[0] + 1.0
        next_high = u_high[j + 1] if j + 1 < m else u_high[0] + 1.0
        a, b = low[i % n], high[j % m]
        if j == m or (i < n and next_low <= next_high):
            i += 1
            c = low[i % n]
        else:
            j += 1
            c = high[j % m]
        if a != b and b != c and a != c:
            facets[count, 0], facets[count, 1], facets[count, 2] = a, c, b
            count += 1
    return facets[:count]
