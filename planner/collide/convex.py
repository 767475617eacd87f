"""Convex bodies in numbers: farthest point in a direction and signed distance of a point, each in the body's own frame."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BOX, FRUSTUM, ROUNDED, HULL = 0, 1, 2, 3
"""Kinds. A box is centred, `size` its half edges. A frustum stands on z = 0 and goes up: radius there, radius at the end, length.
Rounded: a cylinder that stands on z = 0, its lower edge rounded: radius, radius of the edge (a ball: the same), length.
A hull is the convex hull of points; a facet is one of three."""


@njit(cache=True)
def support(kind: int, size: Floats, points: Floats, dx: float, dy: float, dz: float) -> tuple[float, float, float]:
    """The body's farthest point (mm) in a direction of any length.  size : (3,) mm   points : (k, 3) mm, of a hull"""
    if kind == BOX:
        return (
            size[0] if dx >= 0.0 else -size[0],
            size[1] if dy >= 0.0 else -size[1],
            size[2] if dz >= 0.0 else -size[2],
        )
    if kind == HULL:
        best, at = -np.inf, 0
        for k in range(len(points)):
            reach = points[k, 0] * dx + points[k, 1] * dy + points[k, 2] * dz
            if reach > best:
                best, at = reach, k
        return points[at, 0], points[at, 1], points[at, 2]
    across = np.sqrt(dx * dx + dy * dy)
    x, y = (dx / across, dy / across) if across > 1e-12 * abs(dz) and across > 0.0 else (0.0, 0.0)
    if kind == ROUNDED and dz < 0.0:
        length = np.sqrt(across * across + dz * dz)
        ring, edge = size[0] - size[1], size[1] / length
        return ring * x + edge * dx, ring * y + edge * dy, size[1] + edge * dz
    radius, z = size[0], size[2]
    if kind == FRUSTUM:
        if across * size[1] + dz * size[2] > across * size[0]:
            radius = size[1]
        else:
            z = 0.0
    return radius * x, radius * y, z


@njit(cache=True)
def point_distance(kind: int, size: Floats, points: Floats, x: float, y: float, z: float) -> float:
    """Signed distance (mm) of a point, less than 0 inside; of a hull a lower bound: the distance of its box."""
    if kind == BOX:
        return _of_box(size[0], size[1], size[2], x, y, z)
    if kind == HULL:
        low, high = np.empty(3), np.empty(3)
        for k in range(3):
            low[k], high[k] = points[:, k].min(), points[:, k].max()
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        return _of_box(half[0], half[1], half[2], x - middle[0], y - middle[1], z - middle[2])
    r = np.sqrt(x * x + y * y)
    if kind == ROUNDED:
        ring, edge, length = size[0] - size[1], size[1], size[2]
        if z < edge and r > ring:
            return float(np.hypot(r - ring, z - edge) - edge)
        return _of_box(size[0], 0.5 * length, 0.0, r, z - 0.5 * length, -1e9)
    low_r, high_r, up = size[0], size[1], size[2]
    along = high_r - low_r
    share = min(1.0, max(0.0, ((r - low_r) * along + z * up) / (along * along + up * up)))
    side = np.hypot(r - low_r - share * along, z - share * up)
    ends = min(np.hypot(max(0.0, r - low_r), z), np.hypot(max(0.0, r - high_r), z - up))
    inside = 0.0 <= z <= up and (r - low_r) * up <= z * along
    least = min(side, ends)
    return float(-least if inside else least)


@njit(cache=True)
def _of_box(a: float, b: float, c: float, x: float, y: float, z: float) -> float:
    """Signed distance from a centred box of half edges a, b, c; with z = -1e9 and c = 0 that of a rectangle."""
    qx, qy = abs(x) - a, abs(y) - b
    qz = -np.inf if z == -1e9 else abs(z) - c
    out = max(qx, 0.0) ** 2 + max(qy, 0.0) ** 2 + max(qz, 0.0) ** 2
    if out > 0.0:
        return float(np.sqrt(out))
    return float(max(qx, max(qy, qz)))


@njit(cache=True)
def difference(
    kinds: tuple[int, int], sizes: tuple[Floats, Floats], points: tuple[Floats, Floats], pose: Floats, d: Floats, w: Floats, a: Floats
) -> None:
    """Farthest point w (3,) of A - B in a direction d (3,), and its point a (3,) of A; all in A's frame.

    pose : (3, 4) float, A's frame from B's
    """
    a[0], a[1], a[2] = support(kinds[0], sizes[0], points[0], d[0], d[1], d[2])
    bx, by, bz = support(
        kinds[1], sizes[1], points[1],
        -(pose[0, 0] * d[0] + pose[1, 0] * d[1] + pose[2, 0] * d[2]),
        -(pose[0, 1] * d[0] + pose[1, 1] * d[1] + pose[2, 1] * d[2]),
        -(pose[0, 2] * d[0] + pose[1, 2] * d[1] + pose[2, 2] * d[2]),
    )  # fmt: skip
    for i in range(3):
        w[i] = a[i] - (pose[i, 0] * bx + pose[i, 1] * by + pose[i, 2] * bz + pose[i, 3])
