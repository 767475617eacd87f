"""The compiled inner loops of surfaces: points on grids and at pairs of parameters, and derivatives."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.nurbs.evaluation import basis_at, basis_levels, inner_spans, span_at

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]


@njit(cache=True, error_model="numpy", nogil=True)
def fill_basis(degree: int, knots: Floats, u: Floats, spans: Indices, basis: Floats) -> None:
    """Span and non-vanishing basis functions of each parameter (clamped to the domain), into (k,) and (k, p+1)."""
    first, last = inner_spans(degree, knots)
    span = first
    for k in range(u.size):
        t = min(max(u[k], knots[0]), knots[-1])
        span = span_at(knots, first, last, span, t, False)
        spans[k] = span
        basis_at(degree, knots, span, t, basis[k])


@njit(cache=True, error_model="numpy", nogil=True)
def fill_grid(
    degree_u: int, degree_v: int, knots_u: Floats, knots_v: Floats, net: Floats, rational: bool,
    u: Floats, v: Floats, out: Floats,
) -> None:  # fmt: skip
    """Points at every pair of a u and a v, into out (ku, kv, d) (A3.5, A4.3): one row of the net per u, then along it.

    net : (n, m, D)   Homogeneous if rational.
    """
    spans_u, basis_u = np.empty(u.size, dtype=np.intp), np.empty((u.size, degree_u + 1))
    spans_v, basis_v = np.empty(v.size, dtype=np.intp), np.empty((v.size, degree_v + 1))
    fill_basis(degree_u, knots_u, u, spans_u, basis_u)
    fill_basis(degree_v, knots_v, v, spans_v, basis_v)
    dimension = out.shape[2]
    row = np.empty(net.shape[1:])
    for a in range(u.size):
        row[:] = 0.0
        for i in range(degree_u + 1):
            at, share = spans_u[a] - degree_u + i, basis_u[a, i]
            for j in range(net.shape[1]):
                for axis in range(net.shape[2]):
                    row[j, axis] += share * net[at, j, axis]
        for b in range(v.size):
            start = spans_v[b] - degree_v
            weight = 1.0
            if rational:
                weight = 0.0
                for j in range(degree_v + 1):
                    weight += basis_v[b, j] * row[start + j, dimension]
            for axis in range(dimension):
                total = 0.0
                for j in range(degree_v + 1):
                    total += basis_v[b, j] * row[start + j, axis]
                out[a, b, axis] = total / weight


@njit(cache=True, error_model="numpy", nogil=True)
def basis_derivatives_at(degree: int, knots: Floats, span: int, t: float, levels: Floats, found: Floats) -> None:
    """Derivatives 0 ... order of the non-vanishing basis functions, into found (order+1, p+1) (Eq. 2.7; see A2.3)."""
    basis_levels(degree, knots, span, t, levels)
    found[:] = 0.0
    for order in range(min(found.shape[0] - 1, degree) + 1):
        values = found[order]
        for j in range(degree - order + 1):
            values[j] = levels[degree - order, j]
        for p in range(degree - order + 1, degree + 1):
            for j in range(p, -1, -1):
                i = span - p + j
                before = values[j - 1] / (knots[i + p] - knots[i]) if j > 0 else 0.0
                after = values[j] / (knots[i + p + 1] - knots[i + 1]) if j < p else 0.0
                values[j] = p * (before - after)


@njit(cache=True, error_model="numpy", nogil=True)
def quotient_2d(work: Floats, dimension: int) -> None:
    """Turn derivatives (o, o, d+1) of (w S, w) into those of S, in place in the first d columns (A4.4)."""
    orders = work.shape[0]
    for k in range(orders):
        for m in range(orders - k):
            outer = 1.0
            for i in range(k + 1):
                if i > 0:
                    outer = outer * (k - i + 1) / i
                inner = 1.0
                for j in range(m + 1):
                    if j > 0:
                        inner = inner * (m - j + 1) / j
                    if i + j > 0:
                        factor = outer * inner * work[i, j, dimension]
                        for axis in range(dimension):
                            work[k, m, axis] -= factor * work[k - i, m - j, axis]
            for axis in range(dimension):
                work[k, m, axis] /= work[0, 0, dimension]


@njit(cache=True, error_model="numpy", nogil=True)
def fill_surface_derivatives(
    degree_u: int, degree_v: int, knots_u: Floats, knots_v: Floats, net: Floats, rational: bool,
    u: Floats, v: Floats, left_u: bool, left_v: bool, out: Floats,
) -> None:  # fmt: skip
    """Derivatives at pairs of parameters into out (o+1, o+1, k, d), those of total order above o are zero (A3.6, A4.4).

    out[a, b] : derived a times by u, b times by v.
    """
    orders, width, dimension = out.shape[0], net.shape[2], out.shape[3]
    levels_u, levels_v = np.zeros((degree_u + 1, degree_u + 1)), np.zeros((degree_v + 1, degree_v + 1))
    by_u, by_v = np.empty((orders, degree_u + 1)), np.empty((orders, degree_v + 1))
    row, work = np.empty((degree_v + 1, width)), np.empty((orders, orders, width))
    first_u, last_u = inner_spans(degree_u, knots_u)
    first_v, last_v = inner_spans(degree_v, knots_v)
    span_u, span_v = first_u, first_v
    for k in range(u.size):
        s, t = min(max(u[k], knots_u[0]), knots_u[-1]), min(max(v[k], knots_v[0]), knots_v[-1])
        span_u = span_at(knots_u, first_u, last_u, span_u, s, left_u)
        span_v = span_at(knots_v, first_v, last_v, span_v, t, left_v)
        basis_derivatives_at(degree_u, knots_u, span_u, s, levels_u, by_u)
        basis_derivatives_at(degree_v, knots_v, span_v, t, levels_v, by_v)
        work[:] = 0.0
        for a in range(orders):
            row[:] = 0.0
            for i in range(degree_u + 1):
                for j in range(degree_v + 1):
                    for axis in range(width):
                        row[j, axis] += by_u[a, i] * net[span_u - degree_u + i, span_v - degree_v + j, axis]
            for b in range(orders - a):
                for j in range(degree_v + 1):
                    for axis in range(width):
                        work[a, b, axis] += by_v[b, j] * row[j, axis]
        if rational:
            quotient_2d(work, dimension)
        for a in range(orders):
            for b in range(orders):
                for axis in range(dimension):
                    out[a, b, k, axis] = work[a, b, axis]
