"""True bounding boxes of curves: branch and bound over the control points of ever smaller Bézier pieces."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.nurbs.bezier import BezierPieces, bezier_halves

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

_CLOSE = 4e-15  # share of the largest coordinate below which hull and curve count as the same
_DEPTH = 60  # halvings: a piece is then shorter than rounding


def boxes_of_pieces(pieces: BezierPieces) -> tuple[Floats, Floats]:
    """Smallest and largest coordinates of each curve itself: two (c, d) float, mm, to rounding.

    A piece lies in the hull of its control points (weights are positive) and touches its two ends; pieces whose hull
    reaches no further than what was found are dropped, others halved. Source: Piegl & Tiller P3.5 / P4.3, A1.5.
    """
    return _boxes(pieces.nets, pieces.degrees, pieces.rational, pieces.first)


@njit(cache=True, error_model="numpy", nogil=True)
def _boxes(nets: Floats, degrees: Indices, rational: bool, first: Indices) -> tuple[Floats, Floats]:
    """Smallest and largest coordinates per curve."""
    curves, dimension = len(first) - 1, nets.shape[2] - int(rational)
    low, high = np.empty((curves, dimension)), np.empty((curves, dimension))
    stack = np.empty((_DEPTH + 2, nets.shape[1], 2))
    depths = np.empty(_DEPTH + 2, dtype=np.intp)
    for curve in range(curves):
        begin, end = first[curve], first[curve + 1]
        for axis in range(dimension):
            high[curve, axis] = _largest(nets[begin:end], degrees[begin:end], rational, axis, 1.0, stack, depths)
            low[curve, axis] = -_largest(nets[begin:end], degrees[begin:end], rational, axis, -1.0, stack, depths)
    return low, high


@njit(cache=True, error_model="numpy", nogil=True)
def _largest(
    nets: Floats, degrees: Indices, rational: bool, axis: int, sign: float, stack: Floats, depths: Indices
) -> float:
    """Largest sign * coordinate of one curve."""
    last = nets.shape[2] - 1
    best, size = -np.inf, 0.0
    for k in range(len(nets)):
        for j in (0, degrees[k]):
            value = sign * nets[k, j, axis] / (nets[k, j, last] if rational else 1.0)
            best, size = max(best, value), max(size, abs(value))
    close = _CLOSE * size
    for k in range(len(nets)):
        degree, height = degrees[k], 1
        for j in range(degree + 1):
            stack[0, j, 0], stack[0, j, 1] = sign * nets[k, j, axis], nets[k, j, last] if rational else 1.0
        depths[0] = 0
        while height > 0:
            top = height - 1
            reach = -np.inf
            for j in range(degree + 1):
                reach = max(reach, stack[top, j, 0] / stack[top, j, 1])
            if reach <= best + close or depths[top] >= _DEPTH:
                height -= 1
                continue
            bezier_halves(stack[top], degree, stack[top + 1], stack[top])
            best = max(best, stack[top, 0, 0] / stack[top, 0, 1])
            depths[top] += 1
            depths[top + 1] = depths[top]
            height += 1
    return best
