"""Kernels that cut facets with parallel planes and link the cuts into closed loops, by numbering alone."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]


@njit(cache=True)
def _height(vertices: Floats, v: int, middle: Floats, normal: Floats) -> float:
    """Height of vertex v over `middle` along the normal, mm; always summed in this order, so that it never differs."""
    return float(
        (vertices[v, 0] - middle[0]) * normal[0]
        + (vertices[v, 1] - middle[1]) * normal[1]
        + (vertices[v, 2] - middle[2]) * normal[2]
    )


@njit(cache=True)
def rank_vertices(vertices: Floats, middle: Floats, normal: Floats, least_above: Floats) -> Ints32:
    """How many planes each vertex is above.

    vertices : (n, 3) float mm;  middle : (3,) float mm, where heights count from;  normal : (3,) float
    least_above : (k,) float mm, ascending; a vertex is above plane i if its height is greater than least_above[i]
    Returns rank : (n,) int32 in 0 … k.  A table of evenly spaced heights gives the first guess.
    """
    planes = least_above.shape[0]
    low = least_above[0]
    span = least_above[planes - 1] - low
    cells = 2 * planes
    scale = (cells - 1) / span if span > 0.0 else 0.0
    guess = np.zeros(cells, np.int32)
    rank = 0
    for cell in range(cells):
        while scale > 0.0 and rank < planes and least_above[rank] < low + cell / scale:
            rank += 1
        guess[cell] = rank
    result = np.empty(vertices.shape[0], np.int32)
    for v in range(vertices.shape[0]):
        height = _height(vertices, v, middle, normal)
        if height <= low:
            result[v] = 0
        elif height > least_above[planes - 1]:
            result[v] = planes
        else:
            rank = guess[min(int((height - low) * scale), cells - 1)]
            while least_above[rank] < height:
                rank += 1
            while rank > 0 and not least_above[rank - 1] < height:
                rank -= 1
            result[v] = rank
    return result


@njit(cache=True)
def number_pairs(facets: Ints, rank: Ints32) -> tuple[Ints32, int]:
    """Number the (facet, plane) pairs that meet, facet by facet, plane by plane.

    facets : (m, 3) int64;  rank : (n,) int32 as from `rank_vertices`
    Returns base : (m + 1, 2) int32 and the count of pairs: facet f meets planes base[f, 1] + i, and plane k has there
    the pair number base[f, 0] + k; the row after a facet's tells where its pairs end. The numbers are only good if
    the count stays below 2**31.
    """
    base = np.empty((facets.shape[0] + 1, 2), np.int32)
    count = 0
    for f in range(facets.shape[0]):
        a, b, c = rank[facets[f, 0]], rank[facets[f, 1]], rank[facets[f, 2]]
        lowest = min(a, min(b, c))
        base[f, 0] = count - lowest
        base[f, 1] = lowest
        count += max(a, max(b, c)) - lowest
    base[facets.shape[0], 0] = count
    base[facets.shape[0], 1] = 0
    return base, count


@njit(cache=True)
def _cross_edge(
    vertices: Floats, a: int, b: int, middle: Floats, normal: Floats, level: float, snap_mm: float, point: Floats
) -> float:
    """Where the edge a, b meets a plane: fills point (3,) mm and returns the weight of b.

    A vertex within snap_mm of the plane is the point itself. The order of a and b must follow from the edge alone.
    """
    above_a = _height(vertices, a, middle, normal) - level
    above_b = _height(vertices, b, middle, normal) - level
    t = 0.0 if abs(above_a) <= snap_mm else (1.0 if abs(above_b) <= snap_mm else above_a / (above_a - above_b))
    for axis in range(3):
        start = vertices[a, axis]
        stop = vertices[b, axis]
        point[axis] = stop if t == 1.0 else start + t * (stop - start)
    return t


@njit(cache=True)
def _is_same(points: Floats, p: int, q: int) -> bool:
    return bool(points[p, 0] == points[q, 0] and points[p, 1] == points[q, 1] and points[p, 2] == points[q, 2])


@njit(cache=True)
def _move(points: Floats, weights: Floats, halves: Ints32, source: int, target: int) -> None:
    """Copy the row source to the row target of the three arrays."""
    for axis in range(3):
        points[target, axis] = points[source, axis]
    weights[target] = weights[source]
    halves[target] = halves[source]


@njit(cache=True)
def _without_spikes(points: Floats, weights: Floats, halves: Ints32, base: int, top: int) -> int:
    """Let the last row, top - 1, take the place of a segment of no length or a spike that it ends; the new top."""
    reduced = True
    while reduced:
        reduced = False
        if top - base >= 2 and _is_same(points, top - 2, top - 1):
            _move(points, weights, halves, top - 1, top - 2)
            top -= 1
            reduced = True
        elif top - base >= 3 and _is_same(points, top - 3, top - 1):
            _move(points, weights, halves, top - 1, top - 3)
            top -= 2
            reduced = True
    return top


@njit(cache=True)
def _closed(points: Floats, weights: Floats, halves: Ints32, base: int, top: int) -> int:
    """Take spikes and segments of no length out over the seam of the loop in rows base … top; its end, or base if
    fewer than three points are left."""
    bottom = base
    while top - bottom >= 3:
        if _is_same(points, top - 1, bottom):
            top -= 1
        elif _is_same(points, top - 2, bottom):
            top -= 2
        elif _is_same(points, top - 1, bottom + 1):
            top -= 1
            bottom += 1
        else:
            break
    if top - bottom < 3:
        return base
    if bottom > base:
        for row in range(bottom, top):
            _move(points, weights, halves, row, base + row - bottom)
    return base + top - bottom


@njit(cache=True)
def _entry(facets: Ints, rank: Ints32, f: int, k: int) -> int:
    """Edge over which the contour in plane k enters facet f: the one that goes down through the plane."""
    for j in range(3):
        if rank[facets[f, j]] > k and rank[facets[f, (j + 1) % 3]] <= k:
            return j
    return 0


@njit(cache=True)
def _follow_loop(
    vertices: Floats, facets: Ints, across: Ints32, rank: Ints32, base: Ints32, seen: NDArray[np.uint8],
    middle: Floats, normal: Floats, level: float, snap_mm: float, first: tuple[int, int], top: int,
    points: Floats, weights: Floats, halves: Ints32,
) -> tuple[int, int]:  # fmt: skip
    """Follow the contour of one plane from one pair round to itself.

    first : facet and plane;  top : first free row of points, weights and halves, which are filled from there
    A facet is entered over its edge that goes down through the plane and left over the edge that goes up; the facet
    across that edge continues the contour. Returns the row after the loop's last, and the open half-edge that the
    contour leads over (-1 if it closes).
    """
    f, k = first
    start = top
    j = _entry(facets, rank, f, k)
    upper, lower = facets[f, j], facets[f, (j + 1) % 3]
    while not seen[base[f, 0] + k]:
        seen[base[f, 0] + k] = 1
        a, b = min(upper, lower), max(upper, lower)
        weights[top] = _cross_edge(vertices, a, b, middle, normal, level, snap_mm, points[top])
        halves[top] = 3 * f + j
        top = _without_spikes(points, weights, halves, start, top + 1)
        apex = facets[f, (j + 2) % 3]
        if rank[apex] > k:
            leave = (j + 1) % 3
            upper = apex
        else:
            leave = (j + 2) % 3
            lower = apex
        mate = across[3 * f + leave]
        if mate < 0:
            return top, 3 * f + leave
        f = mate // 3
        j = mate - 3 * f
    return _closed(points, weights, halves, start, top), -1


@njit(cache=True)
def trace_loops(
    vertices: Floats, facets: Ints, across: Ints32, rank: Ints32, base: Ints32, count: int,
    middle: Floats, normal: Floats, level: Floats, snap_mm: Floats,
) -> tuple[Floats, Floats, Ints32, Ints, Ints32, int, int]:  # fmt: skip
    """All loops of all planes; every pair of a facet and a plane belongs to exactly one loop.

    vertices : (n, 3) float mm;  facets : (m, 3) int64;  across : (3m,) int32, half-edge on the other side, -1 if none
    rank, base, count : as from `rank_vertices` and `number_pairs`;  level : (k,) float mm, heights over `middle`
    snap_mm : (k,) float mm, how near to a plane a vertex lies on it
    Returns points : (p, 3) mm, weights : (p,), halves : (p,) int32 entry half-edges 3f + j, start : (loops + 1,) rows
    of each loop, plane : (loops,) int32, and the first open half-edge with its plane (-1, -1 if none is met).
    Segments of no length and spikes (there and back over the same points) are left out.
    """
    points = np.empty((count, 3), np.float64)
    weights = np.empty(count, np.float64)
    halves = np.empty(count, np.int32)
    seen = np.zeros(count, np.uint8)
    start = np.zeros(64, np.int64)
    plane = np.empty(64, np.int32)
    loops = 0
    for f in range(facets.shape[0]):
        for k in range(base[f, 1], base[f + 1, 0] + base[f + 1, 1] - base[f, 0]):
            if seen[base[f, 0] + k]:
                continue
            top, open_half = _follow_loop(
                vertices, facets, across, rank, base, seen, middle, normal, level[k], snap_mm[k], (f, k), start[loops],
                points, weights, halves,
            )  # fmt: skip
            if open_half >= 0:
                return points[:0], weights[:0], halves[:0], start[:1], plane[:0], open_half, k
            if top == start[loops]:
                continue
            if loops + 2 > start.shape[0]:
                start = np.concatenate((start, np.empty_like(start)))
                plane = np.concatenate((plane, np.empty_like(plane)))
            plane[loops] = k
            loops += 1
            start[loops] = top
    end = start[loops]
    return points[:end], weights[:end], halves[:end], start[: loops + 1].copy(), plane[:loops].copy(), -1, -1
