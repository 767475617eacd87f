"""What is offset: closed curves as one table of polynomial pieces and corners, material on the left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import comb

import numpy as np
import shapely
from numba import njit
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.errors import FitError
from planner.nurbs.bezier import BezierPieces
from planner.nurbs.curve import Curve
from planner.nurbs.rings import region_from_loops

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

_KINK_RAD = 1e-3  # joints that turn less are smooth: at 10 mm the offset is then 1.3e-6 mm off at most
_JUMP = 0.2  # of the larger curvature at a joint: a larger jump there begins another stretch, such as an arc after a line
_BULGE_MM = 1e-3  # and one that bends the shorter of both pieces away by this
_TURN_RAD = 0.15  # of the source per side of its polygon, at most
_MOST_SIDES = 200  # of one piece's polygon
_SHARP = 1e12  # 1/mm, curvature of a corner
_LEAST_MM = 1e-9  # shorter pieces are points
_LEVEL_MM = 1e-6  # within which curves in space lie at one height


@dataclass(frozen=True, eq=False)
class Source:
    """Loops as pieces: polynomial ones, and between two that meet at an angle a corner of no length.

    coefficients : (P, k, 3) float  Of t^0 ... t^(k-1), 0 <= t <= 1, homogeneous (w x, w y, w), mm. Of a corner: row 0 its
                                    place, row 1 the normal's direction (rad) before it and its turn (rad).
    is_corner    : (P,) bool
    begins       : (P,) bool        A stretch of another kind begins: a corner, after a corner, where curvature jumps.
    first        : (L+1,) int       First piece of each loop.
    owner        : (L,) int         The set of curves that each loop belongs to.
    """

    coefficients: Floats
    is_corner: Mask
    begins: Mask
    first: Ints
    owner: Ints


@dataclass(frozen=True, eq=False)
class Sides:
    """The loops as polygons. A corner is a side of no length.

    points : (S, 2) float, mm   Where each side begins.   piece : (S,) int   low, high : (S,) float   Its parameters.
    after, before : (S,) int    The neighbouring sides of the loop.   first : (L+1,) int   First side of each loop.
    loop : (P,) int             The loop of each piece.
    limits : (S, 3) float       Least and largest curvature (1/mm) and turning (rad) of each; a corner's curvature is as
                                good as infinite.
    """

    points: Floats
    piece: Ints
    low: Floats
    high: Floats
    after: Ints
    before: Ints
    first: Ints
    loop: Ints
    limits: Floats


def source_of(sets: Sequence[Sequence[Curve]]) -> Source:
    """The table of all curves of all sets; outlines turned counter-clockwise, holes clockwise (even-odd in each set).

    Raises FitError if a curve is open or does not lie in a plane of constant z.
    """
    every = [_flat(curve, index) for curves in sets for index, curve in enumerate(curves)]
    owner = np.repeat(np.arange(len(sets)), [len(curves) for curves in sets])
    if not every:
        return _with_corners(np.empty((0, 2, 3)), np.zeros(1, dtype=np.int64), owner)
    pieces = BezierPieces.from_curves(every)
    nets = pieces.nets if pieces.rational else np.dstack([pieces.nets, np.ones(pieces.nets.shape[:2])])
    table, reach = _monomials(nets, pieces.degrees)
    kept = reach > _LEAST_MM
    first = np.concatenate([[0], np.cumsum(kept)])[pieces.first]
    table = table[kept]
    backward = np.repeat(~_senses(table, first, owner), np.diff(first))
    order = np.arange(len(table))
    low, high = np.repeat(first[:-1], np.diff(first)), np.repeat(first[1:], np.diff(first))
    order = np.where(backward, low + high - 1 - order, order)
    return _with_corners(np.where(backward[:, None, None], _reversed(table), table)[order], first, owner)


def _flat(curve: Curve, index: int) -> Curve:
    """The curve in the plane of x and y."""
    if not curve.is_closed:
        raise FitError(f"curve {index} is open and has no inside to offset")
    points = curve.control_points
    if points.shape[1] == 2:
        return curve
    if np.ptp(points[:, 2]) > _LEVEL_MM:
        raise FitError(f"curve {index} is not level: it spans {np.ptp(points[:, 2]):.3g} mm in z")
    return Curve.trusted(curve.degree, curve.knots, np.ascontiguousarray(points[:, :2]), curve.weights)


def _senses(table: Floats, first: Ints, owner: Ints) -> Mask:
    """Which loops already have the material on their left."""
    rows = np.einsum("tk,pkd->ptd", np.vander(np.arange(4) / 4, table.shape[1], increasing=True), table).reshape(-1, 3)
    points, first = rows[:, :2] / rows[:, 2:], 4 * first
    following = np.roll(points, -1, axis=0)
    following[first[1:] - 1] = points[first[:-1]]
    centre = np.repeat(points[first[:-1]], np.diff(first), axis=0)
    a, b = points - centre, following - centre
    areas = np.add.reduceat(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], first[:-1])
    is_hole = np.zeros(len(owner), dtype=bool)
    several = np.flatnonzero(np.bincount(owner, minlength=1)[owner] > 1)
    shapes = [shapely.Polygon(points[first[k] : first[k + 1]]) for k in several]
    shapely.prepare(shapes)
    for number in np.unique(owner[several]):
        mine = np.flatnonzero(owner[several] == number)
        starts = points[first[several[mine]]]
        inside = shapely.contains_xy(np.array([shapes[k] for k in mine])[:, None], starts[None, :, 0], starts[None, :, 1])
        np.fill_diagonal(inside, False)
        is_hole[several[mine]] = inside.sum(axis=0) % 2 == 1
    return np.asarray((areas > 0.0) != is_hole)


def _to_monomials(degree: int) -> Floats:
    """The matrix from Bernstein coefficients to those of powers of t: (p+1, p+1) float."""
    matrix = np.zeros((degree + 1, degree + 1))
    for j in range(degree + 1):
        for i in range(j + 1):
            matrix[j, i] = comb(degree, j) * comb(j, i) * (-1.0) ** (j - i)
    return matrix


def _monomials(nets: Floats, degrees: Ints) -> tuple[Floats, Floats]:
    """Coefficients of powers of t, as many as the highest degree asks for, and how far each piece's control points go, mm.

    nets : (P, k, 3) float, homogeneous   degrees : (P,) int, of each piece, which uses its first rows.
    """
    table, reach = np.zeros((len(nets), max(nets.shape[1], 2), 3)), np.empty(len(nets))
    for degree in np.unique(degrees):
        mine = np.flatnonzero(degrees == degree)
        own = nets[mine, : degree + 1]
        places = own[:, :, :2] / own[:, :, 2:]
        reach[mine] = np.abs(np.diff(places, axis=1)).max(axis=(1, 2))
        table[mine, : degree + 1] = np.einsum("jk,pkd->pjd", _to_monomials(degree), own)
    return table, reach


def _reversed(table: Floats) -> Floats:
    """The coefficients of the same pieces run backward: of powers of 1 - t."""
    count = table.shape[1]
    turn = np.array([[comb(k, j) * (-1.0) ** j for k in range(count)] for j in range(count)])
    return np.asarray(np.einsum("jk,pkd->pjd", turn, table))


def _with_corners(table: Floats, first: Ints, owner: Ints) -> Source:
    """The pieces with a corner between those that meet at an angle."""
    starts, ends = _end_frames(table)
    before = np.arange(len(table)) - 1
    before[first[:-1]] = first[1:] - 1
    turn = (starts[:, 0] - ends[before, 0] + np.pi) % (2.0 * np.pi) - np.pi
    is_kink = np.abs(turn) > _KINK_RAD
    k0, k1 = ends[before, 1], starts[:, 1]
    reach = np.minimum(starts[before, 2], starts[:, 2])
    jumps = np.abs(k0 - k1) > np.maximum(_JUMP * np.maximum(np.abs(k0), np.abs(k1)), 8.0 * _BULGE_MM / reach**2)
    at = np.flatnonzero(is_kink)
    corners = np.zeros((len(at), *table.shape[1:]))
    corners[:, 0] = table[at, 0] / table[at, 0, 2:]
    corners[:, 1, 0] = ends[before[at], 0] + 0.5 * np.pi
    corners[:, 1, 1] = turn[at]
    moved = first + np.searchsorted(at, first, side="left")
    is_corner = np.insert(np.zeros(len(table), dtype=bool), at, True)
    begins = np.insert(jumps | is_kink, at, True)
    return Source(np.ascontiguousarray(np.insert(table, at, corners, axis=0)), is_corner, begins, moved, owner)


def polygons_of(source: Source, sides: Sides, sets: Sequence[int]) -> list[MultiPolygon]:
    """The region that each of these sets of loops bounds, of the loops' polygons, valid, mm."""
    keep = ~source.is_corner[sides.piece]
    rings = [sides.points[low:high][keep[low:high]] for low, high in pairwise(sides.first.tolist())]
    return [_polygon([rings[k] for k in np.flatnonzero(source.owner == number)]) for number in sets]


def _polygon(rings: list[Floats]) -> MultiPolygon:
    """The region left of all rings; by the even-odd rule where they cross or touch."""
    following = [np.roll(ring, -1, axis=0) for ring in rings]
    areas = np.array([np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) for a, b in zip(rings, following, strict=True)])
    outlines = [k for k in np.argsort(areas) if areas[k] > 0.0]
    holes: dict[int, list[Floats]] = {int(k): [] for k in outlines}
    shells = np.array([shapely.Polygon(rings[k]) for k in outlines])
    for k in np.flatnonzero(areas < 0.0):
        around = shapely.contains_xy(shells, *rings[k][0]) if len(shells) > 1 else np.ones(1, dtype=bool)
        if not around.any() or not len(shells):
            return region_from_loops(rings)
        holes[int(outlines[int(np.argmax(around))])].append(rings[k])
    region = MultiPolygon([shapely.Polygon(rings[k], inner) for k, inner in holes.items()])
    return region if region.is_valid else region_from_loops(rings)


def _end_frames(table: Floats) -> tuple[Floats, Floats]:
    """Direction (rad), curvature (1/mm) and speed (mm) at the start and at the end of every piece: (P, 3) float each."""
    starts, ends = np.empty((len(table), 3)), np.empty((len(table), 3))
    _frames(table, 0.0, starts)
    _frames(table, 1.0, ends)
    return starts, ends


@njit(cache=True, error_model="numpy", nogil=True)
def _frames(table: Floats, t: float, frames: Floats) -> None:  # pragma: no cover
    for p in range(len(table)):
        _, _, dx, dy, ddx, ddy = jet(table, p, t)
        frames[p, 0] = np.arctan2(dy, dx)
        frames[p, 1] = (dx * ddy - dy * ddx) / max((dx * dx + dy * dy) ** 1.5, 1e-300)
        frames[p, 2] = np.hypot(dx, dy)


@njit(cache=True, error_model="numpy", nogil=True)
def jet(table: Floats, piece: int, t: float) -> tuple[float, float, float, float, float, float]:  # pragma: no cover
    """Point, first and second derivative by t of a polynomial piece: x, y, x', y', x'', y''. Source: A4.2."""
    top = table.shape[1] - 1
    x, y, w = table[piece, top, 0], table[piece, top, 1], table[piece, top, 2]
    dx, dy, dw = 0.0, 0.0, 0.0
    ddx, ddy, ddw = 0.0, 0.0, 0.0
    for k in range(top - 1, -1, -1):
        ddx, ddy, ddw = ddx * t + 2.0 * dx, ddy * t + 2.0 * dy, ddw * t + 2.0 * dw
        dx, dy, dw = dx * t + x, dy * t + y, dw * t + w
        x, y, w = x * t + table[piece, k, 0], y * t + table[piece, k, 1], w * t + table[piece, k, 2]
    x, y = x / w, y / w
    dx, dy = (dx - dw * x) / w, (dy - dw * y) / w
    ddx, ddy = (ddx - 2.0 * dw * dx - ddw * x) / w, (ddy - 2.0 * dw * dy - ddw * y) / w
    return x, y, dx, dy, ddx, ddy


def sides_of(source: Source, chord_error_mm: float) -> Sides:
    """Polygons of the loops, their corners on the curves, sides within the chord error and turning little."""
    counts = _side_counts(source.coefficients, source.is_corner, chord_error_mm)
    piece = np.repeat(np.arange(len(counts)), counts)
    number = np.arange(len(piece)) - np.repeat(np.cumsum(counts) - counts, counts)
    low, high = number / counts[piece], (number + 1.0) / counts[piece]
    points = _points(source.coefficients, source.is_corner, piece, low)
    first = np.concatenate([[0], np.cumsum(counts)])[source.first]
    after, before = np.arange(1, len(piece) + 1), np.arange(-1, len(piece) - 1)
    after[first[1:] - 1], before[first[:-1]] = first[:-1], first[1:] - 1
    loop = np.repeat(np.arange(len(first) - 1), np.diff(source.first))
    limits = _limits(source.coefficients, source.is_corner, piece, low, high)
    return Sides(points, piece, low, high, after, before, first, loop, limits)


@njit(cache=True, error_model="numpy", nogil=True)
def _limits(table: Floats, is_corner: Mask, piece: Ints, low: Floats, high: Floats) -> Floats:  # pragma: no cover
    """Least and largest curvature (1/mm) and turning (rad) of every side, from both ends and the middle: (S, 3)."""
    limits = np.empty((len(piece), 3))
    for k in range(len(piece)):
        if is_corner[piece[k]]:
            turn = table[piece[k], 1, 1]
            limits[k, 0] = limits[k, 1] = np.copysign(_SHARP, turn)
            limits[k, 2] = abs(turn)
            continue
        least, most, total = np.inf, -np.inf, 0.0
        for j in range(3):
            _, _, dx, dy, ddx, ddy = jet(table, piece[k], low[k] + 0.5 * j * (high[k] - low[k]))
            speed2 = max(dx * dx + dy * dy, 1e-300)
            rate = (dx * ddy - dy * ddx) / speed2
            bend = rate / np.sqrt(speed2)
            least, most = min(least, bend), max(most, bend)
            total += abs(rate) * (2.0 if j == 1 else 0.5) / 3.0
        limits[k, 0], limits[k, 1], limits[k, 2] = least, most, total * (high[k] - low[k])
    return limits


@njit(cache=True, error_model="numpy", nogil=True)
def _side_counts(table: Floats, is_corner: Mask, chord_error_mm: float) -> Ints:  # pragma: no cover
    counts = np.ones(len(table), dtype=np.int64)
    for p in range(len(table)):
        if is_corner[p]:
            continue
        bend, turn = 0.0, 0.0
        for k in range(9):
            _, _, dx, dy, ddx, ddy = jet(table, p, k / 8.0)
            bend = max(bend, np.hypot(ddx, ddy))
            turn = max(turn, abs(dx * ddy - dy * ddx) / max(dx * dx + dy * dy, 1e-300))
        least = max(np.sqrt(bend / (8.0 * chord_error_mm)), turn / _TURN_RAD)
        counts[p] = max(1, int(np.ceil(min(least, _MOST_SIDES * 1.0) - 1e-9)))
    return counts


@njit(cache=True, error_model="numpy", nogil=True)
def _points(table: Floats, is_corner: Mask, piece: Ints, t: Floats) -> Floats:  # pragma: no cover
    points = np.empty((len(piece), 2))
    for k in range(len(piece)):
        if is_corner[piece[k]]:
            points[k] = table[piece[k], 0, :2]
        else:
            points[k, 0], points[k, 1], _, _, _, _ = jet(table, piece[k], t[k])
    return points
