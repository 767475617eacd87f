"""Closed polylines in one plane cut at each other, so that they meet in common vertices only."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from planner.errors import PlanningError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_ROUNDS = 40  # cuts move sides by less than the tolerance; few rounds are ever needed


def noded(xy: Floats, rings: list[Ints], tolerance_mm: float) -> tuple[Floats, list[tuple[Ints, Floats]]]:
    """Vertices drawn together and sides cut until no two polylines cross or touch but in vertices that both name.

    xy : (n, 2) float, mm;  rings : vertex numbers (k,) of each closed polyline;  tolerance_mm : vertices nearer than this
    to each other, or to a side, are in one place
    Returns the vertices (m, 2), those given first, and for each ring its vertices (j,) and for each of these the place in
    the given ring, counted in vertices and shares of a side (j,).
    Raises PlanningError if the sides do not come to rest.
    Source: iterated snap rounding (Halperin and Packer, Computational Geometry 23, 2002), with a tolerance for pixels.
    """
    name = _drawn_together(xy, tolerance_mm)
    vertices = [xy]
    count = len(xy)
    start = np.cumsum([0, *(len(ring) for ring in rings)])
    ids = name[np.concatenate(rings)]
    place = np.concatenate([np.arange(len(ring), dtype=np.float64) for ring in rings])
    for _ in range(_ROUNDS):
        ids, place, start = _without_repeats(ids, place, start)
        following = _following(start)
        points = np.concatenate(vertices)
        side, vertex, share, fresh = _cuts(points, ids, following, tolerance_mm)
        if not len(side):
            return points, [(ids[a:b], place[a:b]) for a, b in pairwise(start.tolist())]
        if len(fresh):
            vertices.append(fresh)
            count += len(fresh)
        ids, place, start = _inserted(ids, place, start, (side, vertex, share))
    raise PlanningError(
        f"contours near ({points[ids[side[0]], 0]:.4g}, {points[ids[side[0]], 1]:.4g}) mm in their plane cannot be "
        "told apart",
        "choose a larger cusp or another build direction",
    )


def _drawn_together(xy: Floats, tolerance_mm: float) -> Ints:
    """For each vertex the first one that lies within the tolerance of it: (n,) int64."""
    name = np.arange(len(xy))
    for first, second in sorted(cKDTree(xy).query_pairs(tolerance_mm)):
        if name[first] == first and name[second] == second:
            name[second] = first
    return name


def _without_repeats(ids: Ints, place: Floats, start: Ints) -> tuple[Ints, Floats, Ints]:
    """The rings without sides of no length and without spikes a-b-a; what has no width is one vertex in the end."""
    after, second = _following(start), _following(start)[_following(start)]
    odd = (ids == ids[after]) | (ids == ids[second])
    if not odd.any():
        return ids, place, start
    kept: list[Ints] = []
    for a, b in pairwise(start.tolist()):
        rows = np.arange(a, b)
        kept.append(a + open_rows(ids[a:b]) if odd[a:b].any() else rows)
    rows = np.concatenate(kept)
    return ids[rows], place[rows], np.cumsum([0, *(len(part) for part in kept)])


@njit(cache=True)
def open_rows(ids: Ints) -> Ints:  # pragma: no cover
    """Rows (k,) of a closed polyline without repeated vertices and spikes; at least one."""
    rows = np.empty(ids.shape[0], np.int64)
    count, first = 0, 0
    for i in range(ids.shape[0]):
        if count > 0 and ids[rows[count - 1]] == ids[i]:
            continue
        if count > 1 and ids[rows[count - 2]] == ids[i]:
            count -= 1
            continue
        rows[count] = i
        count += 1
    while count - first > 1:
        if ids[rows[first]] == ids[rows[count - 1]] or ids[rows[first]] == ids[rows[count - 2]]:
            count -= 1
        elif ids[rows[first + 1]] == ids[rows[count - 1]]:
            first += 1
        else:
            break
    return rows[first:count]


def _following(start: Ints) -> Ints:
    after = np.arange(1, start[-1] + 1)
    after[start[1:] - 1] = start[:-1]
    return after


def _inserted(ids: Ints, place: Floats, start: Ints, cuts: tuple[Ints, Ints, Floats]) -> tuple[Ints, Floats, Ints]:
    """The rings with vertices put into their sides.  cuts : side, vertex and share of each."""
    side, vertex, share = cuts
    ring = np.searchsorted(start, side, side="right") - 1
    following = _following(start)
    here = place[side]
    ahead = np.where(following[side] > side, place[following[side]], np.inf)
    ahead = np.where(np.isinf(ahead), np.floor(here) + 1.0, ahead)
    key = np.concatenate([np.arange(len(ids), dtype=np.float64), side + np.clip(share, 1e-9, 1.0 - 1e-9)])
    order = np.argsort(key, kind="stable")
    merged = np.concatenate([ids, vertex])[order]
    where = np.concatenate([place, here + share * (ahead - here)])[order]
    added = np.bincount(ring, minlength=len(start) - 1)
    return merged, where, start + np.concatenate([[0], np.cumsum(added)])


def _cuts(xy: Floats, ids: Ints, following: Ints, tolerance_mm: float) -> tuple[Ints, Ints, Floats, Floats]:
    """Which sides must be cut, at which vertex and share (k,), and the new vertices (j, 2), mm.

    First vertices within the tolerance of a side; only where there are none, crossings of two sides.
    """
    side, vertex, share = vertices_on_sides(xy, ids, following, tolerance_mm)
    if len(side):
        return side, vertex, share, np.empty((0, 2))
    sides, shares, fresh = crossings(xy, ids, following)
    return sides.ravel(), len(xy) + np.repeat(np.arange(len(fresh)), 2), shares.ravel(), fresh


@njit(cache=True)
def vertices_on_sides(
    xy: Floats, ids: Ints, following: Ints, tolerance: float
) -> tuple[Ints, Ints, Floats]:  # pragma: no cover
    """Sides, vertices that lie within the tolerance of them and the share of the side at which they do: (k,) each."""
    count = ids.shape[0]
    order = np.argsort(xy[ids, 0])
    sorted_x = xy[ids[order], 0]
    side, vertex, share = np.empty(16, np.int64), np.empty(16, np.int64), np.empty(16)
    found = 0
    for s in range(count):
        a, b = ids[s], ids[following[s]]
        ux, uy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1]
        size = ux * ux + uy * uy
        if size == 0.0:
            continue
        high_x = max(xy[a, 0], xy[b, 0]) + tolerance
        own = found
        k = np.searchsorted(sorted_x, min(xy[a, 0], xy[b, 0]) - tolerance)
        while k < count and sorted_x[k] <= high_x:
            v = ids[order[k]]
            k += 1
            wx, wy = xy[v, 0] - xy[a, 0], xy[v, 1] - xy[a, 1]
            t = (wx * ux + wy * uy) / size
            if v in (a, b) or t <= 0.0 or t >= 1.0 or abs(ux * wy - uy * wx) > tolerance * np.sqrt(size):
                continue
            if (vertex[own:found] == v).any():
                continue
            if found == side.shape[0]:
                side, vertex = np.append(side, np.empty_like(side)), np.append(vertex, np.empty_like(vertex))
                share = np.append(share, np.empty_like(share))
            side[found], vertex[found], share[found] = s, v, t
            found += 1
    return side[:found], vertex[:found], share[:found]


@njit(cache=True)
def crossings(xy: Floats, ids: Ints, following: Ints) -> tuple[Ints, Floats, Floats]:  # pragma: no cover
    """Pairs of sides that cross (k, 2), the share of each (k, 2) and the places (k, 2), mm; each side at most once."""
    count = ids.shape[0]
    sides, shares, places = np.empty((16, 2), np.int64), np.empty((16, 2)), np.empty((16, 2))
    found = 0
    low = np.minimum(xy[ids, 0], xy[ids[following], 0])
    order = np.argsort(low)
    is_cut = np.zeros(count, np.bool_)
    for first in range(count):
        s = order[first]
        a, b = ids[s], ids[following[s]]
        reach = max(xy[a, 0], xy[b, 0])
        low_y, high_y = min(xy[a, 1], xy[b, 1]), max(xy[a, 1], xy[b, 1])
        for second in range(first + 1, count):
            q = order[second]
            if low[q] > reach:
                break
            c, d = ids[q], ids[following[q]]
            if is_cut[s] or is_cut[q] or c in (a, b) or d in (a, b):
                continue
            if min(xy[c, 1], xy[d, 1]) > high_y or max(xy[c, 1], xy[d, 1]) < low_y:
                continue
            ux, uy, vx, vy = xy[b, 0] - xy[a, 0], xy[b, 1] - xy[a, 1], xy[d, 0] - xy[c, 0], xy[d, 1] - xy[c, 1]
            across = ux * vy - uy * vx
            if across == 0.0:
                continue
            wx, wy = xy[c, 0] - xy[a, 0], xy[c, 1] - xy[a, 1]
            t, r = (wx * vy - wy * vx) / across, (wx * uy - wy * ux) / across
            if not (0.0 < t < 1.0 and 0.0 < r < 1.0):
                continue
            if found == sides.shape[0]:
                sides, shares = np.concatenate((sides, sides)), np.concatenate((shares, shares))
                places = np.concatenate((places, places))
            sides[found, 0], sides[found, 1], shares[found, 0], shares[found, 1] = s, q, t, r
            places[found, 0], places[found, 1] = xy[a, 0] + t * ux, xy[a, 1] + t * uy
            is_cut[s] = is_cut[q] = True
            found += 1
    return sides[:found], shares[:found], places[:found]
