"""The NURBS surface: two degrees, two clamped knot vectors, a net of control points and (for quadrics) weights."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.nurbs import knots as knot_work
from planner.nurbs.basis import Side
from planner.nurbs.curve import Curve
from planner.nurbs.evaluation import outside
from planner.nurbs.removal import remove_knots
from planner.nurbs.surface_bounds import box_of_patches
from planner.nurbs.surface_closest import PatchTree
from planner.nurbs.surface_evaluation import fill_basis, fill_grid, fill_surface_derivatives
from planner.nurbs.surface_patches import BezierPatches

Floats = NDArray[np.float64]
Axis = Literal["u", "v"]


@dataclass(frozen=True, eq=False)
class Surface:
    """A tensor product NURBS surface of any degrees in space (mm).

    degree_u, degree_v : >= 1
    knots_u, knots_v   : float             Not decreasing, clamped.
    control_points     : (n, m, d) float   n = len(knots_u) - degree_u - 1 along u, m along v.
    weights            : (n, m) float or None   Positive; None where all are 1.
    Raises ValueError if these do not fit together.
    Source: Piegl & Tiller ch. 3.4 and 4.4. Book letters: U, V = knots, P = control points, w = weights.
    """

    degree_u: int
    degree_v: int
    knots_u: Floats
    knots_v: Floats
    control_points: Floats
    weights: Floats | None = None

    def __post_init__(self) -> None:
        for name in ("knots_u", "knots_v", "control_points", "weights"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=np.float64))
        net = self.control_points
        if net.ndim != 3:
            raise ValueError(f"control points {net.shape} are not a net (n, m, d)")
        for degree, knots, count in (
            (self.degree_u, self.knots_u, len(net)),
            (self.degree_v, self.knots_v, net.shape[1]),
        ):
            if degree < 1 or len(knots) != count + degree + 1 or count <= degree:
                raise ValueError(f"{len(knots)} knots, {count} control points and degree {degree} make no surface")
            clamped = knots[0] == knots[degree] < knots[-degree - 1] == knots[-1]
            if not clamped or not np.all(knots[1:] >= knots[:-1]):
                raise ValueError("knots must be clamped and must not decrease")
        if self.weights is not None and (self.weights.shape != net.shape[:2] or not np.all(self.weights > 0.0)):
            raise ValueError("weights must be positive, one per control point")

    @classmethod
    def from_homogeneous(
        cls, degree_u: int, degree_v: int, knots_u: Floats, knots_v: Floats, net: Floats, rational: bool
    ) -> Surface:
        """The surface of a homogeneous net as `homogeneous` gives it."""
        if not rational:
            return cls(degree_u, degree_v, knots_u, knots_v, net)
        return cls(degree_u, degree_v, knots_u, knots_v, net[..., :-1] / net[..., -1:], net[..., -1])

    @property
    def dimension(self) -> int:
        """Number of coordinates of a point."""
        return int(self.control_points.shape[2])

    @property
    def domain(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """First and last u, first and last v."""
        u, v = self.knots_u, self.knots_v
        return (float(u[0]), float(u[-1])), (float(v[0]), float(v[-1]))

    @cached_property
    def homogeneous(self) -> Floats:
        """(n, m, d) control points, or (n, m, d+1) rows (w P, w) where there are weights (Piegl & Tiller Eq. 4.15)."""
        if self.weights is None:
            return self.control_points
        return np.concatenate([self.control_points * self.weights[..., None], self.weights[..., None]], axis=2)

    def evaluate(self, u: ArrayLike, v: ArrayLike) -> Floats:
        """Points at pairs of parameters: (k, d) float, mm; a number stands for k equal ones.

        Raises ValueError if a parameter lies outside the domain. Source: Piegl & Tiller A3.5, A4.3.
        """
        return np.asarray(self.derivatives(u, v, 0)[0, 0])

    def evaluate_grid(self, u: ArrayLike, v: ArrayLike) -> Floats:
        """Points at every pair of one u and one v: (ku, kv, d) float, mm.

        Raises ValueError if a parameter lies outside the domain. Source: Piegl & Tiller A3.5, A4.3.
        """
        one, other = self._checked(u, "u"), self._checked(v, "v")
        result = np.empty((len(one), len(other), self.dimension))
        basis = (self.degree_u, self.degree_v, self.knots_u, self.knots_v)
        fill_grid(*basis, self.homogeneous, self.weights is not None, one, other, result)
        return result

    def derivatives(
        self, u: ArrayLike, v: ArrayLike, order: int, sides: tuple[Side, Side] = ("right", "right")
    ) -> Floats:
        """Derivatives at pairs of parameters: (order+1, order+1, k, d) float; [a, b] is derived a times by u, b by v.

        Those with a + b > order are zero.   sides : which one-sided derivative counts at a knot, for u and for v.
        Raises ValueError if a parameter lies outside the domain. Source: Piegl & Tiller A3.6, A4.4.
        """
        one, other = self._pairs(u, v)
        result = np.empty((order + 1, order + 1, len(one), self.dimension))
        basis = (self.degree_u, self.degree_v, self.knots_u, self.knots_v)
        left = (sides[0] == "left", sides[1] == "left")
        fill_surface_derivatives(*basis, self.homogeneous, self.weights is not None, one, other, *left, result)
        return result

    def bounding_box(self) -> tuple[Floats, Floats]:
        """Smallest and largest coordinates of the surface itself: two (d,) float, mm."""
        return box_of_patches(self.patches)

    def isocurve(self, axis: Axis, value: float) -> Curve:
        """The curve on the surface where u (or v) has the value; its parameter is the other one.

        Raises ValueError if the value lies outside the domain. Source: Piegl & Tiller Eq. 3.15, ch. 4.4.
        """
        at = self._checked(value, axis)
        degree, knots = (self.degree_u, self.knots_u) if axis == "u" else (self.degree_v, self.knots_v)
        spans, basis = np.empty(1, dtype=np.intp), np.empty((1, degree + 1))
        fill_basis(degree, knots, at, spans, basis)
        rows = np.tensordot(basis[0], self._rows(axis)[spans[0] - degree : spans[0] + 1], axes=1)
        other = (self.degree_v, self.knots_v) if axis == "u" else (self.degree_u, self.knots_u)
        return Curve.from_homogeneous(*other, rows, self.weights is not None)

    def with_knots(self, axis: Axis, values: ArrayLike) -> Surface:
        """The same surface with more knots in u or v. Raises ValueError as `knots.insert_knots`. Source: A5.3, A5.5."""
        added = np.atleast_1d(np.asarray(values, dtype=np.float64))
        net = self._rows(axis)
        degree, knots = self._basis(axis)
        knots, rows = knot_work.insert_knots(degree, knots, net.reshape(len(net), -1), added)
        return self._with(axis, degree, knots, rows.reshape(len(rows), *net.shape[1:]))

    def with_degree(self, axis: Axis, degree: int) -> Surface:
        """The same surface with a higher degree in u or v. Raises ValueError if it is lower. Source: A5.10."""
        current, knots = self._basis(axis)
        if degree < current:
            raise ValueError(f"the degree in {axis} cannot be lowered from {current} to {degree}")
        net = self._rows(axis)
        raised = knot_work.elevate_degree(current, knots, net.reshape(len(net), -1), degree - current)
        return self._with(axis, raised[0], raised[1], raised[2].reshape(len(raised[2]), *net.shape[1:]))

    def without_knots(self, tolerance_mm: float) -> tuple[Surface, float]:
        """The surface with fewer knots, and how far it has moved at most (proven, at equal parameters).

        Half of the tolerance is spent on u, what is left of it on v. Raises ValueError if it is negative.
        Source: Piegl & Tiller A5.8, A9.9 on rows of the net; see `removal.remove_knots`.
        """
        surface, moved = self, 0.0
        axes: tuple[Axis, Axis] = ("u", "v")
        for axis, share in zip(axes, (0.5, 1.0), strict=True):
            degree, knots = surface._basis(axis)
            allowed = share * tolerance_mm - moved
            knots, net, bound = remove_knots(degree, knots, surface._rows(axis), allowed, self.weights is not None)
            surface, moved = surface._with(axis, degree, knots, net), moved + bound
        return surface, moved

    def split(self, axis: Axis, values: ArrayLike) -> tuple[Surface, ...]:
        """The parts before, between and after the parameters, each on its share of the domain.

        Raises ValueError if one is not inside the domain. Source: Piegl & Tiller ch. 5.3.
        """
        net = self._rows(axis)
        degree, knots = self._basis(axis)
        parts = Curve(degree, knots, net.reshape(len(net), -1)).split(values)
        return tuple(self._with(axis, degree, p.knots, p.control_points.reshape(-1, *net.shape[1:])) for p in parts)

    def reversed(self, axis: Axis) -> Surface:
        """The same surface run the other way in u or v, same domain; its normals turn round."""
        degree, knots = self._basis(axis)
        return self._with(axis, degree, knots[0] + knots[-1] - knots[::-1], self._rows(axis)[::-1])

    def transposed(self) -> Surface:
        """The same surface with u and v exchanged; its normals turn round."""
        weights = None if self.weights is None else self.weights.T
        net = self.control_points.transpose(1, 0, 2)
        return Surface(self.degree_v, self.degree_u, self.knots_v, self.knots_u, net, weights)

    def transformed(self, target_from_source: ArrayLike) -> Surface:
        """The surface in another frame. target_from_source : (4, 4) float, affine. Raises ValueError for other shapes."""
        matrix = np.asarray(target_from_source, dtype=np.float64)
        size = self.dimension
        if matrix.shape != (size + 1, size + 1):
            raise ValueError(f"a {matrix.shape} matrix does not fit a surface in {size} dimensions")
        moved = self.control_points @ matrix[:size, :size].T + matrix[:size, size]
        return Surface(self.degree_u, self.degree_v, self.knots_u, self.knots_v, moved, self.weights)

    @cached_property
    def patches(self) -> BezierPatches:
        """The surface as Bézier patches (A5.7)."""
        basis = (self.degree_u, self.degree_v, self.knots_u, self.knots_v)
        return BezierPatches.from_net(*basis, self.homogeneous, self.weights is not None)

    @cached_property
    def closest_tree(self) -> PatchTree:
        """What `surface_closest.closest_on_surface` searches."""
        return PatchTree(self.patches)

    def _basis(self, axis: Axis) -> tuple[int, Floats]:
        return (self.degree_u, self.knots_u) if axis == "u" else (self.degree_v, self.knots_v)

    def _rows(self, axis: Axis) -> Floats:
        """The homogeneous net with the axis first."""
        return self.homogeneous if axis == "u" else np.ascontiguousarray(self.homogeneous.transpose(1, 0, 2))

    def _with(self, axis: Axis, degree: int, knots: Floats, rows: Floats) -> Surface:
        """The surface with another basis in u or v, from rows as `_rows` gives them."""
        rational = self.weights is not None
        if axis == "u":
            return Surface.from_homogeneous(degree, self.degree_v, knots, self.knots_v, rows, rational)
        net = rows.transpose(1, 0, 2)
        return Surface.from_homogeneous(self.degree_u, degree, self.knots_u, knots, net, rational)

    def _checked(self, values: ArrayLike, axis: Axis) -> Floats:
        at = np.ascontiguousarray(values, dtype=np.float64).reshape(-1)
        knots = self._basis(axis)[1]
        bad = outside(knots, at)
        if bad >= 0:
            raise ValueError(f"{axis} = {at[bad]:g} leaves the domain ({knots[0]:g}, {knots[-1]:g})")
        return at

    def _pairs(self, u: ArrayLike, v: ArrayLike) -> tuple[Floats, Floats]:
        one, other = np.broadcast_arrays(self._checked(u, "u"), self._checked(v, "v"))
        return np.ascontiguousarray(one), np.ascontiguousarray(other)
