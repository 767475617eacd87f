"""Signed distance and support point of the machine's shapes, each in its own frame: box, frustum (cylinder, cone) and hull."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

BOX, FRUSTUM, HULL, MESH = 0, 1, 2, 3
"""Kinds of shape. A box is centred; a frustum stands on its first end's centre and goes up along z; hull and mesh are made of facets."""


@njit(cache=True, nogil=True)
def box_distance(size: Array, x: float, y: float, z: float) -> float:
    """Signed distance, mm, of a point to a box. size : half edges."""
    qx, qy, qz = abs(x) - size[0], abs(y) - size[1], abs(z) - size[2]
    outside = max(qx, 0.0) ** 2 + max(qy, 0.0) ** 2 + max(qz, 0.0) ** 2
    if outside > 0.0:
        return float(np.sqrt(outside))
    return float(max(qx, max(qy, qz)))


@njit(cache=True, nogil=True)
def frustum_distance(size: Array, x: float, y: float, z: float) -> float:
    """Signed distance, mm, of a point to a frustum. size : radius at z = 0, radius at the other end, length."""
    low, high, length = size[0], size[1], size[2]
    radial = np.sqrt(x * x + y * y)
    along, up = high - low, length
    share = ((radial - low) * along + z * up) / (along * along + up * up)
    share = min(1.0, max(0.0, share))
    side = np.hypot(radial - low - share * along, z - share * up)
    bottom = np.hypot(max(0.0, radial - low), z)
    top = np.hypot(max(0.0, radial - high), z - length)
    least = min(side, min(bottom, top))
    within = 0.0 <= z <= length and (radial - low) * up - z * along <= 0.0
    return float(-least if within else least)


@njit(cache=True, nogil=True)
def support(
    kind: int, size: Array, vertices: Array, first: int, last: int, dx: float, dy: float, dz: float
) -> tuple[float, float, float]:
    """The shape's farthest point in a direction (any length). vertices[first:last] : of a hull, or of one facet."""
    if kind == BOX:
        return (
            size[0] if dx >= 0.0 else -size[0],
            size[1] if dy >= 0.0 else -size[1],
            size[2] if dz >= 0.0 else -size[2],
        )
    if kind == FRUSTUM:
        across = np.sqrt(dx * dx + dy * dy)
        z, radius = 0.0, size[0]
        if across * size[1] + dz * size[2] > across * size[0]:
            z, radius = size[2], size[1]
        if across < 1e-12 * abs(dz) or across == 0.0:
            return 0.0, 0.0, z
        return radius * dx / across, radius * dy / across, z
    best, at = -np.inf, first
    for n in range(first, last):
        reach = vertices[n, 0] * dx + vertices[n, 1] * dy + vertices[n, 2] * dz
        if reach > best:
            best, at = reach, n
    return vertices[at, 0], vertices[at, 1], vertices[at, 2]
