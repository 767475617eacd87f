"""Changing a spline's knots and degree without changing the curve, all by blossoming (polar forms).

The blossom f(t1 ... tp) of one polynomial piece is the one symmetric function, affine in each argument, with
f(t ... t) = C(t). Every control point, before and after any of these operations, is a value of it.
Source: Ramshaw, Blossoms are polar forms, CAGD 6 (1989); results are those of Piegl & Tiller A5.1, A5.4, A5.6, A5.9.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.nurbs.basis import find_spans

Floats = NDArray[np.float64]


def blossom(degree: int, knots: Floats, points: Floats, spans: NDArray[np.intp], arguments: Floats) -> Floats:
    """Blossom values of the polynomial pieces on the given spans.

    points    : (n, d) float   Control points.
    spans     : (k,) int       A non-empty span each.
    arguments : (k, degree) float
    Returns (k, d) float.
    """
    offsets = np.arange(degree + 1)
    rows = spans[:, None] - degree + offsets
    net = points[rows]
    for r in range(1, degree + 1):
        low = knots[rows[:, r:]]
        high = knots[rows[:, r:] + degree - r + 1]
        ratio = ((arguments[:, r - 1 : r] - low) / (high - low))[:, :, None]
        net[:, r:] = (1.0 - ratio) * net[:, r - 1 : -1] + ratio * net[:, r:]
    return np.asarray(net[:, degree], dtype=np.float64)


def bezier_pieces(degree: int, knots: Floats, points: Floats) -> tuple[Floats, Floats]:
    """The Bézier control points of every non-empty span.

    Returns (edges (s+1,) float: the distinct knots, pieces (s, degree+1, d) float). Source: Piegl & Tiller A5.6.
    """
    count = len(points)
    spans = np.arange(degree, count)
    spans = spans[knots[spans + 1] > knots[spans]]
    low, high = knots[spans], knots[spans + 1]
    pieces = np.empty((len(spans), degree + 1, points.shape[1]))
    for j in range(degree + 1):
        arguments = np.where(np.arange(degree) < degree - j, low[:, None], high[:, None])
        pieces[:, j] = blossom(degree, knots, points, spans, arguments)
    return np.append(low, high[-1]), pieces


def insert_knots(degree: int, knots: Floats, points: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Knots and control points after inserting the values (repeats raise the multiplicity); the curve stays.

    values : (k,) float   Inside the domain, in any order.
    Returns (knots (m+k,), points (n+k, d)).
    Raises ValueError if a value lies outside the domain or a multiplicity would exceed the degree.
    Source: Piegl & Tiller A5.4.
    """
    values = np.asarray(values, dtype=np.float64)
    if values.size == 0:
        return knots, points
    if values.min() <= knots[0] or values.max() >= knots[-1]:
        raise ValueError(f"knots can be inserted only inside ({knots[0]:g}, {knots[-1]:g})")
    refined = np.sort(np.concatenate([knots, values]))
    if np.any((refined[degree + 1 :] == refined[: -degree - 1])[1:-1]):
        raise ValueError(f"a knot would have a multiplicity above the degree {degree}")
    arguments = np.lib.stride_tricks.sliding_window_view(refined[1:-1], degree)
    spans = _central_spans(degree, knots, refined, degree + 1)
    return refined, blossom(degree, knots, points, spans, arguments)


def elevate_degree(degree: int, knots: Floats, points: Floats, times: int = 1) -> tuple[int, Floats, Floats]:
    """Degree, knots and control points of the same curve with its degree raised by `times`.

    Source: Piegl & Tiller ch. 5.5 (the values of A5.9).
    """
    for _ in range(times):
        distinct, multiplicity = np.unique(knots, return_counts=True)
        raised = np.repeat(distinct, multiplicity + 1)
        arguments = np.lib.stride_tricks.sliding_window_view(raised[1:-1], degree + 1)
        spans = _central_spans(degree, knots, raised, degree + 2)
        total = np.zeros((len(arguments), points.shape[1]))
        for skipped in range(degree + 1):
            total += blossom(degree, knots, points, spans, np.delete(arguments, skipped, axis=1))
        points, knots, degree = total / (degree + 1), raised, degree + 1
    return degree, knots, points


def _central_spans(degree: int, knots: Floats, refined: Floats, window: int) -> NDArray[np.intp]:
    """For each new control point, the old span under the widest interval of its support (any is exact)."""
    widths = np.lib.stride_tricks.sliding_window_view(np.diff(refined), window)
    at = np.arange(len(widths)) + np.argmax(widths, axis=1)
    return find_spans(degree, knots, 0.5 * (refined[at] + refined[at + 1]))


def multiplicity(knots: Floats, value: float) -> int:
    """How often the value stands in the knot vector."""
    return int(np.searchsorted(knots, value, side="right") - np.searchsorted(knots, value, side="left"))


def missing_knots(knots: Floats, wanted: Floats) -> Floats:
    """The values (with repeats) that must be inserted into `knots` for it to hold `wanted`: (k,) float."""
    distinct, counts = np.unique(wanted, return_counts=True)
    have = np.searchsorted(knots, distinct, side="right") - np.searchsorted(knots, distinct, side="left")
    return np.repeat(distinct, np.maximum(counts - have, 0))
