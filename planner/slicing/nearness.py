"""Which side of a closed polyline lies nearest to each of many points: exact, for whole stacks of contours at once."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_LEAF = 4  # sides in a leaf of the tree of boxes


def nearest_sides(points: Floats, point_start: Ints, path: Floats, path_start: Ints) -> tuple[Floats, Ints]:
    """Distance of each point from the polyline of its own group, and the side that is nearest.

    points : (n, 3) float, mm   group after group; group g is points[point_start[g] : point_start[g + 1]]
    path : (m, 3) float, mm     the closed polylines alike, last != first; side i runs from point i to the next
    Returns (n,) float mm, inf where the polyline has no points, and (n,) int64, the row of the side's first point.
    A complete binary tree of boxes stands on leaves of neighbouring sides; a box farther away than the best so far is
    not opened, and neighbouring points start from each other's best: the time of a point grows with the logarithm.
    """
    distance, side = _nearest(np.ascontiguousarray(points), point_start, np.ascontiguousarray(path), path_start)
    return distance, side


@njit(cache=True, error_model="numpy", nogil=True)
def _nearest(
    points: Floats, point_start: Ints, path: Floats, path_start: Ints
) -> tuple[Floats, Ints]:  # pragma: no cover
    distance = np.full(points.shape[0], np.inf)
    side = np.full(points.shape[0], -1, np.int64)
    stack, least = np.empty(64, np.int64), np.empty(64)
    for group in range(path_start.size - 1):
        first, last = path_start[group], path_start[group + 1]
        if last == first:
            continue
        boxes = _boxes(path, first, last)
        leaves = boxes.shape[0] // 2
        best = first
        for k in range(point_start[group], point_start[group + 1]):
            p = points[k]
            shortest = _distance2(p, path, best, first, last)
            stack[0], least[0], top = 1, 0.0, 1
            while top > 0:
                top -= 1
                node = stack[top]
                if least[top] >= shortest:
                    continue
                if node >= leaves:
                    low = first + (node - leaves) * _LEAF
                    for i in range(low, min(low + _LEAF, last)):
                        reach = _distance2(p, path, i, first, last)
                        if reach < shortest:
                            shortest, best = reach, i
                    continue
                near, far = 2 * node, 2 * node + 1
                to_near, to_far = _box_distance2(p, boxes, near), _box_distance2(p, boxes, far)
                if to_far < to_near:
                    near, far, to_near, to_far = far, near, to_far, to_near
                if to_far < shortest:
                    stack[top], least[top] = far, to_far
                    top += 1
                if to_near < shortest:
                    stack[top], least[top] = near, to_near
                    top += 1
            distance[k], side[k] = np.sqrt(shortest), best
    return distance, side


@njit(cache=True, error_model="numpy", nogil=True)
def _boxes(path: Floats, first: int, last: int) -> Floats:  # pragma: no cover
    """(2 * leaves, 2, 3): lowest and highest corner of each node, in heap order, root 1; empty ones are inside out."""
    leaves = 1
    while leaves * _LEAF < last - first:
        leaves *= 2
    boxes = np.empty((2 * leaves, 2, 3))
    boxes[:, 0], boxes[:, 1] = np.inf, -np.inf
    for i in range(first, last):
        box = leaves + (i - first) // _LEAF
        following = i + 1 if i + 1 < last else first
        for axis in range(3):
            low, high = min(path[i, axis], path[following, axis]), max(path[i, axis], path[following, axis])
            boxes[box, 0, axis] = min(boxes[box, 0, axis], low)
            boxes[box, 1, axis] = max(boxes[box, 1, axis], high)
    for node in range(leaves - 1, 0, -1):
        for axis in range(3):
            boxes[node, 0, axis] = min(boxes[2 * node, 0, axis], boxes[2 * node + 1, 0, axis])
            boxes[node, 1, axis] = max(boxes[2 * node, 1, axis], boxes[2 * node + 1, 1, axis])
    return boxes


@njit(cache=True, error_model="numpy", nogil=True)
def _box_distance2(p: Floats, boxes: Floats, node: int) -> float:  # pragma: no cover
    """Squared distance of a point from a box; inf from an empty one."""
    result = 0.0
    for axis in range(3):
        over = max(boxes[node, 0, axis] - p[axis], p[axis] - boxes[node, 1, axis])
        if over > 0.0:
            result += over * over
    return result


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
