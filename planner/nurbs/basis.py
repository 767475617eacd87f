"""B-spline basis functions and their derivatives, for many parameters at once."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Side = Literal["left", "right"]


def find_spans(degree: int, knots: Floats, u: Floats, side: Side = "right") -> NDArray[np.intp]:
    """Index i of the non-empty knot span that holds each parameter.

    knots : (m,) float   Clamped, not decreasing.
    u     : (k,) float   Parameters inside the domain.
    side  : at a knot, the span to its right (default) or to its left; the domain's ends belong to the spans inside.
    Returns (k,) int with knots[i] <= u <= knots[i+1], knots[i] < knots[i+1].
    Source: Piegl & Tiller, The NURBS Book, A2.1.
    """
    last = len(knots) - degree - 2
    if side == "right":
        spans = np.searchsorted(knots, u, side="right") - 1
        end = np.searchsorted(knots, knots[-1], side="left") - 1
        return np.asarray(np.clip(spans, degree, min(last, end)), dtype=np.intp)
    spans = np.searchsorted(knots, u, side="left") - 1
    start = np.searchsorted(knots, knots[0], side="right") - 1
    return np.asarray(np.clip(spans, max(degree, start), last), dtype=np.intp)


def basis_functions(degree: int, knots: Floats, spans: NDArray[np.intp], u: Floats) -> Floats:
    """The degree+1 basis functions that do not vanish on each parameter's span.

    spans : (k,) int     From find_spans.
    u     : (k,) float
    Returns (k, degree+1) float: N_{i-p} ... N_i, not negative, each row of sum 1.
    Source: Piegl & Tiller A2.2.
    """
    values = np.zeros((len(u), degree + 1))
    values[:, 0] = 1.0
    for level in range(1, degree + 1):
        saved = np.zeros(len(u))
        for r in range(level):
            right = knots[spans + r + 1] - u
            left = u - knots[spans + 1 - level + r]
            share = values[:, r] / (right + left)
            values[:, r] = saved + right * share
            saved = left * share
        values[:, level] = saved
    return values


def basis_derivatives(degree: int, knots: Floats, spans: NDArray[np.intp], u: Floats, order: int) -> Floats:
    """Derivatives 0 ... order of the basis functions that do not vanish on each parameter's span.

    Returns (order+1, k, degree+1) float; derivatives above the degree are zero.
    Source: Piegl & Tiller Eq. 2.7 applied repeatedly (the values of A2.3).
    """
    result = np.zeros((order + 1, len(u), degree + 1))
    for derivative in range(min(order, degree) + 1):
        values = basis_functions(degree - derivative, knots, spans, u)
        for p in range(degree - derivative + 1, degree + 1):
            values = _raise_derivative(p, knots, spans, values)
        result[derivative] = values
    return result


def _raise_derivative(degree: int, knots: Floats, spans: NDArray[np.intp], lower: Floats) -> Floats:
    """One step of Eq. 2.7: from a derivative of degree p-1 functions to the next derivative of degree p functions."""
    values = np.zeros((len(lower), degree + 1))
    for j in range(1, degree + 1):
        i = spans - degree + j
        share = degree * lower[:, j - 1] / (knots[i + degree] - knots[i])
        values[:, j] += share
        values[:, j - 1] -= share
    return values
