"""Curves as flat arrays of Bézier pieces, and the compiled steps on one piece: value, derivatives, halves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.nurbs.evaluation import quotient

if TYPE_CHECKING:
    from planner.nurbs.curve import Curve

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class BezierPieces:
    """All polynomial pieces of some curves, one curve after the other.

    nets     : (s, p+1, D) float   Control points, homogeneous rows (w P, w) if `rational`; p is the highest degree,
                                   a piece of lower degree q uses its first q+1 rows.
    degrees  : (s,) int
    low, high: (s,) float          Parameters at the ends of each piece.
    first    : (c+1,) int          Curve i owns the pieces first[i] ... first[i+1]-1.
    rational : whether any of the curves has weights
    """

    nets: Floats
    degrees: Indices
    low: Floats
    high: Floats
    first: Indices
    rational: bool

    @property
    def dimension(self) -> int:
        """Number of coordinates of a point."""
        return int(self.nets.shape[2]) - self.rational

    @classmethod
    def from_curves(cls, curves: Sequence[Curve]) -> BezierPieces:
        """The pieces of the curves (A5.6). Raises ValueError if there is none or their dimensions differ."""
        if not curves:
            raise ValueError("no curves")
        dimension = curves[0].dimension
        if any(curve.dimension != dimension for curve in curves):
            raise ValueError("curves of different dimensions cannot be handled in one call")
        rational = any(curve.weights is not None for curve in curves)
        most = max(curve.degree for curve in curves)
        room = sum(len(curve.control_points) - curve.degree for curve in curves)
        nets = np.zeros((room, most + 1, dimension + rational))
        low, high, degrees = np.empty(room), np.empty(room), np.empty(room, dtype=np.intp)
        first = np.zeros(len(curves) + 1, dtype=np.intp)
        for index, curve in enumerate(curves):
            start = first[index]
            rows = homogeneous_rows(curve) if rational else curve.control_points
            count = _fill_pieces(curve.degree, curve.knots, rows, nets[start:], low[start:], high[start:])
            degrees[start : start + count] = curve.degree
            first[index + 1] = start + count
        count = int(first[-1])
        return cls(nets[:count], degrees[:count], low[:count], high[:count], first, rational)


def homogeneous_rows(curve: Curve) -> Floats:
    """(n, d+1) rows (w P, w), with w = 1 where the curve has no weights (Piegl & Tiller Eq. 4.3)."""
    if curve.weights is not None:
        return curve.homogeneous
    return np.column_stack([curve.control_points, np.ones(len(curve.control_points))])


@njit(cache=True, error_model="numpy", nogil=True)
def _fill_pieces(degree: int, knots: Floats, rows: Floats, nets: Floats, low: Floats, high: Floats) -> int:
    """Bézier points of every non-empty span by blossoming at its ends (the values of A5.6); returns how many."""
    width = rows.shape[1]
    work = np.empty((degree + 1, width))
    found = 0
    for span in range(degree, len(rows)):
        start, end = knots[span], knots[span + 1]
        if not end > start:
            continue
        for point in range(degree + 1):
            for j in range(degree + 1):
                for axis in range(width):
                    work[j, axis] = rows[span - degree + j, axis]
            for r in range(1, degree + 1):
                argument = start if r <= degree - point else end
                for j in range(degree, r - 1, -1):
                    left, right = knots[span - degree + j], knots[span + 1 + j - r]
                    ratio = (argument - left) / (right - left)
                    for axis in range(width):
                        work[j, axis] = (1.0 - ratio) * work[j - 1, axis] + ratio * work[j, axis]
            for axis in range(width):
                nets[found, point, axis] = work[degree, axis]
        low[found], high[found] = start, end
        found += 1
    return found


@njit(cache=True, error_model="numpy", nogil=True)
def bezier_jet(net: Floats, degree: int, t: float, rational: bool, work: Floats, jet: Floats) -> None:
    """Value, first and second derivative by the piece's own parameter t in 0 ... 1, into jet (3, D) (A1.5, A4.2).

    work : (p+1, D) scratch.   Of a rational piece the first D-1 columns are the curve's.
    """
    width = net.shape[1]
    for j in range(degree + 1):
        for axis in range(width):
            work[j, axis] = net[j, axis]
    for r in range(1, degree - 1):
        for j in range(degree + 1 - r):
            for axis in range(width):
                work[j, axis] += t * (work[j + 1, axis] - work[j, axis])
    for axis in range(width):
        if degree == 1:
            slope = work[1, axis] - work[0, axis]
            jet[0, axis] = (1.0 - t) * work[0, axis] + t * work[1, axis]
            jet[1, axis], jet[2, axis] = slope, 0.0
        else:
            c0, c1, c2 = work[0, axis], work[1, axis], work[2, axis]
            b0, b1 = (1.0 - t) * c0 + t * c1, (1.0 - t) * c1 + t * c2
            jet[0, axis] = (1.0 - t) * b0 + t * b1
            jet[1, axis] = degree * (b1 - b0)
            jet[2, axis] = degree * (degree - 1) * ((c2 - c1) - (c1 - c0))
    if rational:
        quotient(jet, 3, width - 1)


@njit(cache=True, error_model="numpy", nogil=True)
def bezier_halves(net: Floats, degree: int, left: Floats, right: Floats) -> None:
    """Both halves of a piece, into left and right (p+1, D); right may be the net itself (de Casteljau, A1.5)."""
    width = net.shape[1]
    for j in range(degree + 1):
        for axis in range(width):
            right[j, axis] = net[j, axis]
    for axis in range(width):
        left[0, axis] = right[0, axis]
    for r in range(1, degree + 1):
        for j in range(degree + 1 - r):
            for axis in range(width):
                right[j, axis] = 0.5 * (right[j, axis] + right[j + 1, axis])
        for axis in range(width):
            left[r, axis] = right[0, axis]
