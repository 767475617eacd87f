"""Where a contour has a corner, judged by its points alone (a mesh's crease edges know better, where there is one)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def turning_angles(points: ArrayLike, *, closed: bool) -> Floats:
    """The angle by which the contour turns at each point: (n,) float, rad, 0 ... pi; 0 at open ends.

    points : (n, d) float, mm   Neighbours differ.
    """
    path = np.asarray(points, dtype=np.float64)
    sides = np.roll(path, -1, axis=0) - path
    directions = sides / np.maximum(np.linalg.norm(sides, axis=1), 1e-300)[:, None]
    before = np.roll(directions, 1, axis=0)
    half = 0.5 * np.linalg.norm(directions - before, axis=1)
    angles = 2.0 * np.arctan2(half, 0.5 * np.linalg.norm(directions + before, axis=1))
    if not closed:
        angles[[0, -1]] = 0.0
    return np.asarray(angles)


def by_turning_angle(points: ArrayLike, angle_deg: float, *, closed: bool = True) -> NDArray[np.bool_]:
    """Which points turn by more than the angle: (n,) bool."""
    return np.asarray(turning_angles(points, closed=closed) > np.radians(angle_deg))
