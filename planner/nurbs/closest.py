"""The point of a curve nearest to each of many points: a tree of nearly straight pieces, then Newton."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from planner.nurbs.bezier import BezierPieces, bezier_halves, bezier_jet

if TYPE_CHECKING:
    from planner.nurbs.curve import Curve

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

_FLAT = 0.05  # a leaf's control points stray from its chord by this share of it at most: it turns by about 0.4 rad
_DEPTH = 24  # halvings of a piece at most: near a cusp no leaf is flat
_STEPS = 60  # bisection alone ends in about 52
_ROUNDING = 1e-14  # squared distances closer than this share are equal


class ClosestTree:
    """Pieces of some curves, halved until nearly straight, in a tree of boxes for each curve."""

    def __init__(self, pieces: BezierPieces) -> None:
        """pieces : the curves, as Bézier pieces."""
        self._rational = pieces.rational
        leaves = _leaves(pieces.nets, pieces.degrees, pieces.low, pieces.high, pieces.first, pieces.rational)
        self._nets, self._degrees, self._low, self._high, self._first = leaves
        self._boxes = _tree(self._nets, self._degrees, self._first, pieces.rational)

    def nearest(self, owner: Indices, points: Floats) -> tuple[Floats, Floats]:
        """Parameter of, and distance to, the point of curve owner[k] nearest to points[k]: two (k,) float.

        points : (k, d) float, mm   Exact (global) but for ties: every piece whose box is near enough is looked at.
        """
        leaves = (self._nets, self._degrees, self._low, self._high, self._first, self._rational)
        return _nearest(*leaves, self._boxes, owner, points)


def closest_points(curve: Curve, points: ArrayLike) -> tuple[Floats, Floats]:
    """Parameter of, and distance to, the point of the curve nearest to each given point.

    points : (k, d) float, mm   Returns ((k,) float, (k,) float mm).
    The nearest of all pieces, ends and corners included. Where several are equally near, one of them.
    Raises ValueError if the points have not the curve's dimension or are not finite.
    Source: Piegl & Tiller ch. 6.1 (Eqs. 6.1-6.4), started from every nearly straight piece that can hold the foot.
    """
    goal = checked_points(points, curve.dimension)
    return curve.closest_tree.nearest(np.zeros(len(goal), dtype=np.intp), goal)


def checked_points(points: ArrayLike, dimension: int) -> Floats:
    """The points as (k, d) C-contiguous float. Raises ValueError if the dimension differs or one is not finite."""
    goal = np.ascontiguousarray(np.atleast_2d(np.asarray(points, dtype=np.float64)))
    if goal.ndim != 2 or goal.shape[1] != dimension:
        raise ValueError(f"points of shape {goal.shape} are not (k, {dimension})")
    if not np.isfinite(goal).all():
        raise ValueError(f"point {int(np.flatnonzero(~np.isfinite(goal).all(axis=1))[0])} is not finite")
    return goal


@njit(cache=True, error_model="numpy", nogil=True)
def _is_flat(net: Floats, degree: int, rational: bool) -> bool:
    """Whether all control points lie near the chord and beside it."""
    dimension = net.shape[1] - int(rational)
    length2 = 0.0
    w0 = net[0, dimension] if rational else 1.0
    w1 = net[degree, dimension] if rational else 1.0
    for axis in range(dimension):
        length2 += (net[degree, axis] / w1 - net[0, axis] / w0) ** 2
    for j in range(1, degree):
        weight = net[j, dimension] if rational else 1.0
        along, away2 = 0.0, 0.0
        for axis in range(dimension):
            start = net[0, axis] / w0
            offset = net[j, axis] / weight - start
            along += offset * (net[degree, axis] / w1 - start)
            away2 += offset**2
        if along < 0.0 or along > length2 or away2 * length2 - along**2 > (_FLAT * length2) ** 2:
            return False
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def _leaves(
    nets: Floats, degrees: Indices, low: Floats, high: Floats, first: Indices, rational: bool
) -> tuple[Floats, Indices, Floats, Floats, Indices]:
    """Pieces halved until flat: their nets, degrees, ends, and where each curve's begin."""
    room, found = 2 * len(nets), 0
    order, width = nets.shape[1], nets.shape[2]
    leaf, kind = np.zeros((room, order, width)), np.empty(room, dtype=np.intp)
    start, end = np.empty(room), np.empty(room)
    edges = np.zeros(len(first), dtype=np.intp)
    stack, ends = np.empty((_DEPTH + 2, order, width)), np.empty((_DEPTH + 2, 3))
    half = np.empty((order, width))
    for curve in range(len(first) - 1):
        for k in range(first[curve], first[curve + 1]):
            stack[0] = nets[k]
            ends[0, 0], ends[0, 1], ends[0, 2] = low[k], high[k], 0.0
            height, degree = 1, degrees[k]
            while height > 0:
                top = height - 1
                if ends[top, 2] < _DEPTH and not _is_flat(stack[top], degree, rational):
                    middle = 0.5 * (ends[top, 0] + ends[top, 1])
                    bezier_halves(stack[top], degree, half, stack[top])
                    stack[height] = half
                    ends[height, 0], ends[height, 1] = ends[top, 0], middle
                    ends[top, 0] = middle
                    ends[top, 2] += 1.0
                    ends[height, 2] = ends[top, 2]
                    height += 1
                    continue
                if found == room:
                    leaf, kind = np.concatenate((leaf, np.zeros_like(leaf))), np.concatenate((kind, kind))
                    start, end = np.concatenate((start, start)), np.concatenate((end, end))
                    room *= 2
                leaf[found], kind[found] = stack[top], degree
                start[found], end[found] = ends[top, 0], ends[top, 1]
                found += 1
                height -= 1
        edges[curve + 1] = found
    return leaf[:found].copy(), kind[:found].copy(), start[:found].copy(), end[:found].copy(), edges


@njit(cache=True, error_model="numpy", nogil=True)
def _tree(nets: Floats, degrees: Indices, first: Indices, rational: bool) -> Floats:
    """Boxes (n, 2, d) of all tree nodes, in preorder: the left child follows its node, a tree of k leaves has 2k-1.

    The tree of curve i starts at node 2 first[i] - i.
    """
    dimension = nets.shape[2] - int(rational)
    boxes = np.empty((2 * len(nets), 2, dimension))
    stack = np.empty((64, 3), dtype=np.intp)
    order = np.empty((2 * len(nets), 3), dtype=np.intp)
    for curve in range(len(first) - 1):
        stack[0, 0], stack[0, 1], stack[0, 2] = 2 * first[curve] - curve, first[curve], first[curve + 1]
        height, count = 1, 0
        while height > 0:
            height -= 1
            node, low, high = stack[height]
            order[count, 0], order[count, 1], order[count, 2] = node, low, high
            count += 1
            if high - low > 1:
                middle = (low + high) // 2
                right = node + 2 * (middle - low)
                stack[height, 0], stack[height, 1], stack[height, 2] = right, middle, high
                stack[height + 1, 0], stack[height + 1, 1], stack[height + 1, 2] = node + 1, low, middle
                height += 2
        for index in range(count - 1, -1, -1):
            node, low, high = order[index]
            if high - low == 1:
                _leaf_box(nets[low], degrees[low], rational, boxes[node])
                continue
            right = node + 2 * ((low + high) // 2 - low)
            for axis in range(dimension):
                boxes[node, 0, axis] = min(boxes[node + 1, 0, axis], boxes[right, 0, axis])
                boxes[node, 1, axis] = max(boxes[node + 1, 1, axis], boxes[right, 1, axis])
    return boxes


@njit(cache=True, error_model="numpy", nogil=True)
def _leaf_box(net: Floats, degree: int, rational: bool, box: Floats) -> None:
    """Box of the control points."""
    for axis in range(box.shape[1]):
        box[0, axis], box[1, axis] = np.inf, -np.inf
        for j in range(degree + 1):
            value = net[j, axis] / (net[j, box.shape[1]] if rational else 1.0)
            box[0, axis], box[1, axis] = min(box[0, axis], value), max(box[1, axis], value)


@njit(cache=True, error_model="numpy", nogil=True)
def box_distance2(box: Floats, point: Floats) -> float:
    """Squared distance of a point from a box, mm²; 0 inside.  box : (2, d) float, mm, least and greatest   point : (d,)"""
    total = 0.0
    for axis in range(point.size):
        apart = max(box[0, axis] - point[axis], point[axis] - box[1, axis], 0.0)
        total += apart * apart
    return total


@njit(cache=True, error_model="numpy", nogil=True)
def _foot_on_leaf(
    net: Floats, degree: int, rational: bool, point: Floats, best: float, work: Floats, jet: Floats
) -> tuple[float, float]:
    """Own parameter and squared distance of the leaf's nearest point, if nearer than `best` (squared); else as given.

    Both ends are tried; between them safeguarded Newton on (C - P)·C' = 0, begun where the chord's foot is.
    """
    dimension = point.size
    along, length2, first2, last2 = 0.0, 0.0, 0.0, 0.0
    for axis in range(dimension):
        start, end = net[0, axis], net[degree, axis]
        if rational:
            start, end = start / net[0, dimension], end / net[degree, dimension]
        along += (point[axis] - start) * (end - start)
        length2 += (end - start) ** 2
        first2 += (point[axis] - start) ** 2
        last2 += (point[axis] - end) ** 2
    found = -1.0
    if first2 < best:
        found, best = 0.0, first2
    if last2 < best:
        found, best = 1.0, last2
    low, high = 0.0, 1.0
    t = min(max(along / length2, 0.0), 1.0) if length2 > 0.0 else 0.5
    away2 = np.inf
    for _ in range(_STEPS):
        bezier_jet(net, degree, t, rational, work, jet)
        slope, speed2, bend, away2 = 0.0, 0.0, 0.0, 0.0
        for axis in range(dimension):
            away = jet[0, axis] - point[axis]
            away2 += away * away
            slope += away * jet[1, axis]
            speed2 += jet[1, axis] ** 2
            bend += away * jet[2, axis]
        if away2 < best:
            found, best = t, away2
        if slope > 0.0:
            high = t
        else:
            low = t
        bend += speed2
        if slope == 0.0 or high - low <= 1e-15 or (slope * slope <= 1e-31 * speed2 * away2):
            break
        step = t - slope / bend if bend > 0.0 else -1.0
        if step <= 0.0 and low == 0.0 and bend > 0.0 and t > 0.0:
            step = 0.0
        elif step >= 1.0 and high == 1.0 and bend > 0.0 and t < 1.0:
            step = 1.0
        elif not low < step < high:
            step = 0.5 * (low + high)
        if abs(step - t) <= 1e-16:
            break
        t = step
    if away2 <= best * (1.0 + _ROUNDING):  # where the distance no longer tells, the slope still does
        found, best = t, min(best, away2)
    return found, best


@njit(cache=True, error_model="numpy", nogil=True)
def _nearest(
    nets: Floats, degrees: Indices, low: Floats, high: Floats, first: Indices, rational: bool,
    boxes: Floats, owner: Indices, points: Floats,
) -> tuple[Floats, Floats]:  # fmt: skip
    """The walk through the tree for each point, nearer child first; the last point's leaf gives the first bound."""
    width = nets.shape[2]
    work, jet = np.empty((nets.shape[1], width)), np.empty((3, width))
    at, distance = np.empty(len(points)), np.empty(len(points))
    stack, bounds = np.empty((128, 3), dtype=np.intp), np.empty(128)
    leaf = first[0]
    for k in range(len(points)):
        curve, point = owner[k], points[k]
        if not first[curve] <= leaf < first[curve + 1]:
            leaf = first[curve]
        begin = leaf
        t, best = _foot_on_leaf(nets[leaf], degrees[leaf], rational, point, np.inf, work, jet)
        stack[0, 0], stack[0, 1], stack[0, 2] = 2 * first[curve] - curve, first[curve], first[curve + 1]
        bounds[0], height = 0.0, 1
        while height > 0:
            height -= 1
            if bounds[height] >= best:
                continue
            node, a, b = stack[height]
            if b - a == 1:
                if a != begin:
                    found, nearer = _foot_on_leaf(nets[a], degrees[a], rational, point, best, work, jet)
                    if nearer < best:
                        t, best, leaf = found, nearer, a
                continue
            middle = (a + b) // 2
            right = node + 2 * (middle - a)
            near, far = box_distance2(boxes[node + 1], point), box_distance2(boxes[right], point)
            left_first = near <= far
            for place in range(2):
                is_left = (place == 1) == left_first
                stack[height, 0] = node + 1 if is_left else right
                stack[height, 1], stack[height, 2] = (a, middle) if is_left else (middle, b)
                bounds[height] = near if is_left else far
                height += 1
        at[k], distance[k] = low[leaf] + t * (high[leaf] - low[leaf]), np.sqrt(best)
    return at, distance
