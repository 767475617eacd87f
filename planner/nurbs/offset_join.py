"""Pieces of offset curves joined into closed curves, many at once, and how long they are."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.nurbs.curve import Curve

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_STEPS = 4  # chords per piece: the length of an arc of 1.75 rad comes out 0.8 % short


@njit(cache=True, error_model="numpy", nogil=True)
def points_on(nets: Floats) -> Floats:  # pragma: no cover
    """Points at 0, 1/4, ... 1 of each rational cubic piece: (m, 5, 2) float, mm.  nets : (m, 4, 3) x, y, weight."""
    points = np.empty((len(nets), _STEPS + 1, 2))
    for k in range(len(nets)):
        for step in range(_STEPS + 1):
            t = step / _STEPS
            r = 1.0 - t
            b0, b1 = r * r * r, 3.0 * r * r * t * nets[k, 1, 2]
            b2, b3 = 3.0 * r * t * t * nets[k, 2, 2], t * t * t
            w = b0 + b1 + b2 + b3
            for axis in range(2):
                points[k, step, axis] = (
                    b0 * nets[k, 0, axis] + b1 * nets[k, 1, axis] + b2 * nets[k, 2, axis] + b3 * nets[k, 3, axis]
                ) / w
    return points


@njit(cache=True, error_model="numpy", nogil=True)
def reach_of(points: Floats, first: Ints) -> Floats:  # pragma: no cover
    """Length of each run of pieces, (r,) float, mm.  points : of `points_on`   first : (r+1,) int, piece numbers."""
    reach = np.zeros(len(first) - 1)
    for run in range(len(first) - 1):
        for k in range(first[run], first[run + 1]):
            for step in range(points.shape[1] - 1):
                dx = points[k, step + 1, 0] - points[k, step, 0]
                dy = points[k, step + 1, 1] - points[k, step, 1]
                reach[run] += np.sqrt(dx * dx + dy * dy)
    return reach


def joined(nets: Floats, first: Ints) -> list[Curve]:
    """One closed curve through each ring's pieces, parameter about as their lengths, domain (0, 1).

    nets  : (m, 4, 3) float   Control points and weights, 1 at the ends; each piece ends where the ring's next begins,
                              the last at the first.
    first : (r+1,) int        First piece of each ring; none is empty.
    """
    knots, points, weights, is_plain = _joined(nets, first)
    curves = []
    for ring, (low, high) in enumerate(pairwise(first.tolist())):
        net = slice(3 * low + ring, 3 * high + ring + 1)
        own = knots[3 * low + 5 * ring : 3 * high + 5 * (ring + 1)]
        curves.append(Curve.trusted(3, own, points[net], None if is_plain[ring] else weights[net]))
    return curves


@njit(cache=True, error_model="numpy", nogil=True)
def _joined(nets: Floats, first: Ints) -> tuple[Floats, Floats, Floats, NDArray[np.bool_]]:  # pragma: no cover
    """Knots, control points and weights of all rings one after the other, and which have no weight but 1."""
    count = len(first) - 1
    knots = np.empty(3 * len(nets) + 5 * count)
    points, weights = np.empty((3 * len(nets) + count, 2)), np.empty(3 * len(nets) + count)
    is_plain = np.ones(count, dtype=np.bool_)
    for ring in range(count):
        low, high = first[ring], first[ring + 1]
        row, knot, at = 3 * low + ring, 3 * low + 5 * ring, 0.0
        knots[knot] = 0.0
        for k in range(low, high):
            knots[knot + 1 : knot + 4] = at
            for j in range(3):
                points[row, 0], points[row, 1], weights[row] = nets[k, j, 0], nets[k, j, 1], nets[k, j, 2]
                is_plain[ring] &= nets[k, j, 2] == 1.0
                at += np.hypot(nets[k, j + 1, 0] - nets[k, j, 0], nets[k, j + 1, 1] - nets[k, j, 1])
                row += 1
            knot += 3
        points[row, 0], points[row, 1], weights[row] = nets[low, 0, 0], nets[low, 0, 1], 1.0
        knots[3 * low + 5 * ring : knot + 1] /= at
        knots[knot + 1 : knot + 5] = 1.0
    return knots, points, weights, is_plain
