"""A closed curve measured by length and turning: the scale on which two contours are compared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.errors import FitError
from planner.matching.unweighted import short_cubics
from planner.mesh.smooth import SmoothSurface
from planner.nurbs.curve import Curve
from planner.slicing.section import Loop

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TURNING_SHARE = 0.5
"""How much of an outline's measure is turning, the rest is length: equal shares put as many samples on the corners
and bends, which fix the matching, as on the straight runs between them."""
CORNER_RAD = float(np.radians(5.0))
"""Tangents that differ more at a joint make a corner: far above the fit's noise, below any crease that is kept."""
_SPECK = 1e-3  # of the mean interval: shorter ones come from points that are one point; their direction says nothing
_PER_PIECE = 4  # samples of a cubic piece; contour points are dense, a piece turns little
PARAMETER, DIRECTION, RISE = 0, 1, 5
"""Columns of `Outline.rows`; columns 2, 3 and 4 are the point."""


@dataclass(frozen=True, eq=False)
class Outline:
    """A closed cubic curve with its measure x, which runs from 0 to 1 once round.

    curve : domain (0, 1), closed     axes : (3, 3) float, unit: two in the plane, then the plane's normal
    x : (k,) float                    not decreasing
    rows : (k, 6) float               parameter; direction of the tangent (rad, unwrapped); point (mm); rise: cosine
        between the surface's normal and the plane's. At a corner the parameter stays while x and the direction go on.
        The last row is the first, one turn later.
    corners : (c,) float              parameters of the corners
    """

    curve: Curve
    axes: Floats
    x: Floats
    rows: Floats
    corners: Floats

    def at(self, x: Floats) -> Floats:
        """Rows (k, 6) at any measures (k,), also beyond 0 ... 1: directions go on turning, parameters start again."""
        return rows_at(self.x, self.rows, np.ascontiguousarray(x))

    def normals(self, rows: Floats) -> Floats:
        """(k, 3) float: unit normal of the surface, out of the material, at rows as from `at`."""
        sine, cosine = np.sin(rows[:, DIRECTION]), np.cos(rows[:, DIRECTION])
        outward = sine[:, None] * self.axes[0] - cosine[:, None] * self.axes[1]
        rise = rows[:, RISE, None]
        return np.asarray(np.sqrt(np.maximum(1.0 - rise**2, 0.0)) * outward + rise * self.axes[2])

    @property
    def length_mm(self) -> float:
        """Length of the contour, mm."""
        return float(np.linalg.norm(np.diff(self.rows[:, 2:5], axis=0), axis=1).sum())

    def measure(self, u: Floats, is_behind: bool) -> Floats:
        """Measure of parameters (k,) in 0 ... 1, at corners before or behind the turn."""
        own = self.rows[:, PARAMETER]
        moves = np.diff(own) > 0.0
        kept = np.append(moves, True) if is_behind else np.concatenate([[True], moves])
        return np.asarray(np.interp(u, own[kept], self.x[kept]))


def outline_of(curve: Curve, axes: Floats, loop: Loop | None = None, surface: SmoothSurface | None = None) -> Outline:
    """The outline of a closed curve.

    axes : (3, 3) float   unit vectors, two in the plane against which directions are measured, then its normal
    loop, surface : the loop that the curve was led through and the surface that it lies on; without, walls count upright
    Cut into `short_cubics` first. Raises FitError for a higher degree or a contour without length.
    """
    if curve.degree > 3:
        raise FitError(f"walls are matched along cubic curves, not of degree {curve.degree}")
    cubic = curve if curve.domain == (0.0, 1.0) else curve.with_domain(0.0, 1.0)
    cubic = short_cubics(cubic if cubic.degree == 3 else cubic.with_degree(3))
    breaks = cubic.breaks
    share = np.arange(_PER_PIECE) / _PER_PIECE
    u = np.append((breaks[:-1, None] + np.diff(breaks)[:, None] * share).ravel(), 1.0)
    points = cubic.evaluate(u)
    ahead = cubic.derivatives(u[:-1], 1)[1] @ axes[:2].T
    behind = cubic.derivatives(u[1:], 1, "left")[1] @ axes[:2].T
    rises = np.zeros(len(u) - 1)
    if loop is not None and surface is not None:
        rises = _rises(0.5 * (points[1:] + points[:-1]), loop, surface, axes[2])
    x, theta, rise, jump = _measured(points, ahead, behind, rises)
    if not x[-1] > 0.0:
        raise FitError("a contour without length cannot be matched")
    doubled = np.repeat(np.arange(1, len(u)), 2)
    rows = np.empty((len(x), 6))
    rows[0, PARAMETER], rows[1:, PARAMETER] = 0.0, u[doubled]
    rows[0, 2:5], rows[1:, 2:5] = points[0], points[doubled]
    rows[:, DIRECTION], rows[:, RISE] = theta, rise
    corners = np.flatnonzero(np.abs(jump) > CORNER_RAD) + 1
    return Outline(cubic, axes, x / x[-1], rows, np.sort(u[corners] % 1.0))


@njit(cache=True)
def _wrapped(angle: float) -> float:  # pragma: no cover
    """The angle brought to -pi ... pi."""
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


@njit(cache=True)
def _measured(
    points: Floats, ahead: Floats, behind: Floats, rises: Floats
) -> tuple[Floats, Floats, Floats, Floats]:  # pragma: no cover
    """Measure, direction and rise at both sides of every sample, and the turn at each sample but the first.

    points : (n + 1, 3);  ahead, behind : (n, 2), tangents at the start and the end of each interval;  rises : (n,)
    Returns x, direction, rise (2n + 1,) each and turn (n,).
    """
    count = rises.shape[0]
    x, theta, rise = np.zeros(2 * count + 1), np.zeros(2 * count + 1), np.zeros(2 * count + 1)
    within, jump, lengths = np.empty(count), np.empty(count), np.empty(count)
    for i in range(count):
        lengths[i] = np.sqrt(((points[i + 1] - points[i]) ** 2).sum())
    total, turning = lengths.sum(), 0.0
    start, stop = np.arctan2(ahead[:, 1], ahead[:, 0]), np.arctan2(behind[:, 1], behind[:, 0])
    for i in range(-1, count):
        if lengths[i] < _SPECK * total / count:
            start[i] = stop[i] = stop[i - 1]
    for i in range(count):
        within[i] = _wrapped(stop[i] - start[i])
        jump[i] = _wrapped(start[(i + 1) % count] - stop[i])
        turning += abs(within[i]) + abs(jump[i])
    if total <= 0.0 or turning <= 0.0:
        return x, theta, rise, jump
    theta[0] = start[0]
    for i in range(count):
        step = (1.0 - TURNING_SHARE) * lengths[i] / total + TURNING_SHARE * abs(within[i]) / turning
        x[2 * i + 1], theta[2 * i + 1] = x[2 * i] + step, theta[2 * i] + within[i]
        x[2 * i + 2] = x[2 * i + 1] + TURNING_SHARE * abs(jump[i]) / turning
        theta[2 * i + 2] = theta[2 * i + 1] + jump[i]
        before, after = rises[i], rises[(i + 1) % count]
        if abs(jump[i]) <= CORNER_RAD:
            before = after = 0.5 * (before + after)
        rise[2 * i + 1], rise[2 * i + 2] = before, after
    rise[0] = rise[2 * count]
    return x, theta, rise, jump


@njit(cache=True)
def rows_at(table_x: Floats, table: Floats, x: Floats) -> Floats:  # pragma: no cover
    """Rows (n, 6) interpolated at measures x (n,), round and round; see `Outline.at`."""
    result = np.empty((x.shape[0], table.shape[1]))
    last = table_x.shape[0] - 1
    turn = table[last, DIRECTION] - table[0, DIRECTION]
    for i in range(x.shape[0]):
        rounds = np.floor(x[i])
        rest = x[i] - rounds
        high = min(max(int(np.searchsorted(table_x, rest, side="right")), 1), last)
        width = table_x[high] - table_x[high - 1]
        share = (rest - table_x[high - 1]) / width if width > 0.0 else 0.0
        for k in range(table.shape[1]):
            start, stop = table[high - 1, k], table[high, k]
            result[i, k] = stop if share >= 1.0 else start + share * (stop - start)
        result[i, DIRECTION] += rounds * turn
    return result


def _rises(points: Floats, loop: Loop, surface: SmoothSurface, normal: Floats) -> Floats:
    """Cosine between the surface's normal and the plane's at points along the curve: (n,) float."""
    corners = surface.mesh.facets[loop.facets]
    ends = [(loop.edges, loop.weights), (np.roll(loop.edges, -1, axis=0), np.roll(loop.weights, -1))]
    rises = []
    for edges, weights in ends:
        total = np.zeros((len(corners), 3))
        for k, share in ((0, 1.0 - weights), (1, weights)):
            corner = np.argmax(corners == edges[:, k, None], axis=1)
            total += share[:, None] * surface.normals[loop.facets, corner]
        length = np.linalg.norm(total, axis=1)
        rises.append((total @ normal) / np.where(length > 0.0, length, 1.0))
    return nearest_values(points, loop.points, rises[0], rises[1])


@njit(cache=True)
def nearest_values(points: Floats, path: Floats, starts: Floats, stops: Floats) -> Floats:  # pragma: no cover
    """Values at the places of a closed polyline nearest to points that go round it in the same sense: (n,) float.

    path : (m, 3) float mm;  starts, stops : (m,) float, the value at both ends of each segment
    The first place is searched everywhere, each further one from the last on until the distance grows.
    """
    result = np.empty(points.shape[0])
    count = path.shape[0]
    at = 0
    for i in range(points.shape[0]):
        tries = count if i == 0 else min(count, 12)
        best, chosen, value = np.inf, at, 0.0
        for step in range(tries):
            s = (at + step) % count
            following = (s + 1) % count
            square, along = 0.0, 0.0
            for k in range(3):
                side = path[following, k] - path[s, k]
                square += side * side
                along += side * (points[i, k] - path[s, k])
            share = min(max(along / square, 0.0), 1.0) if square > 0.0 else 0.0
            away = 0.0
            for k in range(3):
                away += (path[s, k] + share * (path[following, k] - path[s, k]) - points[i, k]) ** 2
            if away < best:
                best, chosen, value = away, s, starts[s] + share * (stops[s] - starts[s])
        at = chosen
        result[i] = value
    return result
