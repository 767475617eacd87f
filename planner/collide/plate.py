"""Clearance of a solid of revolution from the plate: the box below z = 0 under a rectangle about the origin."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.collide.revolution import Pose, distance

Floats = NDArray[np.float64]

_GOLDEN = 0.6180339887498949
_SECTIONS = 26  # of a golden section: its bracket is 4e-6 of the plate in the end, and no distance changes faster than 1
_DEEP_MM = 400.0  # of the plate's sides: longer than any tool is, a tool that passes under it meets a side
_TOP = 2


@njit(cache=True)
def plate_clearance(pose: Pose, solids: Floats, half_x: float, half_y: float, best: float) -> float:
    """Least distance (mm) of a tool from the plate, less than 0 where it cuts in; `best` if it is no nearer than that.

    solids : (f, 3, 6) float, of `revolution.frustums`   half_x, half_y : mm, the rectangle's half sides.
    Where the lowest point of a frustum stands over the rectangle the answer is its height, how deep it is for a tool that
    cuts in; elsewhere it is the least signed distance of the rectangle's (and, below z = 0, its sides') points from the
    frustum: a frustum is convex, so its signed distance has one minimum over a plane face.
    """
    lowest = np.inf
    for k in range(len(solids)):
        low, over = _lowest(pose, solids[k, 1, 0], solids[k, 1, 1], half_x, half_y)
        end, over_end = _lowest(
            pose, solids[k, 1, 0] + solids[k, 1, 2], solids[k, 1, 1] + solids[k, 1, 3], half_x, half_y
        )
        if end < low:
            low, over = end, over_end
        lowest = min(lowest, low)
        if low < best:
            best = min(best, low if over else _over_face(pose, solids[k], half_x, half_y, _TOP, 0.0))
    if lowest < 0.0 < best:
        for k in range(len(solids)):
            for side in (-1.0, 1.0):
                best = min(best, _over_face(pose, solids[k], half_x, half_y, 0, side * half_x))
                best = min(best, _over_face(pose, solids[k], half_x, half_y, 1, side * half_y))
    return float(best)


@njit(cache=True)
def _lowest(pose: Pose, height: float, radius: float, half_x: float, half_y: float) -> tuple[float, bool]:
    """z of the lowest point of a circle of the solid, mm, and whether it stands over the rectangle."""
    up = pose[5]
    level = np.sqrt(max(1.0 - up * up, 0.0))
    x, y = pose[0] + height * pose[3], pose[1] + height * pose[4]
    z = pose[2] + height * up - radius * level
    if level < 1e-9:  # the whole disc is as low
        beside_x, beside_y = max(abs(x) - half_x, 0.0), max(abs(y) - half_y, 0.0)
        return z, beside_x * beside_x + beside_y * beside_y <= radius * radius
    x += radius * pose[3] * up / level
    y += radius * pose[4] * up / level
    return z, abs(x) <= half_x and abs(y) <= half_y


@njit(cache=True)
def _over_face(pose: Pose, pieces: Floats, half_x: float, half_y: float, face: int, level: float) -> float:
    """Least signed distance of the points of a face from a frustum: face _TOP at z = 0, 0 at x = level, 1 at y = level."""
    low, high = (-half_y, half_y) if face == 0 else (-half_x, half_x)
    low1, high1 = (-half_y, half_y) if face == _TOP else (-_DEEP_MM, 0.0)
    a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_a = _across(pose, pieces, face, level, a, low1, high1)
    at_b = _across(pose, pieces, face, level, b, low1, high1)
    best = min(at_a, at_b)
    for _ in range(_SECTIONS):
        if at_a < at_b:
            high, b, at_b = b, a, at_a
            a = high - _GOLDEN * (high - low)
            at_a = _across(pose, pieces, face, level, a, low1, high1)
        else:
            low, a, at_a = a, b, at_b
            b = low + _GOLDEN * (high - low)
            at_b = _across(pose, pieces, face, level, b, low1, high1)
        best = min(best, at_a, at_b)
    return float(best)


@njit(cache=True)
def _across(pose: Pose, pieces: Floats, face: int, level: float, first: float, low: float, high: float) -> float:
    """Least signed distance on the line of a face at its first coordinate, by golden section."""
    a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_a = _on_face(pose, pieces, face, level, first, a)
    at_b = _on_face(pose, pieces, face, level, first, b)
    best = min(at_a, at_b)
    for _ in range(_SECTIONS):
        if at_a < at_b:
            high, b, at_b = b, a, at_a
            a = high - _GOLDEN * (high - low)
            at_a = _on_face(pose, pieces, face, level, first, a)
        else:
            low, a, at_a = a, b, at_b
            b = low + _GOLDEN * (high - low)
            at_b = _on_face(pose, pieces, face, level, first, b)
        best = min(best, at_a, at_b)
    return float(best)


@njit(cache=True)
def _on_face(pose: Pose, pieces: Floats, face: int, level: float, first: float, second: float) -> float:
    """Signed distance of one point of a face from a frustum."""
    if face == _TOP:
        return float(distance(first, second, 0.0, pose, pieces))
    if face == 0:
        return float(distance(level, first, second, pose, pieces))
    return float(distance(first, level, second, pose, pieces))
