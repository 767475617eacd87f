"""The cutting part of a mill as one convex solid of revolution: signed distance with its slope in place and along a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.errors import InputError

Floats = NDArray[np.float64]

_ON_AXIS = 1e-12  # mm: nearer to the axis no side is the outer one


@dataclass(frozen=True)
class CuttingEnd:
    """Flutes of an end mill (corner radius 0), bull nose, or ball mill (corner radius = radius), from the centre of its end up."""

    radius_mm: float
    corner_radius_mm: float
    flute_length_mm: float

    def __post_init__(self) -> None:
        """Raises InputError for a corner wider than the cutter or flutes shorter than two corners."""
        if not 0.0 <= self.corner_radius_mm <= self.radius_mm or not self.radius_mm > 0.0:
            raise InputError(
                f"a cutter of radius {self.radius_mm:g} mm has no corner radius of {self.corner_radius_mm:g} mm",
                "give a corner radius from 0 to the radius",
            )
        if self.flute_length_mm < 2.0 * self.corner_radius_mm:
            raise InputError(f"flutes of {self.flute_length_mm:g} mm end within the corner radius", "give longer flutes")

    @property
    def figures(self) -> tuple[float, float, float]:
        """Radius, corner radius and length of the flutes, mm."""
        return self.radius_mm, self.corner_radius_mm, self.flute_length_mm


@njit(cache=True)
def supports(
    x: float, y: float, z: float, t: float, step: Floats, cutter: tuple[float, float, float], found: Floats
) -> float:
    """Distance (mm) of a point from a cutter on its way; inside, less than 0, how deep. Convex in place and in t but for the turning.

    t : share of the way, 0 … 1   step : (12,) float   tip at its start and at its end (mm), unit axis there and there
    found : (3, 5) float   filled with values here and slopes by x, y, z and t of three functions that the distance is nowhere
        below: itself, the distance from the plane of the end (or of the upper rim), and that from the endless cylinder.
    The solid is a rectangle of the half-plane grown by the corner radius, its upper rim rounded alike, so that this is exact.
    """
    radius, corner, length = cutter
    ax = step[6] + t * (step[9] - step[6])
    ay = step[7] + t * (step[10] - step[7])
    az = step[8] + t * (step[11] - step[8])
    scale = 1.0 / np.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax * scale, ay * scale, az * scale
    vx, vy, vz = step[3] - step[0], step[4] - step[1], step[5] - step[2]
    px, py, pz = x - step[0] - t * vx, y - step[1] - t * vy, z - step[2] - t * vz
    h = px * ax + py * ay + pz * az
    qx, qy, qz = px - h * ax, py - h * ay, pz - h * az
    r = np.sqrt(qx * qx + qy * qy + qz * qz)
    if r > _ON_AXIS:
        qx, qy, qz = qx / r, qy / r, qz / r
    else:
        qx = qy = qz = 0.0
    low, high = corner - h, h - (length - corner)
    sign = -1.0 if low >= high else 1.0
    off_h, off_r = max(low, high), r - (radius - corner)
    turn = (step[9] - step[6]) * qx + (step[10] - step[7]) * qy + (step[11] - step[8]) * qz
    in_h = sign * (r * turn - vx * ax - vy * ay - vz * az)
    in_r = -(vx * qx + vy * qy + vz * qz) - h * turn
    by_h, by_r = 0.0, 1.0
    value = off_r - corner
    if off_h > 0.0 and off_r > 0.0:
        away = np.sqrt(off_h * off_h + off_r * off_r)
        value, by_h, by_r = away - corner, off_h / away, off_r / away
    elif off_h > off_r:
        value, by_h, by_r = off_h - corner, 1.0, 0.0
    _plane(found[0], value, by_h * sign * ax + by_r * qx, by_h * sign * ay + by_r * qy, by_h * sign * az + by_r * qz)
    _plane(found[1], off_h - corner, sign * ax, sign * ay, sign * az)
    _plane(found[2], off_r - corner, qx, qy, qz)
    found[0, 4], found[1, 4], found[2, 4] = by_h * in_h + by_r * in_r, in_h, in_r
    return float(value)


@njit(cache=True)
def _plane(row: Floats, value: float, x: float, y: float, z: float) -> None:
    row[0], row[1], row[2], row[3] = value, x, y, z
