"""A surface as Bézier patches, and the compiled steps on one patch: value and derivatives, halves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.nurbs.knots import bezier_pieces
from planner.nurbs.surface_evaluation import quotient_2d

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BezierPatches:
    """All polynomial patches of a surface.

    nets     : (s, p+1, q+1, D) float   Control points, homogeneous rows (w P, w) if `rational`.
    bounds   : (s, 4) float             First and last u, first and last v of each patch.
    rational : whether there are weights
    """

    nets: Floats
    bounds: Floats
    rational: bool

    @property
    def dimension(self) -> int:
        """Number of coordinates of a point."""
        return int(self.nets.shape[3]) - self.rational

    @classmethod
    def from_net(
        cls, degree_u: int, degree_v: int, knots_u: Floats, knots_v: Floats, net: Floats, rational: bool
    ) -> BezierPatches:
        """The patches of a surface given by its homogeneous net (n, m, D). Source: Piegl & Tiller A5.7."""
        n, m, width = net.shape
        edges_u, strips = bezier_pieces(degree_u, knots_u, net.reshape(n, m * width))
        count = len(strips)
        across = strips.reshape(count * (degree_u + 1), m, width).transpose(1, 0, 2).reshape(m, -1)
        edges_v, pieces = bezier_pieces(degree_v, knots_v, np.ascontiguousarray(across))
        nets = pieces.reshape(len(pieces), degree_v + 1, count, degree_u + 1, width).transpose(2, 0, 3, 1, 4)
        nets = np.ascontiguousarray(nets).reshape(-1, degree_u + 1, degree_v + 1, width)
        u, v = np.repeat(np.arange(count), len(pieces)), np.tile(np.arange(len(pieces)), count)
        bounds = np.column_stack([edges_u[u], edges_u[u + 1], edges_v[v], edges_v[v + 1]])
        return cls(nets, bounds, rational)


@njit(cache=True, error_model="numpy", nogil=True)
def bernstein_jet(degree: int, t: float, values: Floats) -> None:
    """The Bernstein polynomials of a degree and their first and second derivatives, into values (3, p+1) (A1.3)."""
    values[:] = 0.0
    values[0, 0] = 1.0
    for level in range(1, degree + 1):
        if level == degree:
            for j in range(level):
                values[1, j] -= degree * values[0, j]
                values[1, j + 1] += degree * values[0, j]
        if level == degree - 1:
            for j in range(level):
                bend = degree * (degree - 1) * values[0, j]
                values[2, j] += bend
                values[2, j + 1] -= 2.0 * bend
                values[2, j + 2] += bend
        saved = 0.0
        for j in range(level):
            share = values[0, j]
            values[0, j] = saved + (1.0 - t) * share
            saved = t * share
        values[0, level] = saved


@njit(cache=True, error_model="numpy", nogil=True)
def patch_jet(net: Floats, s: float, t: float, rational: bool, by_s: Floats, by_t: Floats, jet: Floats) -> None:
    """Derivatives by the patch's own parameters s, t in 0 ... 1, into jet (3, 3, D): [a, b] for a + b <= 2.

    by_s, by_t : (3, p+1), (3, q+1) scratch.   Of a rational patch the first D-1 columns are the surface's.
    """
    bernstein_jet(net.shape[0] - 1, s, by_s)
    bernstein_jet(net.shape[1] - 1, t, by_t)
    jet[:] = 0.0
    for i in range(net.shape[0]):
        for j in range(net.shape[1]):
            for a in range(3):
                for b in range(3 - a):
                    share = by_s[a, i] * by_t[b, j]
                    for axis in range(net.shape[2]):
                        jet[a, b, axis] += share * net[i, j, axis]
    if rational:
        quotient_2d(jet, net.shape[2] - 1)


@njit(cache=True, error_model="numpy", nogil=True)
def halve_rows(net: Floats, left: Floats, right: Floats) -> None:
    """Both halves in the first direction, into left and right (p+1, q+1, D); right may be the net itself (A1.5)."""
    order = net.shape[0]
    right[:] = net
    left[0] = right[0]
    for r in range(1, order):
        for j in range(order - r):
            right[j] = 0.5 * (right[j] + right[j + 1])
        left[r] = right[0]


@njit(cache=True, error_model="numpy", nogil=True)
def halve_columns(net: Floats, left: Floats, right: Floats) -> None:
    """Both halves in the second direction, as `halve_rows`."""
    order = net.shape[1]
    right[:] = net
    left[:, 0] = right[:, 0]
    for r in range(1, order):
        for j in range(order - r):
            right[:, j] = 0.5 * (right[:, j] + right[:, j + 1])
        left[:, r] = right[:, 0]
