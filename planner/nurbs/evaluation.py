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
def cubic_basis(knots: Floats, span: int, t: float) -> tuple[float, float, float, float]:
    """The four cubic basis functions that do not vanish at t (A2.2 written out: three times as fast)."""
    t1, t2, t3 = knots[span - 2], knots[span - 1], knots[span]
    t4, t5, t6 = knots[span + 1], knots[span + 2], knots[span + 3]
    left1, left2, left3 = t - t3, t - t2, t - t1
    right1, right2, right3 = t4 - t, t5 - t, t6 - t
    inner = 1.0 / (t4 - t3)
    low, high = right1 * inner / (t4 - t2), left1 * inner / (t5 - t3)
    b0 = right1 * low / (t4 - t1)
    b1 = (left2 * low + right2 * high) / (t5 - t2)
    b2 = left1 * high / (t6 - t3)
    return right1 * b0, left3 * b0 + right2 * b1, left2 * b1 + right3 * b2, left1 * b2


@njit(cache=True, error_model="numpy", nogil=True)
def _fill_cubic_points(knots: Floats, rows: Floats, rational: bool, u: Floats, left: bool, out: Floats) -> None:
    """The work of fill_points for degree 3, all parameters inside the domain."""
    dimension = out.shape[1]
    first, last = inner_spans(3, knots)
    span = first
    for k in range(u.size):
        t = min(max(u[k], knots[0]), knots[-1])
        span = span_at(knots, first, last, span, t, left)
        b0, b1, b2, b3 = cubic_basis(knots, span, t)
        if rational:
            w0, w1 = rows[span - 3, dimension], rows[span - 2, dimension]
            w2, w3 = rows[span - 1, dimension], rows[span, dimension]
            inverse = 1.0 / (b0 * w0 + b1 * w1 + b2 * w2 + b3 * w3)
            b0, b1, b2, b3 = b0 * inverse, b1 * inverse, b2 * inverse, b3 * inverse
        for axis in range(dimension):
            low, high = b0 * rows[span - 3, axis] + b1 * rows[span - 2, axis], b2 * rows[span - 1, axis]
            out[k, axis] = low + (high + b3 * rows[span, axis])


@njit(cache=True, error_model="numpy", nogil=True)
def fill_points(degree: int, knots: Floats, rows: Floats, rational: bool, u: Floats, left: bool, out: Floats) -> int:
    """Points at the parameters into out (k, d); rows as `Curve.homogeneous` (A3.1, A4.1).

    At a knot the span to its right counts, or with `left` the one that ends there.
    Returns the index of a parameter that leaves the domain, or -1.
    """
    bad = outside(knots, u)
    if bad >= 0:
        return bad
    if degree == 3:
        _fill_cubic_points(knots, rows, rational, u, left, out)
        return -1
    dimension = out.shape[1]
    basis = np.empty(degree + 1)
    first, last = inner_spans(degree, knots)
    span = first
    for k in range(u.size):
        t = min(max(u[k], knots[0]), knots[-1])
        span = span_at(knots, first, last, span, t, left)
        basis_at(degree, knots, span, t, basis)
        base = span - degree
        for axis in range(dimension):
            total = 0.0
            for j in range(degree + 1):
                total += basis[j] * rows[base + j, axis]
            out[k, axis] = total
        if rational:
            weight = 0.0
            for j in range(degree + 1):
                weight += basis[j] * rows[base + j, dimension]
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
def _cubic_work(knots: Floats, span: int, t: float, nets: Floats, work: Floats) -> None:
    """Derivatives of a cubic spline's rows at t, into work (orders, D), from difference_nets (A3.4 written out)."""
    t2, t3, t4, t5 = knots[span - 1], knots[span], knots[span + 1], knots[span + 2]
    inner = 1.0 / (t4 - t3)
    l0, l1 = (t4 - t) * inner, (t - t3) * inner
    low, high = l0 / (t4 - t2), l1 / (t5 - t3)
    q0, q1, q2 = (t4 - t) * low, (t - t2) * low + (t5 - t) * high, (t - t3) * high
    b0, b1, b2, b3 = cubic_basis(knots, span, t)
    for axis in range(work.shape[1]):
        near, far = b0 * nets[0, 0, axis] + b1 * nets[0, 1, axis], b2 * nets[0, 2, axis] + b3 * nets[0, 3, axis]
        work[0, axis] = near + far
        if len(work) > 1:
            work[1, axis] = q0 * nets[1, 0, axis] + q1 * nets[1, 1, axis] + q2 * nets[1, 2, axis]
        if len(work) > 2:
            work[2, axis] = l0 * nets[2, 0, axis] + l1 * nets[2, 1, axis]
        for order in range(3, len(work)):
            work[order, axis] = nets[order, 0, axis]


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
        if degree == 3:
            _cubic_work(knots, span, t, nets, work)
        else:
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
