"""Exact surfaces from a drawing's words: plane, cylinder, cone, sphere, torus; extruded, ruled and revolved ones."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.nurbs.construct import arc, line
from planner.nurbs.curve import Curve
from planner.nurbs.ruled import RuledSurface
from planner.nurbs.surface import Surface

Floats = NDArray[np.float64]

FULL_TURN = 2.0 * math.pi
_LINEAR = np.array([0.0, 0.0, 1.0, 1.0])


def plane(corner: ArrayLike, side_u: ArrayLike, side_v: ArrayLike) -> Surface:
    """The parallelogram corner + u side_u + v side_v, domain (0, 1) x (0, 1), normal along side_u x side_v.

    corner, side_u, side_v : (3,) float, mm   Raises ValueError if the sides are parallel.
    """
    start, along, across = (np.asarray(part, dtype=np.float64) for part in (corner, side_u, side_v))
    if np.linalg.norm(np.cross(along, across)) <= 1e-14 * np.linalg.norm(along) * np.linalg.norm(across):
        raise ValueError("the sides of a plane must not be parallel")
    net = np.array([[start, start + across], [start + along, start + along + across]])
    return Surface(1, 1, _LINEAR, _LINEAR, net)


def extruded(curve: Curve, way: ArrayLike) -> Surface:
    """All points of the curve moved by 0 ... 1 times the way: S(u, v) = C(u) + v way.

    curve : 3-D   way : (3,) float, mm   Raises ValueError if the curve is not in space. Source: P&T ch. 8.3.
    """
    _in_space(curve)
    net = np.stack([curve.control_points, curve.control_points + np.asarray(way, dtype=np.float64)], axis=1)
    weights = None if curve.weights is None else np.stack([curve.weights, curve.weights], axis=1)
    return Surface(curve.degree, 1, curve.knots, _LINEAR, net, weights)


def ruled(first: Curve, second: Curve) -> Surface:
    """All straight lines between points of equal parameter of two curves: v = 0 is the first, v = 1 the second.

    Both are brought onto a common basis and the domain (0, 1). Where their weights at one u differ, v runs unevenly
    along that ruling; the ruling is the same line. Raises FitError if a curve is not in space.
    Source: paper Eq. 19; Piegl & Tiller ch. 8.3.
    """
    return RuledSurface(first, second).as_surface()


def revolved(profile: Curve, point: ArrayLike, axis: ArrayLike, sweep: float = FULL_TURN) -> Surface:
    """The profile turned about an axis: u runs round it from the profile on, v along the profile, both exact.

    profile : 3-D   point : (3,) float, mm, on the axis   axis : (3,) float, any length   sweep : rad, 0 ... 2 pi
    The normal S_u x S_v points away from the axis where the profile runs along the axis.
    Raises ValueError if the profile is not in space, the axis has no length or the sweep is out of range.
    Source: Piegl & Tiller A8.1.
    """
    _in_space(profile)
    direction = _unit(axis)
    turn = arc((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), 1.0, 0.0, sweep)
    base = np.asarray(point, dtype=np.float64)
    arm = profile.control_points - base
    foot = base + (arm @ direction)[:, None] * direction
    out = profile.control_points - foot
    side = np.cross(direction, out)
    cos, sin = turn.control_points[:, 0, None, None], turn.control_points[:, 1, None, None]
    net = foot + cos * out + sin * side
    around = turn.weights if turn.weights is not None else np.ones(len(net))
    along = np.ones(len(foot)) if profile.weights is None else profile.weights
    return Surface(2, profile.degree, turn.knots, profile.knots, net, around[:, None] * along)


def cylinder(centre: ArrayLike, axis: ArrayLike, radius_mm: float, height_mm: float) -> Surface:
    """The side of a cylinder that stands on the centre, normals outward; u round it, v along the axis.

    Raises ValueError if radius or height is not positive or the axis has no length.
    """
    return cone(centre, axis, radius_mm, radius_mm, height_mm)


def cone(centre: ArrayLike, axis: ArrayLike, radius0_mm: float, radius1_mm: float, height_mm: float) -> Surface:
    """The side of a cone (or of a frustum) with radius0 at the centre and radius1 at the height, normals outward.

    Raises ValueError if a radius is negative, both are zero, the height is not positive or the axis has no length.
    """
    if min(radius0_mm, radius1_mm) < 0.0 or not max(radius0_mm, radius1_mm) > 0.0 or not height_mm > 0.0:
        raise ValueError(f"no cone of radii {radius0_mm:g}, {radius1_mm:g} mm and height {height_mm:g} mm")
    base, up = np.asarray(centre, dtype=np.float64), _unit(axis)
    out = _across(up)
    return revolved(line(base + radius0_mm * out, base + radius1_mm * out + height_mm * up), base, up)


def sphere(centre: ArrayLike, radius_mm: float) -> Surface:
    """The whole sphere, normals outward: u round the z axis, v from the south pole to the north pole.

    Raises ValueError if the radius is not positive.
    """
    middle = np.asarray(centre, dtype=np.float64)
    profile = arc(middle, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), radius_mm, -0.5 * math.pi, math.pi)
    return revolved(profile, middle, (0.0, 0.0, 1.0))


def torus(centre: ArrayLike, axis: ArrayLike, radius_mm: float, tube_radius_mm: float) -> Surface:
    """The whole torus, normals outward: u round the axis, v round the tube from its outermost circle on.

    radius_mm : from the axis to the middle of the tube   Raises ValueError unless radius > tube radius > 0.
    """
    if not radius_mm > tube_radius_mm > 0.0:
        raise ValueError(f"no torus of radius {radius_mm:g} mm has a tube of radius {tube_radius_mm:g} mm")
    middle, up = np.asarray(centre, dtype=np.float64), _unit(axis)
    out = _across(up)
    return revolved(arc(middle + radius_mm * out, out, up, tube_radius_mm, 0.0, FULL_TURN), middle, up)


def _unit(vector: ArrayLike) -> Floats:
    direction = np.asarray(vector, dtype=np.float64)
    length = float(np.linalg.norm(direction))
    if not length > 0.0:
        raise ValueError("an axis must have a length")
    return direction / length


def _across(axis: Floats) -> Floats:
    """A unit vector at right angles to the axis: x where the axis is z."""
    start = np.eye(3)[0 if abs(axis[0]) < 0.9 else 1]
    return _unit(start - (start @ axis) * axis)


def _in_space(curve: Curve) -> None:
    if curve.dimension != 3:
        raise ValueError(f"a surface in space needs curves in space, not in {curve.dimension} dimensions")
