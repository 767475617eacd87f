"""Ruled surfaces between two curves: the straight side walls of a layer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import FitError
from planner.nurbs.curve import Curve
from planner.nurbs.knots import missing_knots
from planner.nurbs.surface import Surface

Floats = NDArray[np.float64]

_SAME_KNOT = 1e-12  # knots of two curves on (0, 1) closer than this are one


@dataclass(frozen=True, eq=False)
class RuledSurface:
    """All straight lines between points of equal parameter: r(u, v) = (1 - v) r0(u) + v r1(u).

    curve0, curve1 : the directrices, 3-D; kept on the domain (0, 1) with common degree and knots.
    Which points belong together is the curves' parametrisation: matching them is the caller's task.
    Raises FitError if the curves are not 3-D.
    Source: paper Eq. 19; Piegl & Tiller ch. 8.3.
    """

    curve0: Curve
    curve1: Curve

    def __post_init__(self) -> None:
        if self.curve0.dimension != 3 or self.curve1.dimension != 3:
            raise FitError("a ruled surface needs two curves in space")
        first, second = on_common_basis(self.curve0, self.curve1)
        object.__setattr__(self, "curve0", first)
        object.__setattr__(self, "curve1", second)

    def evaluate(self, u: ArrayLike, v: ArrayLike) -> Floats:
        """Points at pairs of parameters: (k, 3) float, mm, for (k,) u and (k,) or scalar v in 0 ... 1."""
        share = np.broadcast_to(np.asarray(v, dtype=np.float64), np.shape(np.atleast_1d(u)))[:, None]
        return (1.0 - share) * self.curve0.evaluate(u) + share * self.curve1.evaluate(u)

    def rulings(self, u: ArrayLike) -> Floats:
        """Unit direction from curve0 to curve1 at each u: (k, 3) float.

        Raises FitError where the directrices meet: a ruling of no length has no direction.
        """
        vectors = self.curve1.evaluate(u) - self.curve0.evaluate(u)
        length = np.linalg.norm(vectors, axis=1)
        if np.any(length <= 0.0):
            at = float(np.atleast_1d(u)[int(np.argmin(length))])
            raise FitError(f"the directrices meet at u = {at:.6g}: the ruling has no direction")
        return np.asarray(vectors / length[:, None])

    def normals(self, u: ArrayLike, v: ArrayLike) -> Floats:
        """Unit normal r_u x r_v at pairs of parameters: (k, 3) float; zero where the surface has none."""
        share = np.broadcast_to(np.asarray(v, dtype=np.float64), np.shape(np.atleast_1d(u)))[:, None]
        along = (1.0 - share) * self.curve0.derivatives(u, 1)[1] + share * self.curve1.derivatives(u, 1)[1]
        across = self.curve1.evaluate(u) - self.curve0.evaluate(u)
        normal = np.cross(along, across)
        length = np.linalg.norm(normal, axis=1)[:, None]
        return np.asarray(np.divide(normal, length, out=np.zeros_like(normal), where=length > 0.0))

    def twist(self, u: ArrayLike) -> Floats:
        """Angle between the surface normals at both ends of each ruling: (k,) float, rad, 0 ... pi.

        Zero everywhere on a developable surface: a cylinder's side can mill it without a cut into it.
        """
        first, second = self.normals(u, 0.0), self.normals(u, 1.0)
        apart, together = np.linalg.norm(first - second, axis=1), np.linalg.norm(first + second, axis=1)
        return np.asarray(2.0 * np.arctan2(apart, together))

    def as_surface(self) -> Surface:
        """The same surface as a tensor product of degree (p, 1): u as here, v = 0 on curve0, v = 1 on curve1.

        Where the weights of both curves at one u differ, v runs unevenly along that ruling, which is the same line.
        Source: paper Eq. 19; Piegl & Tiller Eq. 8.15.
        """
        first, second = self.curve0, self.curve1
        net = np.stack([first.control_points, second.control_points], axis=1)
        weights = None
        if first.weights is not None or second.weights is not None:
            weights = np.stack([np.ones(len(net)) if c.weights is None else c.weights for c in (first, second)], axis=1)
        across = np.array([0.0, 0.0, 1.0, 1.0])
        return Surface(first.degree, 1, first.knots, across, net, weights)


def on_common_basis(first: Curve, second: Curve) -> tuple[Curve, Curve]:
    """Both curves on (0, 1) with the higher of both degrees and the knots of both; their shapes stay.

    Source: Piegl & Tiller ch. 8.3 (degree elevation, then the union of the knots).
    """
    degree = max(first.degree, second.degree)
    one = first.with_domain(0.0, 1.0).with_degree(degree)
    other = second.with_domain(0.0, 1.0).with_degree(degree)
    other = _with_knots_snapped(other, one.knots)
    for_one, for_other = missing_knots(one.knots, other.knots), missing_knots(other.knots, one.knots)
    return one.with_knots(for_one), other.with_knots(for_other)


def _with_knots_snapped(curve: Curve, knots: Floats) -> Curve:
    """The curve with knots that differ from the given ones only by rounding set equal to them."""
    distinct = np.unique(knots)
    index = np.clip(np.searchsorted(distinct, curve.knots), 1, len(distinct) - 1)
    lower, upper = distinct[index - 1], distinct[index]
    nearest = np.where(curve.knots - lower < upper - curve.knots, lower, upper)
    snapped = np.where(np.abs(curve.knots - nearest) <= _SAME_KNOT, nearest, curve.knots)
    return Curve(curve.degree, snapped, curve.control_points, curve.weights)
