"""Metal removed where a turning cutter sweeps: the stock minus the exact swept volume of a flat, bull-nose or ball end mill."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

FIELD = NDArray[np.float32]
GOLDEN = 0.6180339887498949
SEARCH_STEPS = 12  # golden sections of a piece: 0.3 % of its length remains
PARALLEL = 1e-9  # mm
UPRIGHT = 1e-9  # 1 - cosine: less than 5e-5 rad, 0.01 mm on 200 mm


@njit(cache=True, nogil=True)
def cutter_distance(radial: float, axial: float, radius: float, corner: float) -> float:
    """Signed distance (mm, negative inside) to an end mill that reaches upward for ever.

    radial, axial : distance from the axis, and height above the cutter's end, mm. corner : 0 flat, = radius ball.
    """
    r = radial - (radius - corner)
    z = corner - axial
    if r > 0.0 and z > 0.0:
        return float(np.sqrt(r * r + z * z) - corner)
    return float(max(r, z) - corner)


@njit(cache=True, nogil=True)
def swept_distance(
    side2: float, ahead: float, axial: float, length: float, lift: float, nearest: float, radius: float, corner: float
) -> float:
    """Signed distance to a cutter that moves along and across its axis at once.

    side2 : squared distance from the plane of the motion, mm2; ahead : along the motion across the axis, mm; axial : above the start, mm
    length, lift : of the motion across and along the axis, mm; nearest : share of the motion at which the axis is nearest
    The distance to a convex body that moves straight is convex in the share of the motion: a golden section finds the least.
    """
    s0 = nearest
    s1 = 0.0 if lift > 0.0 else 1.0
    a = s1 + GOLDEN * (s0 - s1)
    b = s0 + GOLDEN * (s1 - s0)
    at_a = cutter_distance(np.sqrt(side2 + (ahead - a * length) ** 2), axial - a * lift, radius, corner)
    at_b = cutter_distance(np.sqrt(side2 + (ahead - b * length) ** 2), axial - b * lift, radius, corner)
    for _ in range(SEARCH_STEPS):
        if at_a < at_b:
            s1, b, at_b = b, a, at_a
            a = s1 + GOLDEN * (s0 - s1)
            at_a = cutter_distance(np.sqrt(side2 + (ahead - a * length) ** 2), axial - a * lift, radius, corner)
        else:
            s0, a, at_a = a, b, at_b
            b = s0 + GOLDEN * (s1 - s0)
            at_b = cutter_distance(np.sqrt(side2 + (ahead - b * length) ** 2), axial - b * lift, radius, corner)
    return float(min(at_a, at_b))


@njit(cache=True, nogil=True)
def swept_box(
    shape: tuple[int, int, int], origin: NDArray[np.float64], cell: float, band: float,
    start: NDArray[np.float64], end: NDArray[np.float64], axis: NDArray[np.float64], radius: float, reach: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:  # fmt: skip
    """First and last index, (3,) each, of the cells that a piece of path can change."""
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    for d in range(3):
        side = radius * np.sqrt(max(0.0, 1.0 - axis[d] * axis[d])) + band
        least = min(start[d], end[d]) + min(0.0, axis[d] * reach) - side
        most = max(start[d], end[d]) + max(0.0, axis[d] * reach) + side
        low[d] = max(0, int(np.floor((least - origin[d]) / cell)))
        high[d] = min(shape[d] - 1, int(np.ceil((most - origin[d]) / cell)))
    return low, high


@njit(cache=True, nogil=True)
def remove_piece(
    field: FIELD, origin: NDArray[np.float64], cell: float, band: float, top: int,
    start: NDArray[np.float64], end: NDArray[np.float64], axis: NDArray[np.float64], radius: float, corner: float, reach: float,
) -> float:  # fmt: skip
    """Cut along one straight piece with constant axis, exactly.

    field : (nx, ny, nz) float32, mm   Changed in place.   top : index along z above which the field holds no metal
    origin : (3,) float, mm; start, end : (3,) float, mm, cutter end; axis : (3,) float, unit vector from the end to the spindle
    reach : mm   Length of the cutter above its end.
    Returns the greatest depth at which the cutter met metal, mm (0: cut air).
    """
    low, high = swept_box(field.shape, origin, cell, band, start, end, axis, radius, reach)
    along = end - start
    lift = along[0] * axis[0] + along[1] * axis[1] + along[2] * axis[2]
    across = along - lift * axis
    length = np.sqrt(across[0] ** 2 + across[1] ** 2 + across[2] ** 2)
    oblique = length > PARALLEL and abs(lift) > PARALLEL
    across = across / length if length > PARALLEL else 0.0 * across
    upright = axis[2] > 1.0 - UPRIGHT
    widest2 = (radius + band + cell) ** 2
    deepest = 0.0
    for i in range(low[0], high[0] + 1):
        dx = origin[0] + i * cell - start[0]
        for j in range(low[1], high[1] + 1):
            dy = origin[1] + j * cell - start[1]
            if upright:
                ahead = dx * across[0] + dy * across[1]
                past = ahead - min(length, max(0.0, ahead))
                if dx * dx + dy * dy - ahead * ahead + past * past > widest2:
                    continue
            for k in range(low[2], min(high[2], top) + 1):
                value = field[i, j, k]
                if value >= band:
                    continue
                dz = origin[2] + k * cell - start[2]
                axial = dx * axis[0] + dy * axis[1] + dz * axis[2]
                if axial - max(lift, 0.0) > reach:
                    continue
                ahead = dx * across[0] + dy * across[1] + dz * across[2]
                side2 = max(0.0, dx * dx + dy * dy + dz * dz - axial * axial - ahead * ahead)
                past = ahead - min(length, max(0.0, ahead))
                # nearest to the axis and highest above the end: no share of the motion brings the cutter closer
                inside = -cutter_distance(np.sqrt(side2 + past * past), axial - min(0.0, lift), radius, corner)
                if inside > value and oblique:
                    inside = -swept_distance(side2, ahead, axial, length, lift, (ahead - past) / length, radius, corner)
                if inside > value:
                    if inside > 0.0 and value < 0.0:
                        deepest = max(deepest, min(inside, -value))
                    field[i, j, k] = min(band, inside)
    return float(deepest)
