"""Many curves in one call: flat arrays, one compiled loop over all of them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import TypeAlias, TypeGuard

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from planner.nurbs.arc_length import ArcLengths
from planner.nurbs.basis import Side
from planner.nurbs.bezier import BezierPieces, homogeneous_rows
from planner.nurbs.bounds import boxes_of_pieces
from planner.nurbs.closest import ClosestTree, checked_points
from planner.nurbs.curve import Curve
from planner.nurbs.evaluation import fill_derivatives, fill_points
from planner.nurbs.sampling import parameters_of_pieces

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]
Parameters: TypeAlias = ArrayLike  # for all curves, or a list of one array per curve


class CurveSet:
    """Some curves of one dimension, of any degrees, rational or not, to be worked on together.

    curves : kept as they are; flat copies are made of their knots and control points
    Wherever parameters, lengths or points are asked for, give one array for all curves, or a list of one per curve.
    Raises ValueError if there is no curve or the dimensions differ.
    """

    def __init__(self, curves: Sequence[Curve]) -> None:
        if not curves:
            raise ValueError("no curves")
        self.curves = tuple(curves)
        self.dimension = curves[0].dimension
        if any(curve.dimension != self.dimension for curve in curves):
            raise ValueError("curves of different dimensions cannot be handled in one call")
        self._rational = any(curve.weights is not None for curve in curves)
        rows = [homogeneous_rows(curve) if self._rational else curve.control_points for curve in curves]
        self._degrees = np.array([curve.degree for curve in curves], dtype=np.intp)
        self._knots = np.concatenate([curve.knots for curve in curves])
        self._rows = np.concatenate(rows)
        self._row_at = _edges([len(row) for row in rows])

    def evaluate(self, u: Parameters, side: Side = "right") -> list[Floats]:
        """Points of each curve: (k_i, d) float, mm, each. Raises ValueError if a parameter leaves its curve's domain.

        Source: Piegl & Tiller A3.1, A4.1.
        """
        flat, first = self._per_curve(u)
        points = np.empty((len(flat), self.dimension))
        spline = (self._degrees, self._knots, self._rows, self._row_at, self._rational)
        self._refuse(_evaluate_all(*spline, flat, first, side == "left", points), flat, first)
        return _parts(points, first)

    def derivatives(self, u: Parameters, order: int, side: Side = "right") -> list[Floats]:
        """Derivatives 0 ... order of each curve: (order+1, k_i, d) float each. Raises ValueError as `evaluate`.

        Source: Piegl & Tiller A3.4, A4.2.
        """
        flat, first = self._per_curve(u)
        result = np.empty((order + 1, len(flat), self.dimension))
        spline = (self._degrees, self._knots, self._rows, self._row_at, self._rational)
        self._refuse(_derive_all(*spline, flat, first, side == "left", result), flat, first)
        return [result[:, low:high] for low, high in pairwise(first.tolist())]

    @property
    def lengths(self) -> Floats:
        """(c,) float, mm   Arc length of each curve."""
        return self._lengths.totals

    def arc_length(self, u: Parameters) -> list[Floats]:
        """Arc length of each curve from its start to the parameters: (k_i,) float, mm, each."""
        flat, first = self._per_curve(u)
        low = np.repeat([curve.knots[0] for curve in self.curves], np.diff(first))
        high = np.repeat([curve.knots[-1] for curve in self.curves], np.diff(first))
        return _parts(self._lengths.length_at(_owners(first), np.clip(flat, low, high)), first)

    def at_arc_length(self, s: Parameters) -> list[Floats]:
        """Parameter of each curve at the arc lengths from its start (clipped to 0 ... length): (k_i,) float each."""
        flat, first = self._per_curve(s)
        return _parts(self._lengths.parameter_at(_owners(first), flat), first)

    def sample(self, chord_tolerance_mm: float) -> list[Floats]:
        """Parameters of each curve, ends and knots included, between which chords stay within the tolerance."""
        u, first = parameters_of_pieces(self.pieces, chord_tolerance_mm)
        return _parts(u, first)

    def bounding_boxes(self) -> tuple[Floats, Floats]:
        """Smallest and largest coordinates of each curve itself: two (c, d) float, mm."""
        return boxes_of_pieces(self.pieces)

    def closest_points(self, points: ArrayLike) -> tuple[list[Floats], list[Floats]]:
        """Parameter of, and distance to, each curve's point nearest to the points: lists of (k_i,) float.

        points : one (k, d) float for all curves, or a list of one (k_i, d) per curve, mm
        Raises ValueError as `closest.closest_points`.
        """
        given: list[ArrayLike] = list(points) if _is_list_of_arrays(points) else [points] * len(self.curves)
        if len(given) != len(self.curves):
            raise ValueError(f"{len(given)} sets of points for {len(self.curves)} curves")
        goals = [checked_points(part, self.dimension) for part in given]
        first = _edges([len(goal) for goal in goals])
        u, distance = self._tree.nearest(_owners(first), np.concatenate(goals))
        return _parts(u, first), _parts(distance, first)

    @cached_property
    def pieces(self) -> BezierPieces:
        """All curves as Bézier pieces."""
        return BezierPieces.from_curves(self.curves)

    @cached_property
    def _lengths(self) -> ArcLengths:
        return ArcLengths(self.pieces)

    @cached_property
    def _tree(self) -> ClosestTree:
        return ClosestTree(self.pieces)

    def _per_curve(self, u: Parameters) -> tuple[Floats, Indices]:
        """Flat parameters and where each curve's begin."""
        if _is_list_of_arrays(u):
            parts = [np.asarray(part, dtype=np.float64).reshape(-1) for part in u]
            if len(parts) != len(self.curves):
                raise ValueError(f"{len(parts)} sets of parameters for {len(self.curves)} curves")
            return np.concatenate(parts), _edges([len(part) for part in parts])
        one = np.asarray(u, dtype=np.float64).reshape(-1)
        return np.tile(one, len(self.curves)), np.arange(len(self.curves) + 1) * len(one)

    def _refuse(self, bad: int, flat: Floats, first: Indices) -> None:
        if bad >= 0:
            index = int(np.searchsorted(first, bad, side="right")) - 1
            low, high = self.curves[index].domain
            raise ValueError(f"the parameter {flat[bad]:g} leaves the domain ({low:g}, {high:g}) of curve {index}")


def evaluate_many(curves: Sequence[Curve], u: Parameters) -> list[Floats]:
    """Points of many curves: see `CurveSet.evaluate`."""
    return CurveSet(curves).evaluate(u)


def derivatives_many(curves: Sequence[Curve], u: Parameters, order: int) -> list[Floats]:
    """Derivatives of many curves: see `CurveSet.derivatives`."""
    return CurveSet(curves).derivatives(u, order)


def lengths_many(curves: Sequence[Curve]) -> Floats:
    """(c,) float, mm   Arc lengths of many curves."""
    return ArcLengths(BezierPieces.from_curves(curves)).totals


def sample_many(curves: Sequence[Curve], chord_tolerance_mm: float) -> list[Floats]:
    """Points (k_i, d) of many curves, between which chords stay within the tolerance: `CurveSet.sample`, evaluated."""
    together = CurveSet(curves)
    return together.evaluate(together.sample(chord_tolerance_mm))


def bounding_boxes_many(curves: Sequence[Curve]) -> tuple[Floats, Floats]:
    """Smallest and largest coordinates of many curves: two (c, d) float, mm."""
    return boxes_of_pieces(BezierPieces.from_curves(curves))


def closest_points_many(curves: Sequence[Curve], points: ArrayLike) -> tuple[list[Floats], list[Floats]]:
    """Nearest points of many curves: see `CurveSet.closest_points`."""
    return CurveSet(curves).closest_points(points)


def _parts(flat: Floats, first: Indices) -> list[Floats]:
    """Each curve's share of a flat array."""
    return [flat[low:high] for low, high in pairwise(first.tolist())]


def _is_list_of_arrays(values: object) -> TypeGuard[Sequence[Floats]]:
    """Whether this is a list of one array per curve rather than one array for all."""
    return isinstance(values, list | tuple) and len(values) > 0 and isinstance(values[0], np.ndarray)


def _edges(counts: Sequence[int]) -> Indices:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.intp)


def _owners(first: Indices) -> Indices:
    return np.repeat(np.arange(len(first) - 1, dtype=np.intp), np.diff(first))


@njit(cache=True, error_model="numpy", nogil=True)
def _evaluate_all(
    degrees: Indices, knots: Floats, rows: Floats, row_at: Indices, rational: bool,
    u: Floats, first: Indices, left: bool, points: Floats,
) -> int:  # fmt: skip
    """fill_points for every curve; index of a parameter outside, or -1."""
    knot = 0
    for curve in range(len(degrees)):
        a, b, low, high = row_at[curve], row_at[curve + 1], first[curve], first[curve + 1]
        count = b - a + degrees[curve] + 1
        own = knots[knot : knot + count]
        bad = fill_points(degrees[curve], own, rows[a:b], rational, u[low:high], left, points[low:high])
        if bad >= 0:
            return int(low + bad)
        knot += count
    return -1


@njit(cache=True, error_model="numpy", nogil=True)
def _derive_all(
    degrees: Indices, knots: Floats, rows: Floats, row_at: Indices, rational: bool,
    u: Floats, first: Indices, left: bool, result: Floats,
) -> int:  # fmt: skip
    """fill_derivatives for every curve; index of a parameter outside, or -1."""
    knot = 0
    for curve in range(len(degrees)):
        a, b, low, high = row_at[curve], row_at[curve + 1], first[curve], first[curve + 1]
        count = b - a + degrees[curve] + 1
        own = knots[knot : knot + count]
        bad = fill_derivatives(degrees[curve], own, rows[a:b], rational, u[low:high], left, result[:, low:high])
        if bad >= 0:
            return int(low + bad)
        knot += count
    return -1
