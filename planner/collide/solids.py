"""Distance between two bodies of a cell that stand somewhere, and how far a body moves."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.collide.bodies import Packed
from planner.collide.carriers import moved, relative
from planner.collide.convex import point_distance
from planner.collide.gjk import signed_distance

Floats = NDArray[np.float64]


@njit(cache=True)
def back(motion: Floats, point: Floats, out: Floats) -> None:
    """A point (3,) before a motion (3, 4) carried it."""
    for i in range(3):
        out[i] = 0.0
        for j in range(3):
            out[i] += motion[j, i] * (point[j] - motion[j, 3])


@njit(cache=True)
def way_of(before: Floats, after: Floats, centre: Floats, radius: float) -> float:
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
def ball_bound(bodies: Packed, poses: Floats, middle: Floats, a: int, b: int) -> float:
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
    back(pose, point, own)
    points = bodies.points[bodies.first[b] : bodies.last[b]]
    return float(point_distance(bodies.kind[b], bodies.size[b], points, own[0], own[1], own[2]))


@njit(cache=True)
def pair_distance(bodies: Packed, poses: Floats, a: int, b: int, enough: float, at: Floats) -> float:
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
