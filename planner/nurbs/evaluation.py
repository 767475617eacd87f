"""The compiled inner loop: points of a B-spline at many parameters."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@njit(cache=True, error_model="numpy", nogil=True)
def _points_at(degree: int, knots: Floats, points: Floats, u: Floats, from_left: bool) -> Floats:  # pragma: no cover
    count, dimension = points.shape
    result = np.zeros((u.size, dimension))
    basis = np.empty(degree + 1)
    first, last = degree, count - 1
    while last > first and knots[last] >= knots[count]:
        last -= 1
    while first < last and knots[first + 1] <= knots[degree]:
        first += 1
    span = first
    for k in range(u.size):
        t = u[k]
        low_side, high_side = knots[span], knots[span + 1]
        inside = low_side < t <= high_side if from_left else low_side <= t < high_side
        if not inside:
            low, high = first, last + 1
            while high - low > 1:
                middle = (low + high) // 2
                if knots[middle] < t or (knots[middle] == t and not from_left):
                    low = middle
                else:
                    high = middle
            span = low
        basis[0] = 1.0
        for level in range(1, degree + 1):
            saved = 0.0
            for r in range(level):
                right = knots[span + r + 1] - t
                left = t - knots[span + 1 - level + r]
                share = basis[r] / (right + left)
                basis[r] = saved + right * share
                saved = left * share
            basis[level] = saved
        for j in range(degree + 1):
            weight = basis[j]
            row = span - degree + j
            for axis in range(dimension):
                result[k, axis] += weight * points[row, axis]
    return result


def spline_points(degree: int, knots: Floats, points: Floats, u: Floats, from_left: bool = False) -> Floats:
    """Points of a (non-rational) B-spline; the parameters need not be sorted, sorted ones are faster.

    knots     : (m,) float   Clamped.
    points    : (n, d) float   Control points, n = m - degree - 1.
    u         : (k,) float   Inside the domain.
    from_left : at a knot, take the span that ends there.
    Returns (k, d) float.
    Source: Piegl & Tiller A3.1 with A2.1 and A2.2.
    """
    result: Floats = _points_at(
        degree, np.ascontiguousarray(knots), np.ascontiguousarray(points), np.ascontiguousarray(u), from_left
    )
    return result


def derivative_spline(degree: int, knots: Floats, points: Floats) -> tuple[int, Floats, Floats]:
    """Degree, knots and control points of the derivative of a (non-rational) B-spline.

    Returns (degree-1, (m-2,) float, (n-1, d) float); a control point whose basis function has no support is zero.
    Source: Piegl & Tiller Eqs. 3.4, 3.6, 3.8.
    """
    width = knots[degree + 1 : -1] - knots[1 : -degree - 1]
    factor = np.divide(degree, width, out=np.zeros_like(width), where=width > 0.0)
    return degree - 1, knots[1:-1], np.diff(points, axis=0) * factor[:, None]
