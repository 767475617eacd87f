"""The compiled inner loops: points and derivatives of a (rational) B-spline at many parameters."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

DOMAIN_SLACK = 1e-9  # share of the domain by which rounding may carry a parameter outside


@njit(cache=True, error_model="numpy", nogil=True)
def inner_spans(degree: int, knots: Floats) -> tuple[int, int]:
    """First and last non-empty knot span of the domain."""
    count = len(knots) - degree - 1
    first, last = degree, count - 1
    while last > first and knots[last] >= knots[count]:
        last -= 1
    while first < last and knots[first + 1] <= knots[degree]:
        first += 1
    return first, last


@njit(cache=True, error_model="numpy", nogil=True)
def span_at(knots: Floats, first: int, last: int, span: int, t: float, from_left: bool) -> int:
    """The non-empty span that holds t, by bisection unless it is the one given (A2.1)."""
    if from_left:
        if knots[span] < t <= knots[span + 1]:
            return span
    elif knots[span] <= t < knots[span + 1]:
        return span
    low, high = first, last + 1
    while high - low > 1:
        middle = (low + high) // 2
        if knots[middle] < t or (knots[middle] == t and not from_left):
            low = middle
        else:
            high = middle
    return low


@njit(cache=True, error_model="numpy", nogil=True)
def basis_at(degree: int, knots: Floats, span: int, t: float, basis: Floats) -> None:
    """The degree+1 basis functions that do not vanish at t, into basis[0 ... degree] (A2.2)."""
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


@njit(cache=True, error_model="numpy", nogil=True)
def outside(knots: Floats, u: Floats) -> int:
    """Index of the first parameter that leaves the domain by more than rounding (or is no number), or -1."""
    low, high = knots[0], knots[-1]
    slack = DOMAIN_SLACK * (high - low)
    for k in range(u.size):
        if not low - slack <= u[k] <= high + slack:
            return k
    return -1


@njit(cache=True, error_model="numpy", nogil=True)
def fill_points(degree: int, knots: Floats, rows: Floats, rational: bool, u: Floats, left: bool, out: Floats) -> int:
    """Points at the parameters into out (k, d); rows as `Curve.homogeneous` (A3.1, A4.1).

    At a knot the span to its right counts, or with `left` the one that ends there.
    Returns the index of a parameter that leaves the domain, or -1.
    """
    bad = outside(knots, u)
    if bad >= 0:
        return bad
    dimension = out.shape[1]
    basis = np.empty(degree + 1)
    first, last = inner_spans(degree, knots)
    span = first
    for k in range(u.size):
        t = min(max(u[k], knots[0]), knots[-1])
        span = span_at(knots, first, last, span, t, left)
        basis_at(degree, knots, span, t, basis)
        for axis in range(dimension):
            out[k, axis] = 0.0
        weight = 0.0
        for j in range(degree + 1):
            share = basis[j]
            row = span - degree + j
            for axis in range(dimension):
                out[k, axis] += share * rows[row, axis]
            if rational:
                weight += share * rows[row, dimension]
        if rational:
            for axis in range(dimension):
                out[k, axis] /= weight
    return -1


@njit(cache=True, error_model="numpy", nogil=True)
def difference_nets(degree: int, knots: Floats, rows: Floats, span: int, order: int, nets: Floats) -> None:
    """Control points of the derivatives 0 ... order on one span, into nets (order+1, degree+1, D) (A3.3)."""
    for j in range(degree + 1):
        for axis in range(rows.shape[1]):
            nets[0, j, axis] = rows[span - degree + j, axis]
    for k in range(1, min(order, degree) + 1):
        for j in range(degree + 1 - k):
            at = span - degree + j
            factor = (degree + 1 - k) / (knots[at + degree + 1] - knots[at + k])
            for axis in range(rows.shape[1]):
                nets[k, j, axis] = factor * (nets[k - 1, j + 1, axis] - nets[k - 1, j, axis])


@njit(cache=True, error_model="numpy", nogil=True)
def basis_levels(degree: int, knots: Floats, span: int, t: float, levels: Floats) -> None:
    """The basis functions of every degree 0 ... degree that do not vanish at t, into levels[q, 0 ... q] (A2.2)."""
    levels[0, 0] = 1.0
    for level in range(1, degree + 1):
        saved = 0.0
        for r in range(level):
            right = knots[span + r + 1] - t
            left = t - knots[span + 1 - level + r]
            share = levels[level - 1, r] / (right + left)
            levels[level, r] = saved + right * share
            saved = left * share
        levels[level, level] = saved


@njit(cache=True, error_model="numpy", nogil=True)
def quotient(work: Floats, orders: int, dimension: int) -> None:
    """Turn the derivatives (orders, d+1) of (w C, w) into those of C, in place in the first d columns (A4.2)."""
    for k in range(orders):
        binomial = 1.0
        for i in range(1, k + 1):
            binomial = binomial * (k - i + 1) / i
            for axis in range(dimension):
                work[k, axis] -= binomial * work[i, dimension] * work[k - i, axis]
        for axis in range(dimension):
            work[k, axis] /= work[0, dimension]


@njit(cache=True, error_model="numpy", nogil=True)
def fill_derivatives(
    degree: int, knots: Floats, rows: Floats, rational: bool, u: Floats, left: bool, out: Floats
) -> int:
    """Derivatives 0 ... order at the parameters into out (order+1, k, d); rows as `Curve.homogeneous` (A3.4, A4.2).

    Returns the index of a parameter that leaves the domain, or -1.
    """
    bad = outside(knots, u)
    if bad >= 0:
        return bad
    orders, _, dimension = out.shape
    width = rows.shape[1]
    nets = np.zeros((orders, degree + 1, width))
    levels = np.zeros((degree + 1, degree + 1))
    work = np.empty((orders, width))
    first, last = inner_spans(degree, knots)
    span, known = first, -1
    for k in range(u.size):
        t = min(max(u[k], knots[0]), knots[-1])
        span = span_at(knots, first, last, span, t, left)
        if span != known:
            difference_nets(degree, knots, rows, span, orders - 1, nets)
            known = span
        basis_levels(degree, knots, span, t, levels)
        for order in range(orders):
            for axis in range(width):
                total = 0.0
                for j in range(degree + 1 - order):
                    total += levels[degree - order, j] * nets[order, j, axis]
                work[order, axis] = total
        if rational:
            quotient(work, orders, dimension)
        for order in range(orders):
            for axis in range(dimension):
                out[order, k, axis] = work[order, axis]
    return -1
