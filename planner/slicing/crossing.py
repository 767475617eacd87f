"""Kernels that cut facets with parallel planes and link the cuts into closed loops, by numbering alone."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]


@njit(cache=True)
def number_pairs(facets: Ints, rank: Ints) -> tuple[Ints, Ints]:
    """Number the (facet, plane) pairs that meet, facet by facet, plane by plane.

    facets : (m, 3) int64;  rank : (n,) int64, how many of the sorted planes lie below each vertex
    Returns lowest : (m,) first plane that each facet meets, and offset : (m + 1,): facet f meets planes
    lowest[f] + i at pair number offset[f] + i.
    """
    lowest = np.empty(facets.shape[0], np.int64)
    offset = np.zeros(facets.shape[0] + 1, np.int64)
    for f in range(facets.shape[0]):
        a, b, c = rank[facets[f, 0]], rank[facets[f, 1]], rank[facets[f, 2]]
        lowest[f] = min(a, min(b, c))
        offset[f + 1] = offset[f] + max(a, max(b, c)) - lowest[f]
    return lowest, offset


@njit(cache=True)
def cross_facets(
    facets: Ints, adjacency: Ints, rank: Ints, lowest: Ints, offset: Ints
) -> tuple[Ints, Ints, Ints, Ints, Ints]:
    """Walk data of every (facet, plane) pair, material on the left seen against the plane normal.

    A facet is entered over its edge that goes down through the plane and left over the edge that goes up.
    Returns facet, plane, tail, head, following, each (p,) int64: the entry edge runs from vertex tail (above) to head
    (below); following is the pair across the exit edge, or -1 - j where edge j of the facet is open.
    """
    count = offset[-1]
    facet = np.empty(count, np.int64)
    plane = np.empty(count, np.int64)
    tail = np.empty(count, np.int64)
    head = np.empty(count, np.int64)
    following = np.empty(count, np.int64)
    for f in range(facets.shape[0]):
        for p in range(offset[f], offset[f + 1]):
            k = lowest[f] + p - offset[f]
            facet[p] = f
            plane[p] = k
            for j in range(3):
                a = facets[f, j]
                b = facets[f, (j + 1) % 3]
                if rank[a] > k and rank[b] <= k:
                    tail[p] = a
                    head[p] = b
                elif rank[a] <= k and rank[b] > k:
                    g = adjacency[f, j]
                    following[p] = -1 - j if g < 0 else offset[g] + k - lowest[g]
    return facet, plane, tail, head, following


@njit(cache=True)
def place_points(
    vertices: Floats, height: Floats, level: Floats, snap_mm: float, plane: Ints, low: Ints, high: Ints
) -> tuple[Floats, Floats]:
    """Where each pair's entry edge meets its plane; the same edge and plane give the same bits from either facet.

    vertices : (n, 3) float mm;  height : (n,) float mm along the normal;  level : (k,) float mm, the planes' heights
    low, high : (p,) int64, the edge's vertices, low < high.  A vertex within snap_mm of the plane is the point itself.
    Returns weight : (p,) in [0, 1], point = low + weight (high - low), and points : (p, 3) mm.
    """
    weight = np.empty(plane.shape[0], np.float64)
    points = np.empty((plane.shape[0], 3), np.float64)
    for p in range(plane.shape[0]):
        a = height[low[p]] - level[plane[p]]
        b = height[high[p]] - level[plane[p]]
        t = 0.0 if abs(a) <= snap_mm else (1.0 if abs(b) <= snap_mm else a / (a - b))
        weight[p] = t
        for axis in range(3):
            start = vertices[low[p], axis]
            stop = vertices[high[p], axis]
            points[p, axis] = stop if t == 1.0 else start + t * (stop - start)
    return weight, points


@njit(cache=True)
def link_loops(following: Ints) -> tuple[Ints, Ints, int]:
    """Follow the permutation: every pair belongs to exactly one loop.

    following : (p,) int64, as from `cross_facets`
    Returns order : (p,) pair numbers loop by loop, start : (loops + 1,) into order, and the first pair that leads
    over an open edge (-1 if there is none; the other results are then complete).
    """
    count = following.shape[0]
    order = np.empty(count, np.int64)
    start = np.zeros(count + 1, np.int64)
    seen = np.zeros(count, np.bool_)
    filled = 0
    loops = 0
    for p in range(count):
        if seen[p]:
            continue
        q = p
        while not seen[q]:
            seen[q] = True
            order[filled] = q
            filled += 1
            if following[q] < 0:
                return order[:0], start[:1], q
            q = following[q]
        loops += 1
        start[loops] = filled
    return order, start[: loops + 1], -1


@njit(cache=True)
def _same_point(points: Floats, p: int, q: int) -> bool:
    return bool(points[p, 0] == points[q, 0] and points[p, 1] == points[q, 1] and points[p, 2] == points[q, 2])


@njit(cache=True)
def drop_degenerate(order: Ints, start: Ints, points: Floats) -> tuple[Ints, Ints, Ints]:
    """Take out segments of no length and spikes (there and back over the same points); the loops stay closed.

    order, start : as from `link_loops`;  points : (p, 3) float mm, the start point of each pair's segment
    Returns the same two arrays without them, loops of fewer than three points gone, and for each loop that is left
    its number before.
    """
    kept = np.empty(order.shape[0], np.int64)
    kept_start = np.zeros(start.shape[0], np.int64)
    source = np.empty(start.shape[0], np.int64)
    base = 0
    loops = 0
    for loop in range(start.shape[0] - 1):
        top = base
        for i in range(start[loop], start[loop + 1]):
            p = order[i]
            reduced = True
            while reduced:
                reduced = False
                if top - base >= 1 and _same_point(points, kept[top - 1], p):
                    top -= 1
                    reduced = True
                elif top - base >= 2 and _same_point(points, kept[top - 2], p):
                    top -= 2
                    reduced = True
            kept[top] = p
            top += 1
        bottom = base
        while top - bottom >= 3:
            if _same_point(points, kept[top - 1], kept[bottom]):
                top -= 1
            elif _same_point(points, kept[top - 2], kept[bottom]):
                top -= 2
            elif _same_point(points, kept[top - 1], kept[bottom + 1]):
                top -= 1
                bottom += 1
            else:
                break
        if top - bottom < 3:
            continue
        for i in range(bottom, top):
            kept[base + i - bottom] = kept[i]
        base += top - bottom
        source[loops] = loop
        loops += 1
        kept_start[loops] = base
    return kept[:base], kept_start[: loops + 1], source[:loops]
