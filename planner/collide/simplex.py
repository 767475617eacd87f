"""The point of a simplex that is nearest to the origin, over all of its faces that hold the newest corner."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_FLAT = 1e-14  # of the product of squared edges: a face that is flatter is left to its edges


@njit(cache=True)
def nearest(corners: Floats, on_a: Floats, count: int, share: Floats, v: Floats) -> int:
    """Reduce a simplex to its face that holds the nearest point v (3,); the number of corners of that face, 4: the origin is inside.

    corners, on_a : (4, 3) float, the first `count` of them; those of the face come first afterwards   share : (4,), gets theirs
    Of faces whose affine hull's nearest point lies inside them, the one with the least distance has the nearest point.
    """
    last = count - 1
    best, chosen = np.inf, 0
    weights, kept = np.zeros(4), np.zeros(4)
    for others in range(1 << last):
        subset = others | (1 << last)
        if not _shares(corners, subset, weights):
            continue
        square = 0.0
        for i in range(3):
            x = 0.0
            for k in range(count):
                x += weights[k] * corners[k, i]
            square += x * x
        if square < best:
            best, chosen = square, subset
            kept[:] = weights
    size = 0
    v[:] = 0.0
    for k in range(count):
        if chosen >> k & 1:
            corners[size], on_a[size] = corners[k], on_a[k]
            share[size] = kept[k]
            for i in range(3):
                v[i] += kept[k] * corners[size, i]
            size += 1
    return size


@njit(cache=True)
def _shares(corners: Floats, subset: int, weights: Floats) -> bool:
    """Barycentric shares (4,) of the point of a face's affine hull nearest to the origin; whether it lies inside the face."""
    members = np.empty(4, dtype=np.int64)
    size = 0
    for k in range(4):
        weights[k] = 0.0
        if subset >> k & 1:
            members[size] = k
            size += 1
    base = corners[members[0]]
    if size == 1:
        weights[members[0]] = 1.0
        return True
    gram, right = np.zeros((3, 3)), np.zeros(3)
    for i in range(size - 1):
        for k in range(3):
            right[i] -= (corners[members[i + 1], k] - base[k]) * base[k]
        for j in range(size - 1):
            for k in range(3):
                gram[i, j] += (corners[members[i + 1], k] - base[k]) * (corners[members[j + 1], k] - base[k])
    found = _solved(gram, right, size - 1)
    if not found:
        return False
    total = 0.0
    for i in range(size - 1):
        if right[i] <= 0.0:
            return False
        weights[members[i + 1]] = right[i]
        total += right[i]
    weights[members[0]] = 1.0 - total
    return total < 1.0


@njit(cache=True)
def _solved(gram: Floats, right: Floats, size: int) -> bool:
    """Solve for the shares in place by Cramer's rule; False for a face that is flat."""
    if size == 1:
        if gram[0, 0] <= 0.0:
            return False
        right[0] /= gram[0, 0]
        return True
    if size == 2:
        determinant = gram[0, 0] * gram[1, 1] - gram[0, 1] * gram[1, 0]
        if determinant <= _FLAT * gram[0, 0] * gram[1, 1]:
            return False
        first = (right[0] * gram[1, 1] - gram[0, 1] * right[1]) / determinant
        right[1] = (gram[0, 0] * right[1] - right[0] * gram[1, 0]) / determinant
        right[0] = first
        return True
    c00 = gram[1, 1] * gram[2, 2] - gram[1, 2] * gram[2, 1]
    c01 = gram[1, 2] * gram[2, 0] - gram[1, 0] * gram[2, 2]
    c02 = gram[1, 0] * gram[2, 1] - gram[1, 1] * gram[2, 0]
    determinant = gram[0, 0] * c00 + gram[0, 1] * c01 + gram[0, 2] * c02
    if determinant <= _FLAT * gram[0, 0] * gram[1, 1] * gram[2, 2]:
        return False
    c11 = gram[0, 0] * gram[2, 2] - gram[0, 2] * gram[2, 0]
    c12 = gram[0, 1] * gram[2, 0] - gram[0, 0] * gram[2, 1]
    c22 = gram[0, 0] * gram[1, 1] - gram[0, 1] * gram[1, 0]
    x = (c00 * right[0] + c01 * right[1] + c02 * right[2]) / determinant
    y = (c01 * right[0] + c11 * right[1] + c12 * right[2]) / determinant
    z = (c02 * right[0] + c12 * right[1] + c22 * right[2]) / determinant
    right[0], right[1], right[2] = x, y, z
    return True
