"""Distance of two convex bodies, or the least way that parts them.

Source: Gilbert, Johnson & Keerthi, A fast procedure for computing the distance between complex objects in three-dimensional space (1988);
van den Bergen, Collision Detection in Interactive 3D Environments (2003), 4.3: lower bounds, expanding polytope.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.collide.convex import difference
from planner.collide.polytope import depth
from planner.collide.simplex import nearest

Floats = NDArray[np.float64]

_ROUNDS = 64
_CLOSE_MM = 1e-4  # between the two bounds of the distance
_ZERO2_MM2 = 1e-12


@njit(cache=True)
def signed_distance(
    kinds: tuple[int, int], sizes: tuple[Floats, Floats], points: tuple[Floats, Floats], pose: Floats, enough: float, at: Floats
) -> float:
    """Signed distance (mm) of bodies A and B: to 1e-4 where they are apart, less than 0 the least way that parts them.

    pose : (3, 4) float, A's frame from B's   at : (3,), gets A's nearest (or deepest) point, A's frame
    enough : mm; of a distance above it only some lower bound above it is given, and no place
    """
    corners, on_a = np.empty((4, 3)), np.empty((4, 3))
    share = np.zeros(4)
    v, d, w, a = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        d[i] = pose[i, 3]
    if d[0] * d[0] + d[1] * d[1] + d[2] * d[2] < _ZERO2_MM2:
        d[0] = 1.0
    difference(kinds, sizes, points, pose, d, w, a)
    corners[0], on_a[0], v[:] = w, a, w
    share[0] = 1.0
    count = 1
    square = float(np.dot(v, v))
    for _ in range(_ROUNDS):
        if square < _ZERO2_MM2:
            break
        for i in range(3):
            d[i] = -v[i]
        difference(kinds, sizes, points, pose, d, w, a)
        far = np.sqrt(square)
        bound = float(np.dot(v, w)) / far
        if bound > enough:
            return float(bound)
        if far - bound <= _CLOSE_MM:
            _mix(share, on_a, count, at)
            return float(far)
        corners[count], on_a[count] = w, a
        count = nearest(corners, on_a, count + 1, share, v)
        before, square = square, float(np.dot(v, v))
        if count == 4 or square < _ZERO2_MM2:
            break
        if square >= before:  # rounding: no nearer any more
            _mix(share, on_a, count, at)
            return float(np.sqrt(square))
    else:
        _mix(share, on_a, count, at)
        return float(np.sqrt(square))
    return -depth(kinds, sizes, points, pose, corners, on_a, count, at)


@njit(cache=True)
def _mix(share: Floats, on_a: Floats, count: int, at: Floats) -> None:
    """Point of A from its corners' shares."""
    at[:] = 0.0
    for k in range(count):
        for i in range(3):
            at[i] += share[k] * on_a[k, i]
