"""What light and powder meet under the head: distance of the surface from the focus, and how steeply they fall on it."""

from __future__ import annotations

import numpy as np
from numba import njit

from sim.process.field import Blocks, distance_at

CLIMB_MM = 20.0  # metal above the focus is followed this far
FALL_MM = 15.0  # below it: farther from the focus the powder is too spread for a bead
STEP_SHARE = 0.7  # of the distance, along a ray: the stock's values may be too great beside a step
LEAST_STEP_CELLS = 0.25
STEEPEST = 3.0  # slope: beyond it a step was met, not a surface


@njit(cache=True, nogil=True)
def surface_on_ray(
    blocks: Blocks, x: float, y: float, z: float, ax: float, ay: float, az: float
) -> float:
    """Height (mm) of the first surface along the tool axis from a point in the plane of the focus; -inf: none within reach.

    From a point in air downwards, from a point in metal upwards to where it ends.
    """
    least = LEAST_STEP_CELLS * blocks.size[0]
    at = blocks.size[0]
    value = distance_at(blocks, x + at * ax, y + at * ay, z + at * az)
    way = -1.0 if value >= 0.0 else 1.0
    while -FALL_MM < at < CLIMB_MM:
        step = max(STEP_SHARE * abs(value), least)
        further = at + way * step
        there = distance_at(blocks, x + further * ax, y + further * ay, z + further * az)
        if (there < 0.0) != (value < 0.0):
            return float(at + (further - at) * value / (value - there))
        at, value = further, there
    return float(-np.inf if way < 0.0 else at)


@njit(cache=True, nogil=True)
def meet(
    blocks: Blocks, x: float, y: float, z: float, ax: float, ay: float, az: float,
    tx: float, ty: float, tz: float, radius: float, reach: float,
) -> tuple[float, float, float]:  # fmt: skip
    """What the spot meets: height of the surface above the focus (mm), cosine of incidence, height of the plane that the pool settles at.

    x, y, z : focus   ax .. : tool axis   tx .. : direction of travel across it, zero at standstill   radius : of the pool, mm
    reach : mm   A surface within it of the focus is what the bead was meant for: the plane stays that of the focus (0).
    Ahead of the pool, since beneath it lies its own metal; -inf for a surface out of reach: nothing is met.
    """
    if tx == 0.0 and ty == 0.0 and tz == 0.0:
        under = surface_on_ray(blocks, x, y, z, ax, ay, az)
        return under, 1.0, under if abs(under) > reach else 0.0
    sx, sy, sz = ay * tz - az * ty, az * tx - ax * tz, ax * ty - ay * tx
    half = 0.5 * radius
    fx, fy, fz = x + radius * tx, y + radius * ty, z + radius * tz
    left = surface_on_ray(blocks, fx + half * sx, fy + half * sy, fz + half * sz, ax, ay, az)
    front = surface_on_ray(blocks, fx, fy, fz, ax, ay, az)
    right = surface_on_ray(blocks, fx - half * sx, fy - half * sy, fz - half * sz, ax, ay, az)
    total, found, deep, deeper = 0.0, 0, 0.0, 0
    for height in (left, front, right):
        if abs(height) <= reach:
            total += height
            found += 1
        elif height > -np.inf:
            deep += height
            deeper += 1
    if found == 0:
        under = surface_on_ray(blocks, x, y, z, ax, ay, az)
        if abs(under) <= reach:
            return 0.0, 1.0, 0.0
        if deeper == 0:
            return under, 1.0, under
        total, found = deep, deeper
    mean = total / found
    plane = mean if abs(mean) > reach else 0.0
    if found < 3 and plane == 0.0:
        return mean, 1.0, plane
    ahead = surface_on_ray(blocks, fx + 2.0 * radius * tx, fy + 2.0 * radius * ty, fz + 2.0 * radius * tz, ax, ay, az)
    across = (left - right) / radius
    along = (ahead - front) / (2.0 * radius)
    across = across if abs(across) < STEEPEST else 0.0
    along = along if abs(along) < STEEPEST else 0.0
    return mean, 1.0 / np.sqrt(1.0 + across * across + along * along), plane
