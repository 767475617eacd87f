"""Which side of a closed polyline lies nearest to each of many points: exact, for whole stacks of contours at once."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def nearest_sides(points: Floats, point_start: Ints, path: Floats, path_start: Ints) -> tuple[Floats, Ints]:
    """Distance of each point from the polyline of its own group, and the side that is nearest.

    points : (n, 3) float, mm   group after group; group g is points[point_start[g] : point_start[g + 1]]
    path : (m, 3) float, mm     the closed polylines alike, last != first; side i runs from point i to the next
    Returns (n,) float mm, inf where the polyline has no points, and (n,) int64, the row of the side's first point.
    Sides are boxed in runs of about the square root of their number; a box farther away than the best so far is not
    opened. Neighbouring points start from each other's best.
    """
    distance, side = _nearest(np.ascontiguousarray(points), point_start, np.ascontiguousarray(path), path_start)
    return distance, side


@njit(cache=True, error_model="numpy", nogil=True)
def _nearest(
    points: Floats, point_start: Ints, path: Floats, path_start: Ints
) -> tuple[Floats, Ints]:  # pragma: no cover
    distance = np.full(points.shape[0], np.inf)
    side = np.full(points.shape[0], -1, np.int64)
    for group in range(path_start.size - 1):
        first, last = path_start[group], path_start[group + 1]
        count = last - first
        if count == 0:
            continue
        run = max(4, int(np.sqrt(count)))
        boxes = _boxes(path, first, last, run)
        best = first
        for k in range(point_start[group], point_start[group + 1]):
            p = points[k]
            shortest = _distance2(p, path, best, first, last)
            for box in range(boxes.shape[0]):
                away = 0.0
                for axis in range(3):
                    over = max(boxes[box, 0, axis] - p[axis], p[axis] - boxes[box, 1, axis])
                    if over > 0.0:
                        away += over * over
                if away >= shortest:
                    continue
                for i in range(first + box * run, min(first + (box + 1) * run, last)):
                    reach = _distance2(p, path, i, first, last)
                    if reach < shortest:
                        shortest, best = reach, i
            distance[k], side[k] = np.sqrt(shortest), best
    return distance, side


@njit(cache=True, error_model="numpy", nogil=True)
def _boxes(path: Floats, first: int, last: int, run: int) -> Floats:  # pragma: no cover
    """(boxes, 2, 3): lowest and highest corner of each run of sides."""
    boxes = np.empty(((last - first + run - 1) // run, 2, 3))
    boxes[:, 0], boxes[:, 1] = np.inf, -np.inf
    for i in range(first, last):
        box = (i - first) // run
        following = i + 1 if i + 1 < last else first
        for axis in range(3):
            low, high = min(path[i, axis], path[following, axis]), max(path[i, axis], path[following, axis])
            boxes[box, 0, axis] = min(boxes[box, 0, axis], low)
            boxes[box, 1, axis] = max(boxes[box, 1, axis], high)
    return boxes


@njit(cache=True, error_model="numpy", nogil=True)
def _distance2(p: Floats, path: Floats, i: int, first: int, last: int) -> float:  # pragma: no cover
    """Squared distance of a point from side i."""
    following = i + 1 if i + 1 < last else first
    length2, along = 0.0, 0.0
    for axis in range(3):
        chord = path[following, axis] - path[i, axis]
        length2 += chord * chord
        along += chord * (p[axis] - path[i, axis])
    share = min(1.0, max(0.0, along / length2)) if length2 > 0.0 else 0.0
    result = 0.0
    for axis in range(3):
        off = p[axis] - path[i, axis] - share * (path[following, axis] - path[i, axis])
        result += off * off
    return result
