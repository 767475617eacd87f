"""Changing a spline's knots and degree without changing the curve, all by blossoming (polar forms).

The blossom f(t1 ... tp) of one polynomial piece is the one symmetric function, affine in each argument, with
f(t ... t) = C(t). Every control point, before and after any of these operations, is a value of it.
Source: Ramshaw, Blossoms are polar forms, CAGD 6 (1989); results are those of Piegl & Tiller A5.1, A5.4, A5.6, A5.9.
"""

from __future__ import annotations

import numpy as np
from numba import njit
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
        raised, grown = _raised(degree, knots, np.ascontiguousarray(points))
        points, knots, degree = grown, raised, degree + 1
    return degree, knots, points


@njit(cache=True, error_model="numpy", nogil=True)
def _raised(degree: int, knots: Floats, points: Floats) -> tuple[Floats, Floats]:
    """Knots, each once more often, and control points of the degree above.

    The blossom of the raised curve at p + 1 knots is the mean of the old blossom's values with each of them left out,
    on the span under the widest interval of the point's support (any is exact).
    """
    room = np.empty(2 * knots.size)
    found = 0
    for i in range(knots.size):
        room[found] = knots[i]
        found += 1
        if i + 1 == knots.size or knots[i + 1] != knots[i]:
            room[found] = knots[i]
            found += 1
    raised = room[:found].copy()
    count, width = found - degree - 2, points.shape[1]
    grown, net = np.zeros((count, width)), np.empty((degree + 1, width))
    span = degree
    for i in range(count):
        wide = i
        for j in range(i, i + degree + 2):
            if raised[j + 1] - raised[j] > raised[wide + 1] - raised[wide]:
                wide = j
        span = _span_from(knots, span, raised[wide], degree)
        for skipped in range(degree + 1):
            for j in range(degree + 1):
                for axis in range(width):
                    net[j, axis] = points[span - degree + j, axis]
            for r in range(1, degree + 1):
                argument = raised[i + r] if r <= skipped else raised[i + r + 1]
                for j in range(degree, r - 1, -1):
                    low, high = knots[span - degree + j], knots[span + 1 + j - r]
                    share = (argument - low) / (high - low)
                    for axis in range(width):
                        net[j, axis] = (1.0 - share) * net[j - 1, axis] + share * net[j, axis]
            for axis in range(width):
                grown[i, axis] += net[degree, axis] / (degree + 1)
    return raised, grown


@njit(cache=True, error_model="numpy", nogil=True)
def _span_from(knots: Floats, span: int, low: float, degree: int) -> int:
    """The non-empty span that starts at the knot `low`, sought from another span, which it may lie a few before."""
    while span > degree and knots[span] > low:
        span -= 1
    while knots[span] < low or not knots[span + 1] > knots[span]:
        span += 1
    return span


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
