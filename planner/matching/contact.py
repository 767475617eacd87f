"""Whether the walls of a layer touch themselves or each other on their way from plane to plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.nurbs.ruled import RuledSurface

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_PER_PIECE = 2  # places along each piece at which rings are made polygons: a piece turns 10 degrees at most
_TOUCH = 1e-9  # of a side, beyond its ends: corners that meet corners meet
_SPECK_MM = 1e-3  # along one ring: nearer places meet only where points of the mesh that are one lie apart by rounding
_AT_ENDS = 0.02
"""Share of the height next to both planes in which contact is none: there rings are the sections' own contours, which
are apart, but for the width by which polygons miss curves."""


@dataclass(frozen=True)
class Contact:
    """Two places of walls that meet.

    first, second : numbers of the walls, the same where a wall meets itself
    share : height at which they meet first, 0 at the bottom plane, 1 at the top plane
    place : (3,) float, mm
    """

    first: int
    second: int
    share: float
    place: tuple[float, float, float]


def first_contact(surfaces: list[RuledSurface], axes: Floats) -> Contact | None:
    """The lowest contact of ring walls between two planes, or None if all stay apart.

    axes : (2, 3) float   unit vectors in the planes
    The rings at height v are polygons whose corners move in straight lines with v. Polygons that start apart can first
    meet only where a corner of one reaches a side of another: a quadratic equation for each corner and side whose
    boxes over the whole height overlap. Exact for the polygons.
    """
    low, high, ring = [], [], []
    for number, surface in enumerate(surfaces):
        breaks = surface.curve0.breaks
        share = np.arange(_PER_PIECE) / _PER_PIECE
        u = (breaks[:-1, None] + np.diff(breaks)[:, None] * share).ravel()
        low.append(surface.curve0.evaluate(u))
        high.append(surface.curve1.evaluate(u))
        ring.append(np.full(len(u), number))
    if not ring:
        return None
    bottom, top, owner = np.concatenate(low), np.concatenate(high), np.concatenate(ring)
    start = np.searchsorted(owner, np.arange(len(surfaces) + 1))
    following = np.arange(1, len(owner) + 1)
    following[start[1:] - 1] = start[:-1]
    along = 0.5 * sum(np.linalg.norm(ends[following] - ends, axis=1) for ends in (bottom, top))
    path = np.cumsum(along) - along
    corner, side, share_at = lowest_meeting(bottom @ axes.T, top @ axes.T, following, owner, path, _AT_ENDS)
    if corner < 0:
        return None
    place = (1.0 - share_at) * bottom[corner] + share_at * top[corner]
    x, y, z = (float(value) for value in place)
    return Contact(int(owner[corner]), int(owner[side]), float(share_at), (x, y, z))


@njit(cache=True)
def lowest_meeting(
    low: Floats, high: Floats, following: Ints, owner: Ints, path: Floats, at_ends: float
) -> tuple[int, int, float]:  # pragma: no cover
    """Corner, side (its first corner) and height of the lowest meeting, -1 for none.

    low, high : (n, 2) float, mm, the corners at heights 0 and 1;  following : (n,) int64, next corner of the same ring
    owner : (n,) int64, ring of each corner;  path : (n,) float, mm, way to it along all rings
    Sides are sorted by the lower end of their boxes, so that each corner is compared only with sides that it may reach.
    """
    count = low.shape[0]
    box_low, box_high = np.empty((count, 2)), np.empty((count, 2))
    longest = 0.0
    for s in range(count):
        f = following[s]
        for k in range(2):
            box_low[s, k] = min(min(low[s, k], high[s, k]), min(low[f, k], high[f, k]))
            box_high[s, k] = max(max(low[s, k], high[s, k]), max(low[f, k], high[f, k]))
        longest = max(longest, box_high[s, 0] - box_low[s, 0])
    order = np.argsort(box_low[:, 0])
    sorted_low = box_low[order, 0]
    best, corner, side = 1.0 - at_ends, -1, -1
    for c in range(count):
        least = min(low[c, 0], high[c, 0])
        most = max(low[c, 0], high[c, 0])
        position = np.searchsorted(sorted_low, least - longest)
        while position < count and sorted_low[position] <= most:
            s = order[position]
            position += 1
            f = following[s]
            if c in (s, f) or box_high[s, 0] < least:
                continue
            if box_high[s, 1] < min(low[c, 1], high[c, 1]) or box_low[s, 1] > max(low[c, 1], high[c, 1]):
                continue
            if owner[c] == owner[s] and abs(path[c] - path[s]) < _SPECK_MM:
                continue
            v = _reaches(low[c], high[c], low[s], high[s], low[f], high[f], at_ends)
            if v < best:
                best, corner, side = v, c, s
    return corner, side, best


@njit(cache=True)
def _reaches(
    p0: Floats, p1: Floats, a0: Floats, a1: Floats, b0: Floats, b1: Floats, at_ends: float
) -> float:  # pragma: no cover
    """Lowest height in (at_ends, 1 - at_ends) at which point p lies on side a-b, all moving evenly; 2 for none."""
    ux, uy = b0[0] - a0[0], b0[1] - a0[1]
    wx, wy = p0[0] - a0[0], p0[1] - a0[1]
    dux, duy = (b1[0] - a1[0]) - ux, (b1[1] - a1[1]) - uy
    dwx, dwy = (p1[0] - a1[0]) - wx, (p1[1] - a1[1]) - wy
    constant = ux * wy - uy * wx
    linear = ux * dwy - uy * dwx + dux * wy - duy * wx
    square = dux * dwy - duy * dwx
    size = max(abs(ux) + abs(uy), abs(ux + dux) + abs(uy + duy)) ** 2
    best = 2.0
    if abs(square) <= 1e-12 * size and abs(linear) <= 1e-12 * size:
        return best
    if abs(square) <= 1e-12 * size:
        roots = (-constant / linear, 2.0)
    else:
        inner = linear * linear - 4.0 * square * constant
        if inner < 0.0:
            return best
        half = -0.5 * (linear + (np.sqrt(inner) if linear >= 0.0 else -np.sqrt(inner)))
        roots = (half / square, constant / half if half != 0.0 else 2.0)
    for v in roots:
        if not at_ends < v < 1.0 - at_ends:
            continue
        sx, sy = ux + v * dux, uy + v * duy
        rx, ry = wx + v * dwx, wy + v * dwy
        length = sx * sx + sy * sy
        along = sx * rx + sy * ry
        if length > 0.0 and -_TOUCH * length <= along <= (1.0 + _TOUCH) * length:
            best = min(best, v)
    return best
