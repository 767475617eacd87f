"""The NURBS curve: a degree, clamped knots, control points and (for conics) weights."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.nurbs import knots as knot_work
from planner.nurbs.arc_length import ArcLengths
from planner.nurbs.basis import Side
from planner.nurbs.bezier import BezierPieces
from planner.nurbs.bounds import boxes_of_pieces
from planner.nurbs.closest import ClosestTree
from planner.nurbs.evaluation import fill_derivatives, fill_points, outside
from planner.nurbs.removal import remove_knots
from planner.nurbs.sampling import parameters_within

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Curve:
    """A NURBS curve of any degree in any number of dimensions (2 or 3 in the planner, mm).

    degree         : p >= 1
    knots          : (m,) float       Not decreasing, clamped (p+1 equal knots at both ends).
    control_points : (n, d) float     n = m - p - 1.
    weights        : (n,) float or None   Positive; None where all are 1.
    Raises ValueError if these do not fit together.
    Source: Piegl & Tiller ch. 3 and 4. Book letters: U = knots, P = control_points, w = weights, u = parameter.
    """

    degree: int
    knots: Floats
    control_points: Floats
    weights: Floats | None = None

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        set_field(self, "knots", np.ascontiguousarray(self.knots, dtype=np.float64))
        set_field(self, "control_points", np.ascontiguousarray(self.control_points, dtype=np.float64))
        knots, points, p = self.knots, self.control_points, self.degree
        if points.ndim != 2 or len(knots) != len(points) + p + 1 or p < 1 or len(points) <= p:
            raise ValueError(f"{len(knots)} knots, control points {points.shape} and degree {p} make no curve")
        if not (np.all(knots[1:] >= knots[:-1]) and knots[0] == knots[p] < knots[-p - 1] == knots[-1]):
            raise ValueError("knots must be clamped and must not decrease")
        if self.weights is not None:
            set_field(self, "weights", np.ascontiguousarray(self.weights, dtype=np.float64))
            if self.weights.shape != (len(points),) or not np.all(self.weights > 0.0):
                raise ValueError("weights must be positive, one per control point")

    @classmethod
    def trusted(cls, degree: int, knots: Floats, control_points: Floats, weights: Floats | None = None) -> Curve:
        """The curve of arrays that are known to fit together: C-contiguous float64, clamped, nothing is checked."""
        curve = object.__new__(cls)
        curve.__dict__.update(degree=degree, knots=knots, control_points=control_points, weights=weights)
        return curve

    @classmethod
    def from_polyline(cls, points: ArrayLike, closed: bool = False) -> Curve:
        """The polyline itself as a curve of degree 1, parameter proportional to length, domain (0, 1).

        points : (n, d) float, mm   Neighbours differ.   closed : a last side leads back to the first point.
        Raises ValueError if neighbours coincide.
        """
        path = np.asarray(points, dtype=np.float64)
        path = np.vstack([path, path[:1]]) if closed else path
        reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
        if np.any(np.diff(reached) <= 0.0):
            raise ValueError("a polyline must not repeat a point")
        return cls(1, np.concatenate([[0.0], reached / reached[-1], [1.0]]), path)

    @property
    def dimension(self) -> int:
        """Number of coordinates of a point."""
        return int(self.control_points.shape[1])

    @property
    def domain(self) -> tuple[float, float]:
        """First and last parameter."""
        return float(self.knots[0]), float(self.knots[-1])

    @cached_property
    def breaks(self) -> Floats:
        """(s+1,) float   The distinct knots: ends of the polynomial pieces."""
        return np.unique(self.knots)

    @cached_property
    def homogeneous(self) -> Floats:
        """(n, d) control points, or (n, d+1) rows (w P, w) where there are weights (Piegl & Tiller Eq. 4.3)."""
        if self.weights is None:
            return self.control_points
        return np.column_stack([self.control_points * self.weights[:, None], self.weights])

    @classmethod
    def from_homogeneous(cls, degree: int, knots: Floats, rows: Floats, rational: bool) -> Curve:
        """The curve of homogeneous control points as `homogeneous` gives them."""
        if not rational:
            return cls(degree, knots, rows)
        return cls(degree, knots, rows[:, :-1] / rows[:, -1:], rows[:, -1])

    @property
    def is_closed(self) -> bool:
        """Whether the last point is the first (within 1e-9 of the size)."""
        size = float(np.ptp(self.control_points, axis=0).max())
        return bool(np.abs(self.control_points[-1] - self.control_points[0]).max() <= 1e-9 * size)

    def evaluate(self, u: ArrayLike, side: Side = "right") -> Floats:
        """Points at the parameters: (k, d) float for (k,) u (a scalar counts as one).

        Raises ValueError if a parameter lies outside the domain. Source: Piegl & Tiller A3.1, A4.1.
        """
        at = _parameters(u)
        points = np.empty((len(at), self.control_points.shape[1]))
        rational = self.weights is not None
        bad = fill_points(self.degree, self.knots, self.homogeneous, rational, at, side == "left", points)
        if bad >= 0:
            raise self._outside(at[bad])
        return points

    def derivatives(self, u: ArrayLike, order: int, side: Side = "right") -> Floats:
        """Derivatives 0 ... order by the parameter: (order+1, k, d) float.

        side : which one-sided derivative counts at a knot where the curve is not smooth.
        Raises ValueError if a parameter lies outside the domain. Source: Piegl & Tiller A3.4, A4.2.
        """
        at = _parameters(u)
        result = np.empty((order + 1, len(at), self.control_points.shape[1]))
        rational = self.weights is not None
        bad = fill_derivatives(self.degree, self.knots, self.homogeneous, rational, at, side == "left", result)
        if bad >= 0:
            raise self._outside(at[bad])
        return result

    def curvature(self, u: ArrayLike, side: Side = "right") -> Floats:
        """Curvature, not negative: (k,) float, 1/mm. Infinite where the speed is zero."""
        _, first, second = self.derivatives(u, 2, side)
        speed2 = np.einsum("ij,ij->i", first, first)
        along = np.einsum("ij,ij->i", first, second)
        area2 = np.maximum(speed2 * np.einsum("ij,ij->i", second, second) - along**2, 0.0)
        cubed = speed2**1.5
        return np.asarray(np.divide(np.sqrt(area2), cubed, out=np.full_like(cubed, np.inf), where=cubed > 0.0))

    @property
    def length(self) -> float:
        """Arc length of the whole curve, mm."""
        return float(self._lengths.totals[0])

    def arc_length(self, u: ArrayLike) -> Floats:
        """Arc length from the start to each parameter: (k,) float, mm."""
        at = self._inside(u)
        return self._lengths.length_at(np.zeros(len(at), dtype=np.intp), at)

    def at_arc_length(self, s: ArrayLike) -> Floats:
        """Parameter at each arc length from the start (clipped to 0 ... length): (k,) float."""
        lengths = _parameters(s)
        return self._lengths.parameter_at(np.zeros(len(lengths), dtype=np.intp), lengths)

    def sample(self, chord_tolerance_mm: float) -> Floats:
        """Parameters, ends and knots included, between which the chords stay within the tolerance: (k,) float.

        Raises ValueError if the tolerance is not positive.
        """
        return parameters_within(self, chord_tolerance_mm)

    def bounding_box(self) -> tuple[Floats, Floats]:
        """Smallest and largest coordinates of the curve itself (not of its control points): two (d,) float, mm."""
        low, high = boxes_of_pieces(self.pieces)
        return low[0], high[0]

    def reversed(self) -> Curve:
        """The same curve run the other way, same domain."""
        knots = self.knots[0] + self.knots[-1] - self.knots[::-1]
        weights = None if self.weights is None else self.weights[::-1]
        return Curve(self.degree, knots, self.control_points[::-1], weights)

    def transformed(self, target_from_source: ArrayLike) -> Curve:
        """The curve in another frame; a 4x4 matrix lifts a planar curve to z = 0 first.

        target_from_source : (d+1, d+1) or (4, 4) float, affine   Raises ValueError for other shapes.
        """
        matrix = np.asarray(target_from_source, dtype=np.float64)
        points = self.control_points
        if matrix.shape == (4, 4) and self.dimension == 2:
            points = np.column_stack([points, np.zeros(len(points))])
        size = points.shape[1]
        if matrix.shape != (size + 1, size + 1):
            raise ValueError(f"a {matrix.shape} matrix does not fit a curve in {size} dimensions")
        moved = points @ matrix[:size, :size].T + matrix[:size, size]
        return Curve(self.degree, self.knots, moved, self.weights)

    def with_domain(self, start: float, end: float) -> Curve:
        """The same curve on the parameters start ... end (start < end)."""
        low, high = self.domain
        knots = start + (self.knots - low) * ((end - start) / (high - low))
        knots[self.knots == high] = end
        return Curve(self.degree, knots, self.control_points, self.weights)

    def with_knots(self, values: ArrayLike) -> Curve:
        """The same curve with more knots. Raises ValueError as `knots.insert_knots`. Source: Piegl & Tiller A5.4."""
        added = np.atleast_1d(np.asarray(values, dtype=np.float64))
        knots, rows = knot_work.insert_knots(self.degree, self.knots, self.homogeneous, added)
        return Curve.from_homogeneous(self.degree, knots, rows, self.weights is not None)

    def without_knots(self, tolerance_mm: float, only: ArrayLike | None = None) -> tuple[Curve, float]:
        """The curve with fewer knots, and how far it has moved at most (proven, at equal parameter).

        tolerance_mm : >= 0, how far it may move   only : the knots that may go (default: all inner ones)
        Raises ValueError if the tolerance is negative. Source: Piegl & Tiller A5.8, A9.9; see `removal.remove_knots`.
        """
        rational = self.weights is not None
        net = self.homogeneous[:, None, :]
        knots, net, bound = remove_knots(self.degree, self.knots, net, tolerance_mm, rational, only)
        return Curve.from_homogeneous(self.degree, knots, net[:, 0], rational), bound

    def with_degree(self, degree: int) -> Curve:
        """The same curve of a higher degree. Raises ValueError if it is lower. Source: Piegl & Tiller ch. 5.5."""
        if degree < self.degree:
            raise ValueError(f"the degree cannot be lowered from {self.degree} to {degree}")
        raised = knot_work.elevate_degree(self.degree, self.knots, self.homogeneous, degree - self.degree)
        return Curve.from_homogeneous(*raised, self.weights is not None)

    def split(self, u: ArrayLike) -> tuple[Curve, ...]:
        """The curve before, between and after the parameters, each part on its share of the domain.

        u : (k,) float or a number   In any order; k different parameters give k+1 curves.
        Raises ValueError if one is not inside the domain. Source: Piegl & Tiller ch. 5.3.
        """
        low, high = self.domain
        cuts = np.unique(np.asarray(u, dtype=np.float64))
        if not (cuts.size and np.all((cuts > low) & (cuts < high))):
            raise ValueError(f"cannot split at {cuts}: the domain is ({low:g}, {high:g})")
        p, rational = self.degree, self.weights is not None
        more = np.concatenate([np.full(max(p - knot_work.multiplicity(self.knots, at), 0), at) for at in cuts])
        knots, rows = knot_work.insert_knots(p, self.knots, self.homogeneous, more)
        edges = np.concatenate([[low], cuts, [high]])
        parts = []
        for start, end in pairwise(edges.tolist()):
            first = int(np.searchsorted(knots, start, side="right")) - p - 1
            last = int(np.searchsorted(knots, end, side="left")) - 1
            own = np.concatenate([[start], knots[first + 1 : last + p + 1], [end]])
            parts.append(Curve.from_homogeneous(p, own, rows[first : last + 1], rational))
        return tuple(parts)

    @cached_property
    def pieces(self) -> BezierPieces:
        """The curve as Bézier pieces."""
        return BezierPieces.from_curves([self])

    @cached_property
    def closest_tree(self) -> ClosestTree:
        """What `closest.closest_points` searches."""
        return ClosestTree(self.pieces)

    @cached_property
    def _lengths(self) -> ArcLengths:
        return ArcLengths(self.pieces)

    def _inside(self, u: ArrayLike) -> Floats:
        at = _parameters(u)
        bad = outside(self.knots, at)
        if bad >= 0:
            raise self._outside(at[bad])
        return np.clip(at, self.knots[0], self.knots[-1])

    def _outside(self, u: float) -> ValueError:
        low, high = self.domain
        return ValueError(f"the parameter {u:g} leaves the domain ({low:g}, {high:g})")


def _parameters(u: ArrayLike) -> Floats:
    """The parameters as a flat C-contiguous array."""
    return np.ascontiguousarray(u, dtype=np.float64).reshape(-1)
