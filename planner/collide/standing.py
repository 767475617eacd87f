"""The part as it stands, as points of its surface: beads as they are laid, walls inside them, gone when a cutter has passed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.collide.convex import HULL, ROUNDED, point_distance
from planner.collide.gjk import signed_distance
from planner.collide.points import LEAF, PointTree

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STAYS = np.iinfo(np.int64).max
"""In `Forest.until`: nothing has cut the point yet."""
NOTHING = -1
_DEPTH = 64


class Forest(NamedTuple):
    """Points under trees of balls, for kernels.

    points : (n, 3) mm, build frame, in the order of the leaves   row : (n,) of the points as they were given
    until : (m,) last step at which a point as given is there   balls : (b, 4), see `PointTree`
    trees : (t, 4) first of the points, first and number of the balls, 0
    """

    points: Floats
    row: Ints
    until: Ints
    balls: Floats
    trees: Ints


@dataclass
class _Patch:
    """Points that came together.  rows : of the points as they were given"""

    rows: Ints
    tree: PointTree


class Standing:
    """Points of what stands, in the build frame, with the step until which each is there."""

    def __init__(self) -> None:
        self._points = np.empty((0, 3))
        self._until = np.empty(0, dtype=np.int64)
        self._margin = np.empty(0)
        self._patches: list[_Patch] = []
        self._forest: Forest | None = None

    def __len__(self) -> int:
        return int(np.count_nonzero(self._until == STAYS))

    @property
    def points(self) -> Floats:
        """(n, 3) float, mm: all that stand now."""
        return np.asarray(self._points[self._until == STAYS])

    def grow(self, points: Floats, margin_mm: Floats | float = 0.0) -> None:
        """Add points (n, 3), mm.  margin_mm : (n,), how deep in a cutter they may be without being cut: points of a finished surface."""
        if not len(points):
            return
        first = len(self._points)
        self._points = np.vstack([self._points, points])
        self._until = np.append(self._until, np.full(len(points), STAYS))
        self._margin = np.append(self._margin, np.broadcast_to(margin_mm, (len(points),)))
        rows = np.arange(first, first + len(points))
        while self._patches and len(self._patches[-1].rows) <= 2 * len(rows):  # as large ones as small ones stay few
            rows = np.concatenate([self._patches.pop().rows, rows])
        rows = rows[self._until[rows] == STAYS]
        if len(rows):
            self._patches.append(_Patch(rows, PointTree.over(self._points[rows])))
        self._forest = None

    def cut(self, poses: Floats, steps: Ints, radius_mm: float, edge_mm: float, length_mm: float) -> Ints:
        """Rows of points that a cutter takes away, and note at which step.

        poses : (n, 6) float, tip and axis, in order   steps : (n,) in which pass each is   radius, rounding of the edge, flutes : mm
        """
        if not len(self._points) or not len(poses):
            return np.empty(0, dtype=np.int64)
        before = self._until.copy()
        size = np.array([radius_mm, edge_mm, length_mm])
        _cut(self.forest, self._margin, poses, steps, size)
        return np.asarray(np.flatnonzero(before != self._until))

    def restore(self, rows: Ints) -> None:
        """Points that `cut` has taken are there again."""
        self._until[rows] = STAYS

    @property
    def forest(self) -> Forest:
        """All of it, for kernels; `until` is shared."""
        if self._forest is None:
            parts = self._patches
            first = np.cumsum([0, *(len(part.tree.points) for part in parts)])
            ball = np.cumsum([0, *(len(part.tree.balls) for part in parts)])
            trees = [(first[k], ball[k], len(part.tree.balls), 0) for k, part in enumerate(parts)]
            self._forest = Forest(
                np.concatenate([np.empty((0, 3)), *(part.tree.points for part in parts)]),
                np.concatenate([np.empty(0, dtype=np.int64), *(part.rows[part.tree.order] for part in parts)]),
                self._until,
                np.concatenate([np.empty((0, 4)), *(part.tree.balls for part in parts)]),
                np.array(trees, dtype=np.int64).reshape(-1, 4),
            )
        return self._forest


@njit(cache=True)
def _cut(forest: Forest, margin: Floats, poses: Floats, steps: Ints, size: Floats) -> None:
    """Note in `until` which points lie in the flutes, at the first step that takes them."""
    stack = np.empty(_DEPTH, dtype=np.int64)
    none = np.empty((0, 3))
    for i in range(len(poses)):
        for t in range(len(forest.trees)):
            first, ball, balls = forest.trees[t, 0], forest.trees[t, 1], forest.trees[t, 2]
            leaf_from = (balls - 1) // 2
            stack[0] = 0
            count = 1
            while count:
                count -= 1
                node = stack[count]
                b = forest.balls[ball + node]
                h, r = _on_axis(poses[i], b[0], b[1], b[2])
                if point_distance(ROUNDED, size, none, r, 0.0, h) > b[3]:
                    continue
                if node < leaf_from:
                    stack[count], stack[count + 1] = 2 * node + 1, 2 * node + 2
                    count += 2
                    continue
                for k in range(first + (node - leaf_from) * LEAF, first + (node - leaf_from + 1) * LEAF):
                    row = forest.row[k]
                    if forest.until[row] != STAYS:
                        continue
                    h, r = _on_axis(poses[i], forest.points[k, 0], forest.points[k, 1], forest.points[k, 2])
                    if point_distance(ROUNDED, size, none, r, 0.0, h) < -margin[row]:
                        forest.until[row] = steps[i]


@njit(cache=True)
def _on_axis(pose: Floats, x: float, y: float, z: float) -> tuple[float, float]:
    """Height along the axis and distance from it of a point, mm.  pose : (6,), tip and axis"""
    px, py, pz = x - pose[0], y - pose[1], z - pose[2]
    h = px * pose[3] + py * pose[4] + pz * pose[5]
    return h, np.sqrt(max(px * px + py * py + pz * pz - h * h, 0.0))


@njit(cache=True)
def nearest_point(
    forest: Forest, step: int, kind: int, size: Floats, corners: Floats, pose: Floats, enough: float, warm: int, stack: Ints, bounds: Floats
) -> tuple[float, int]:
    """Least signed distance (mm) of the points that are there after a step from a body, and its place in `forest.points`.

    pose : (3, 4) float, build frame from the body's own   enough : mm; NOTHING and this where no point is nearer
    warm : a place that is likely to be near, or NOTHING   stack, bounds : (_DEPTH,) room
    A ball can hold nothing nearer than its centre's distance less its radius.
    """
    best, place = enough, NOTHING
    if warm >= 0 and forest.until[forest.row[warm]] > step:
        d = _of_point(kind, size, corners, pose, forest.points[warm])
        if d < best:
            best, place = d, warm
    for t in range(len(forest.trees)):
        first, ball, balls = forest.trees[t, 0], forest.trees[t, 1], forest.trees[t, 2]
        leaf_from = (balls - 1) // 2
        stack[0], bounds[0] = 0, _of_ball(kind, size, corners, pose, forest.balls[ball])
        count = 1
        while count:
            count -= 1
            if bounds[count] >= best:
                continue
            node = stack[count]
            if node >= leaf_from:
                for k in range(first + (node - leaf_from) * LEAF, first + (node - leaf_from + 1) * LEAF):
                    if forest.until[forest.row[k]] > step:
                        d = _of_point(kind, size, corners, pose, forest.points[k])
                        if d < best:
                            best, place = d, k
                continue
            near, far = 2 * node + 1, 2 * node + 2
            at_near = _of_ball(kind, size, corners, pose, forest.balls[ball + near])
            at_far = _of_ball(kind, size, corners, pose, forest.balls[ball + far])
            if at_far < at_near:
                near, far, at_near, at_far = far, near, at_far, at_near
            if at_far < best:
                stack[count], bounds[count] = far, at_far
                count += 1
            if at_near < best:
                stack[count], bounds[count] = near, at_near
                count += 1
    return best, place


@njit(cache=True)
def _of_ball(kind: int, size: Floats, corners: Floats, pose: Floats, ball: Floats) -> float:
    """Lower bound (mm) of the distance of a ball's points (4,) from a body."""
    x, y, z = _own(pose, ball)
    return float(point_distance(kind, size, corners, x, y, z) - ball[3])


@njit(cache=True)
def _of_point(kind: int, size: Floats, corners: Floats, pose: Floats, point: Floats) -> float:
    """Signed distance (mm) of a point (3,) from a body."""
    x, y, z = _own(pose, point)
    if kind != HULL:
        return float(point_distance(kind, size, corners, x, y, z))
    there, at, none, dot = np.empty((3, 4)), np.empty(3), np.empty((0, 3)), np.zeros(3)
    there[:] = 0.0
    there[0, 0] = there[1, 1] = there[2, 2] = 1.0
    there[0, 3], there[1, 3], there[2, 3] = x, y, z
    return float(signed_distance((HULL, 0), (size, dot), (corners, none), there, np.inf, at))


@njit(cache=True)
def _own(pose: Floats, point: Floats) -> tuple[float, float, float]:
    """A point of the build frame in a body's own."""
    x, y, z = point[0] - pose[0, 3], point[1] - pose[1, 3], point[2] - pose[2, 3]
    return (
        pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z,
        pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z,
        pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z,
    )
