"""Clearance between bodies on different carriers, in many poses of the machine."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.collide.bodies import Packed
from planner.collide.carriers import Motion, moved, place, product, relative
from planner.collide.convex import point_distance
from planner.collide.gjk import signed_distance

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NOTHING = -1


class Pairs(NamedTuple):
    """Which bodies are looked at together.

    bodies : (p, 2)   cut_mm : (p,) how deep they may be in each other before it counts at all; less than 0: it always counts
    """

    bodies: Ints
    cut_mm: Floats


@njit(cache=True)
def least_clearance(
    motion: Motion, bodies: Packed, pairs: Pairs, table: int, joints: Floats, is_parked: bool, limit: float
) -> tuple[Floats, Ints, Floats]:
    """Least signed distance of all pairs in every pose.

    joints : (n, 5) float, mm or deg   limit : mm, what is farther is not looked for   table : the carrier of the part
    Returns (n,) mm, at most the limit; (n,) the pair, NOTHING at the limit; (n, 3) mm, where on its first body, table frame.
    A pair whose last distance, less what both bodies have moved since, is no nearer than asked is passed over.
    """
    count = len(bodies.kind)
    least, nearest, places = np.full(len(joints), limit), np.full(len(joints), NOTHING), np.zeros((len(joints), 3))
    world = np.empty((len(motion.parent), 3, 4))
    poses, before = np.empty((count, 3, 4)), np.empty((count, 3, 4))
    middle, way = np.empty((count, 3)), np.zeros(count)
    bound = np.full(len(pairs.bodies), -np.inf)
    at = np.empty(3)
    for row in range(len(joints)):
        place(motion, joints[row], is_parked, world)
        for b in range(count):
            product(world[bodies.carrier[b]], bodies.pose[b], poses[b])
            way[b] = _way(before[b], poses[b], bodies.centre[b], bodies.radius[b]) if row else 0.0
            before[b] = poses[b]
            moved(poses[b], bodies.centre[b], middle[b])
        for p in range(len(bound)):
            a, b = pairs.bodies[p, 0], pairs.bodies[p, 1]
            bound[p] -= way[a] + way[b]
            wanted = min(least[row], -pairs.cut_mm[p]) if pairs.cut_mm[p] >= 0.0 else least[row]
            if bound[p] >= wanted:
                continue
            bound[p] = _from_balls(bodies, poses, middle, a, b)
            if bound[p] >= wanted:
                continue
            bound[p] = _distance(bodies, poses, a, b, wanted, at)
            if bound[p] < wanted:
                least[row], nearest[row] = bound[p], p
                _back(world[table], at, places[row])
    return least, nearest, places


@njit(cache=True)
def _back(motion: Floats, point: Floats, out: Floats) -> None:
    """A point (3,) before a motion (3, 4) carried it."""
    for i in range(3):
        out[i] = 0.0
        for j in range(3):
            out[i] += motion[j, i] * (point[j] - motion[j, 3])


@njit(cache=True)
def _way(before: Floats, after: Floats, centre: Floats, radius: float) -> float:
    """Bound (mm) of the straight way of any point in a ball between two motions (3, 4)."""
    shift, turn = 0.0, 0.0
    for i in range(3):
        d = after[i, 3] - before[i, 3]
        for j in range(3):
            step = after[i, j] - before[i, j]
            d += step * centre[j]
            turn += step * step
        shift += d * d
    return float(np.sqrt(shift) + radius * np.sqrt(0.5 * turn))  # a turn's norm is that of its matrix less one, over the root of 2


@njit(cache=True)
def _from_balls(bodies: Packed, poses: Floats, middle: Floats, a: int, b: int) -> float:
    """Lower bound (mm) of a distance: each body from the ball about the other."""
    square = 0.0
    for i in range(3):
        square += (middle[a, i] - middle[b, i]) ** 2
    best = np.sqrt(square) - bodies.radius[a] - bodies.radius[b]
    best = max(best, _of_point(bodies, poses, a, middle[b]) - bodies.radius[b])
    return float(max(best, _of_point(bodies, poses, b, middle[a]) - bodies.radius[a]))


@njit(cache=True)
def _of_point(bodies: Packed, poses: Floats, b: int, point: Floats) -> float:
    """Signed distance (mm) of a point, machine frame, from body b."""
    pose = poses[b]
    own = np.empty(3)
    _back(pose, point, own)
    points = bodies.points[bodies.first[b] : bodies.last[b]]
    return float(point_distance(bodies.kind[b], bodies.size[b], points, own[0], own[1], own[2]))


@njit(cache=True)
def _distance(bodies: Packed, poses: Floats, a: int, b: int, enough: float, at: Floats) -> float:
    """Signed distance (mm) of two bodies, or some lower bound of one above `enough`; at : (3,), gets the place, machine frame."""
    between = np.empty((3, 4))
    relative(poses[a], poses[b], between)
    own = np.zeros(3)
    gap = signed_distance(
        (bodies.kind[a], bodies.kind[b]),
        (bodies.size[a], bodies.size[b]),
        (bodies.points[bodies.first[a] : bodies.last[a]], bodies.points[bodies.first[b] : bodies.last[b]]),
        between,
        enough,
        own,
    )
    moved(poses[a], own, at)
    return float(gap)
