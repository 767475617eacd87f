"""Where head and cutter can be: the least clearance of a tool in many poses from the part as it stands and from the plate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from planner.collide.plate import plate_clearance
from planner.collide.points import LEAF, PointTree, surface_points
from planner.collide.revolution import Pose, distance, frustums, outline
from planner.collide.shapes import CutterShape, HeadShape, Shape
from planner.errors import InputError
from planner.mesh.mesh import Mesh

__all__ = ["CutterShape", "HeadShape", "PointTree", "Reach", "Shape", "reach", "surface_points"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PLATE = -1
"""In `Reach.nearest`: the plate."""
NOTHING = -2
"""In `Reach.nearest`: there is nothing to meet."""
_PITCH_MM = 1.0  # of a mesh's samples: half a bead
_TOUCH_MM = 1e-6  # rounding: what touches is free


@dataclass(frozen=True, eq=False)
class Reach:
    """What a tool has around it in each pose.

    free : (n,) bool   nothing is nearer than asked   clearance_mm : (n,) float, less than 0 how deep it is in
    nearest : (n,) int64   row of the obstacle that is nearest, PLATE, or NOTHING where there is none
    """

    free: NDArray[np.bool_]
    clearance_mm: Floats
    nearest: Ints


def reach(
    tips: ArrayLike,
    axes: ArrayLike,
    obstacles: PointTree | Mesh | ArrayLike,
    plate: tuple[float, float] | None,
    shape: Shape,
    *,
    clearance_mm: float = 0.0,
    enough_mm: float = np.inf,
) -> Reach:
    """The least clearance of a tool from obstacle points and from the plate, in every pose.

    tips, axes : (n, 3) float, mm and 1, the tool's tip and its unit axis from the tip into the head, build frame
    obstacles : (m, 3) float, mm, points of what stands; or a mesh, sampled every 1 mm; or a `PointTree` to use many times
    plate : (width, depth) in x and y of the plate about the origin, top at z = 0, solid below; None: no plate
    clearance_mm : a pose is free if nothing is nearer; 0: it may touch
    enough_mm : what is farther is not looked for: a clearance of more is given as this, from NOTHING; saves time
    Raises InputError if the arrays do not fit together or an axis is not a unit vector.
    """
    poses = _poses(tips, axes)
    tree = obstacles if isinstance(obstacles, PointTree) else PointTree.over(_points_of(obstacles))
    half = (-1.0, -1.0) if plate is None else (0.5 * float(plate[0]), 0.5 * float(plate[1]))
    profile = shape.profile
    least, place = _least(poses, outline(profile), frustums(profile), tree.points, tree.balls, half, enough_mm)
    nearest = np.where(place >= 0, tree.order[place] if len(tree.order) else place, place)
    return Reach(least >= clearance_mm - _TOUCH_MM, least, nearest)


def _poses(tips: ArrayLike, axes: ArrayLike) -> Floats:
    """(n, 6) float, tip and axis of each pose.  Raises InputError if they are not (n, 3) each with unit axes."""
    points = np.ascontiguousarray(tips, dtype=np.float64)
    directions = np.ascontiguousarray(axes, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or directions.shape != points.shape:
        raise InputError(f"tips and axes are (n, 3) each, not {points.shape} and {directions.shape}", "give one axis per tip")
    length = np.sqrt(np.einsum("ij,ij->i", directions, directions))
    if not (np.isfinite(points).all() and (np.abs(length - 1.0) <= 1e-6).all()):
        raise InputError("a tip is not finite or an axis is no unit vector", "normalise the axes")
    return np.hstack([points, directions / length[:, None]])


def _points_of(obstacles: Mesh | ArrayLike) -> Floats:
    if isinstance(obstacles, Mesh):
        return surface_points(obstacles, _PITCH_MM)
    given = np.asarray(obstacles, dtype=np.float64)
    return given.reshape(0, 3) if given.size == 0 else given


@njit(cache=True)
def _least(
    poses: Floats,
    pieces: Floats,
    solids: Floats,
    points: Floats,
    balls: Floats,
    half: tuple[float, float],
    enough: float,
) -> tuple[Floats, Ints]:
    """Least clearance of every pose and the row of `points` that it is from (PLATE, NOTHING).

    Neighbouring poses mostly have the same nearest point: each begins with that of the pose before.
    """
    least = np.empty(len(poses))
    nearest = np.full(len(poses), NOTHING)
    stack, bounds = np.empty(64, dtype=np.int64), np.empty(64)
    warm = 0
    for i in range(len(poses)):
        pose = (poses[i, 0], poses[i, 1], poses[i, 2], poses[i, 3], poses[i, 4], poses[i, 5])
        best, place = enough, NOTHING
        if len(points):
            best, place = _nearest_point(pose, pieces, points, balls, warm, best, stack, bounds)
            warm = max(place, 0)
        if half[0] >= 0.0:
            plate = plate_clearance(pose, solids, half[0], half[1], best)
            if plate < best:
                best, place = plate, PLATE
        least[i], nearest[i] = best, place
    return least, nearest


@njit(cache=True)
def _nearest_point(
    pose: Pose, pieces: Floats, points: Floats, balls: Floats, warm: int, best: float, stack: Ints, bounds: Floats
) -> tuple[float, int]:
    """Least signed distance of the points and its row; the given best and NOTHING if no point is nearer.

    A ball can hold nothing nearer than its centre's signed distance less its radius, since that distance is 1-Lipschitz.
    """
    leaf_from = (len(balls) - 1) // 2
    place = NOTHING
    d = distance(points[warm, 0], points[warm, 1], points[warm, 2], pose, pieces)
    if d < best:
        best, place = d, warm
    stack[0], bounds[0] = 0, -np.inf
    count = 1
    while count:
        count -= 1
        if bounds[count] >= best:
            continue
        node = stack[count]
        if node >= leaf_from:
            for row in range((node - leaf_from) * LEAF, (node - leaf_from + 1) * LEAF):
                d = distance(points[row, 0], points[row, 1], points[row, 2], pose, pieces)
                if d < best:
                    best, place = d, row
            continue
        near, far = 2 * node + 1, 2 * node + 2
        at_near = distance(balls[near, 0], balls[near, 1], balls[near, 2], pose, pieces) - balls[near, 3]
        at_far = distance(balls[far, 0], balls[far, 1], balls[far, 2], pose, pieces) - balls[far, 3]
        if at_far < at_near:
            near, far, at_near, at_far = far, near, at_far, at_near
        if at_far < best:
            stack[count], bounds[count] = far, at_far
            count += 1
        if at_near < best:
            stack[count], bounds[count] = near, at_near
            count += 1
    return best, place
