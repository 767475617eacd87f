"""Signed distance to a solid of revolution, in its half-plane: exact, and 1-Lipschitz in space."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Pose = tuple[float, float, float, float, float, float]
"""Tip (mm) and unit axis."""


def outline(profile: Floats) -> Floats:
    """(k, 6) float: the straight pieces of a solid's outline in its half-plane, from the axis round to the axis.

    profile : (k - 1, 2) float, mm, see `Shape.profile`.  Columns: height and radius (mm) of a piece's beginning, its run along
    both (mm), one over its squared length (1/mm², 0 for a piece without length), its rise of radius by height (0: none).
    """
    corners = np.vstack([[profile[0, 0], 0.0], profile, [profile[-1, 0], 0.0]])
    run = np.diff(corners, axis=0)
    square = (run * run).sum(axis=1)
    inverse = np.divide(1.0, square, out=np.zeros(len(run)), where=square > 0.0)
    slope = np.divide(run[:, 1], run[:, 0], out=np.zeros(len(run)), where=run[:, 0] > 0.0)
    return np.column_stack([corners[:-1], run, inverse, slope])


def frustums(profile: Floats) -> Floats:
    """(f, 3, 6) float: the outline of each frustum of a profile by itself; each is convex."""
    pairs = [profile[k : k + 2] for k in range(len(profile) - 1) if profile[k + 1, 0] > profile[k, 0]]
    return np.array([outline(pair) for pair in pairs])


@njit(cache=True)
def half_plane_distance(h: float, r: float, pieces: Floats) -> float:
    """Distance (mm) of a point from a solid; inside, less than 0, how deep.

    h, r : mm, height of the point along the axis and distance from it   pieces : (k, 6) float, of `outline`
    The nearest point of a solid of revolution lies in the half-plane through the axis and the point, so that this is exact.
    """
    least = np.inf
    inside = False
    for k in range(len(pieces)):
        off_h, off_r = h - pieces[k, 0], r - pieces[k, 1]
        run_h, run_r = pieces[k, 2], pieces[k, 3]
        if run_h > 0.0 and 0.0 <= off_h <= run_h and off_r <= pieces[k, 5] * off_h:
            inside = True
        t = min(max((off_h * run_h + off_r * run_r) * pieces[k, 4], 0.0), 1.0)
        off_h -= t * run_h
        off_r -= t * run_r
        least = min(least, off_h * off_h + off_r * off_r)
    return float(-np.sqrt(least) if inside else np.sqrt(least))


@njit(cache=True)
def distance(x: float, y: float, z: float, pose: Pose, pieces: Floats) -> float:
    """As `half_plane_distance`, of a point in space (mm) from the solid in a pose."""
    px, py, pz = x - pose[0], y - pose[1], z - pose[2]
    h = px * pose[3] + py * pose[4] + pz * pose[5]
    qx, qy, qz = px - h * pose[3], py - h * pose[4], pz - h * pose[5]
    return float(half_plane_distance(h, np.sqrt(qx * qx + qy * qy + qz * qz), pieces))
