"""True bounding boxes of surfaces: branch and bound over the control points of ever smaller Bézier patches."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.nurbs.surface_patches import BezierPatches, halve_columns, halve_rows

Floats = NDArray[np.float64]

_CLOSE = 4e-15  # share of the largest coordinate below which hull and surface count as the same
_DEPTH = 110  # halvings: a patch is then shorter than rounding in both directions


def box_of_patches(patches: BezierPatches) -> tuple[Floats, Floats]:
    """Smallest and largest coordinates of the surface itself: two (d,) float, mm, to rounding.

    A patch lies in the hull of its control points and touches its four corners; patches whose hull reaches no further
    than what was found are dropped, others halved across the direction in which their control points differ most.
    """
    low, high = np.empty(patches.dimension), np.empty(patches.dimension)
    for axis in range(patches.dimension):
        weights = patches.nets[..., -1] if patches.rational else np.ones(patches.nets.shape[:-1])
        pair = np.stack([patches.nets[..., axis], weights], axis=-1)
        high[axis] = _largest(pair)
        low[axis] = -_largest(pair * [-1.0, 1.0])
    return low, high


@njit(cache=True, error_model="numpy", nogil=True)
def _corner(net: Floats) -> float:
    """Largest value at the four corners of a patch (p+1, q+1, 2: value times weight, weight)."""
    best = -np.inf
    for i in (0, net.shape[0] - 1):
        for j in (0, net.shape[1] - 1):
            best = max(best, net[i, j, 0] / net[i, j, 1])
    return best


@njit(cache=True, error_model="numpy", nogil=True)
def _reach(net: Floats) -> tuple[float, bool]:
    """Largest control value of a patch, and whether they differ more along the first direction."""
    reach, along, across = -np.inf, 0.0, 0.0
    for i in range(net.shape[0]):
        for j in range(net.shape[1]):
            value = net[i, j, 0] / net[i, j, 1]
            reach = max(reach, value)
            if i > 0:
                along = max(along, abs(value - net[i - 1, j, 0] / net[i - 1, j, 1]))
            if j > 0:
                across = max(across, abs(value - net[i, j - 1, 0] / net[i, j - 1, 1]))
    return reach, along >= across


@njit(cache=True, error_model="numpy", nogil=True)
def _largest(nets: Floats) -> float:
    """Largest value of one coordinate over patches (s, p+1, q+1, 2)."""
    best, size = -np.inf, 0.0
    for k in range(len(nets)):
        corner = _corner(nets[k])
        best, size = max(best, corner), max(size, abs(corner))
    close = _CLOSE * size
    stack, depths = np.empty((_DEPTH + 2, nets.shape[1], nets.shape[2], 2)), np.empty(_DEPTH + 2, dtype=np.intp)
    for k in range(len(nets)):
        stack[0], depths[0] = nets[k], 0
        height = 1
        while height > 0:
            top = height - 1
            reach, along = _reach(stack[top])
            if reach <= best + close or depths[top] >= _DEPTH:
                height -= 1
                continue
            if along:
                halve_rows(stack[top], stack[height], stack[top])
            else:
                halve_columns(stack[top], stack[height], stack[top])
            best = max(best, _corner(stack[top]), _corner(stack[height]))
            depths[top] += 1
            depths[height] = depths[top]
            height += 1
    return best
