"""Rings: the closed polylines in which walls end, sampled once for the wall below and the wall above a plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.nurbs.curve import Curve
from planner.nurbs.ruled import RuledSurface

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_SPECK = 1e-9  # of a ring's length: samples nearer to each other are one place
_WINDOW = 0.03  # of a ring's length: how far its partner's samples may lie from where evenly they would
_MOST_PARTS = 64  # of one piece, for the twist of its rulings
_SAME_LENGTH = 0.02  # relative difference of the lengths of two rings that may be one


@dataclass(frozen=True, eq=False)
class RingTable:
    """One end of a wall, sampled along its parameter.

    u : (k,) float, 0 ... 1, ascending     points : (k, 3) float, mm, the last is the first
    s : (k,) float, mm, way along the samples; it stands where the curve does (a corner that a fan of rulings leaves)
    """

    u: Floats
    points: Floats
    s: Floats

    @property
    def length_mm(self) -> float:
        """Way once round, mm."""
        return float(self.s[-1])


@dataclass(frozen=True, eq=False)
class Ring:
    """A polyline of numbered vertices and where each of them lies on a wall's end.

    ids : (n,) int64, vertex numbers, the first not repeated     s : (n,) float, mm, ascending, way along the table
    """

    table: RingTable
    ids: Ints
    s: Floats

    def entries(self, width_mm: float) -> tuple[Floats, Ints]:
        """Parameters (e,) in one round, ascending, and vertices (e,): twice each, where it begins and where it ends.

        width_mm : how far apart, along the ring, counts as one place. Where the curve stands still, begin and end are apart.
        """
        length = self.table.length_mm
        s = np.concatenate([self.table.s - length, self.table.s[1:], self.table.s[1:] + length])
        u = np.concatenate([self.table.u - 1.0, self.table.u[1:], self.table.u[1:] + 1.0])
        at = self.s - length * np.floor(self.s[0] / length)
        both = np.column_stack([np.interp(at - width_mm, s, u), np.interp(at + width_mm, s, u)]).ravel()
        both = np.minimum(np.maximum.accumulate(both), both[0] + 1.0)
        ids = np.repeat(self.ids, 2)
        whole = np.floor(both)
        turn = int(np.searchsorted(whole, whole[-1]))
        return np.concatenate([both[turn:] - whole[-1], both[:turn] - whole[-1] + 1.0]), np.roll(ids, -turn)


def wall_tables(surface: RuledSurface, chord_mm: float) -> tuple[RingTable, RingTable]:
    """Bottom and top end of a wall, sampled at the same parameters, the joints of its pieces among them.

    Between neighbouring samples both chords stay within chord_mm of the curves and flat triangles within chord_mm of the
    rulings' surface.
    """
    edges = surface.curve0.breaks
    counts = np.maximum(_counts(surface.curve0, chord_mm), _counts(surface.curve1, chord_mm))
    ends = [curve.evaluate(edges) for curve in (surface.curve0, surface.curve1)]
    counts = np.maximum(counts, np.clip(np.ceil(_warps(*ends) / (4.0 * chord_mm)), 1.0, _MOST_PARTS))
    parts = counts.astype(np.int64)
    first = np.cumsum(parts) - parts
    share = (np.arange(int(parts.sum())) - np.repeat(first, parts)) / np.repeat(parts, parts)
    u = np.append(np.repeat(edges[:-1], parts) + share * np.repeat(np.diff(edges), parts), edges[-1])
    return ring_table(u, surface.curve0.evaluate(u)), ring_table(u, surface.curve1.evaluate(u))


def _warps(low: Floats, high: Floats) -> Floats:
    """How far, mm, the four corners of each piece of a wall are from a parallelogram, across the piece.

    Two triangles miss the bilinear surface through the corners by a quarter of it.  low, high : (k + 1, 3) float, mm
    """
    rising, falling = high[1:] - low[:-1], low[1:] - high[:-1]
    normal = np.cross(rising, falling)
    size = np.linalg.norm(normal, axis=1)
    warp = np.abs(np.einsum("ij,ij->i", (high[1:] - high[:-1]) - (low[1:] - low[:-1]), normal))
    return np.asarray(np.divide(warp, size, out=np.zeros_like(warp), where=size > 0.0))


def _counts(curve: Curve, chord_mm: float) -> Floats:
    """Parts of each piece whose chords stay within chord_mm: a chord over h is off by at most |C''| h²/8."""
    edges = curve.breaks
    width = np.diff(edges)
    inner = (edges[:-1, None] + width[:, None] * np.array([1e-6, 0.25, 0.5, 0.75, 1.0 - 1e-6])).ravel()
    bend = np.linalg.norm(curve.derivatives(inner, 2)[2], axis=1).reshape(-1, 5).max(axis=1) * width**2
    return np.asarray(np.maximum(np.ceil(np.sqrt(bend / (8.0 * chord_mm))), 1.0))


def ring_table(u: Floats, points: Floats) -> RingTable:
    """The table of samples once round; the last point is set to the first."""
    closed = points.copy()
    closed[-1] = closed[0]
    step = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    step[step <= _SPECK * step.sum()] = 0.0
    return RingTable(u, closed, np.concatenate([[0.0], np.cumsum(step)]))


def own_ring(table: RingTable, first_id: int) -> tuple[Ring, Floats]:
    """The ring of a table's own samples, numbered from first_id on, and their points (n, 3), mm."""
    kept = np.flatnonzero(np.diff(table.s) > 0.0)
    return Ring(table, first_id + np.arange(len(kept)), table.s[kept]), table.points[kept]


def shared_ring(low: RingTable, high: RingTable, weld_mm: float, first_id: int) -> tuple[Ring, Ring, Floats] | None:
    """One polyline for the end of the wall below (low) and of the wall above (high), if they are the same contour.

    Returns the ring on each and its points (n, 3), mm: all samples of low, and those of high that fall between them.
    None if they are farther apart than weld_mm somewhere.
    """
    ring, points = own_ring(low, first_id)
    other, found = own_ring(high, 0)
    if len(points) < 2 or len(found) < 2 or not _boxes_agree(points, found, weld_mm):
        return None
    if abs(low.length_mm - high.length_mm) > _SAME_LENGTH * low.length_mm + weld_mm:
        return None
    start, away = nearest_along(points[:1], np.zeros(1), high.points, high.s, high.length_mm)
    if away[0] > weld_mm:
        return None
    scale = low.length_mm / high.length_mm
    back, away = nearest_along(found, (other.s - start[0]) * scale, low.points, low.s, _WINDOW * low.length_mm)
    if away.max() > weld_mm:
        return None
    back %= low.length_mm
    here = np.concatenate([ring.s, [low.length_mm]])
    slot = np.clip(np.searchsorted(here, back, side="right") - 1, 0, len(here) - 2)
    free = np.minimum(back - here[slot], here[slot + 1] - back) > weld_mm
    s, merged = np.concatenate([ring.s, back[free]]), np.concatenate([points, found[free]])
    order = np.argsort(s, kind="stable")
    s, merged = s[order], merged[order]
    ahead, away = nearest_along(merged, start[0] + s / scale, high.points, high.s, _WINDOW * high.length_mm)
    if away.max() > weld_mm:
        return None
    ahead = np.minimum(np.maximum.accumulate(ahead), ahead[0] + high.length_mm)
    ids = first_id + np.arange(len(s))
    return Ring(low, ids, s), Ring(high, ids, ahead), merged


def _boxes_agree(first: Floats, second: Floats, weld_mm: float) -> bool:
    low, high = np.abs(first.min(axis=0) - second.min(axis=0)), np.abs(first.max(axis=0) - second.max(axis=0))
    return bool(max(low.max(), high.max()) <= 2.0 * weld_mm)


@njit(cache=True)
def nearest_along(
    points: Floats, guess: Floats, line: Floats, s: Floats, window: float
) -> tuple[Floats, Floats]:  # pragma: no cover
    """Way (n,) mm along a closed polyline, near the guess, to the place nearest to each point, and its distance (n,) mm.

    points : (n, 3);  guess : (n,) mm, any number of rounds;  line : (k, 3), last = first;  s : (k,) mm
    window : mm before and behind the guess that are searched
    """
    length = s[-1]
    count = s.shape[0] - 1
    way, away = np.empty(points.shape[0]), np.empty(points.shape[0])
    for i in range(points.shape[0]):
        lowest = guess[i] - window
        turns = np.floor(lowest / length)
        k = min(max(np.searchsorted(s, lowest - turns * length, side="right") - 1, 0), count - 1)
        best, found = np.inf, guess[i]
        for _ in range(count):
            begin = s[k] + turns * length
            if begin > guess[i] + window:
                break
            along, square, size = 0.0, 0.0, 0.0
            for axis in range(3):
                side = line[k + 1, axis] - line[k, axis]
                size += side * side
                along += side * (points[i, axis] - line[k, axis])
            share = min(max(along / size, 0.0), 1.0) if size > 0.0 else 0.0
            for axis in range(3):
                foot = line[k, axis] + share * (line[k + 1, axis] - line[k, axis])
                square += (points[i, axis] - foot) ** 2
            if square < best:
                best, found = square, begin + share * (s[k + 1] - s[k])
            k += 1
            if k == count:
                k, turns = 0, turns + 1.0
        way[i], away[i] = found, np.sqrt(best)
    return way, away
