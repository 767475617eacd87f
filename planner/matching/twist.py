"""How far a ruled wall is from developable: the turn of its normal along each ruling."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.nurbs.curve import Curve
from planner.nurbs.ruled import RuledSurface

Floats = NDArray[np.float64]

_STANDING = 1e-5  # of the contour's length: a piece shorter than this is a point that a fan of rulings leaves


def ruling_twists(surface: RuledSurface) -> Floats:
    """Angle between the normals at both ends of the rulings in the middle of every piece: (k,) float, rad, 0 … pi / 2.

    Where a piece of one contour is a point, the rulings are a fan: its normal there is that of the other end.
    """
    breaks = surface.curve0.breaks
    u = 0.5 * (breaks[1:] + breaks[:-1])
    across = surface.curve1.evaluate(u) - surface.curve0.evaluate(u)
    along0, along1 = surface.curve0.derivatives(u, 1)[1], surface.curve1.derivatives(u, 1)[1]
    fixed0, fixed1 = _is_point(along0, surface.curve0, breaks), _is_point(along1, surface.curve1, breaks)
    first = np.cross(np.where(fixed0[:, None], along1, along0), across)
    second = np.cross(np.where(fixed1[:, None], along0, along1), across)
    sine = np.linalg.norm(np.cross(first, second), axis=1)
    cosine = np.abs(np.einsum("ij,ij->i", first, second))
    return np.asarray(np.where(fixed0 & fixed1, 0.0, np.arctan2(sine, np.maximum(cosine, 1e-300))))


def _is_point(along: Floats, curve: Curve, breaks: Floats) -> NDArray[np.bool_]:
    """Whether the curve stands still in each piece."""
    net = curve.control_points
    size = float(np.linalg.norm(np.diff(net, axis=0), axis=1).sum())
    return np.asarray(np.linalg.norm(along, axis=1) * np.diff(breaks) <= _STANDING * size)


def largest_twist(surface: RuledSurface) -> float:
    """The largest of `ruling_twists`, rad."""
    return float(ruling_twists(surface).max(initial=0.0))


def has_fans(surface: RuledSurface) -> bool:
    """Whether one contour stands still somewhere while the other goes on: a corner that a fan of rulings leaves."""
    breaks = surface.curve0.breaks
    u = 0.5 * (breaks[1:] + breaks[:-1])
    still = [_is_point(curve.derivatives(u, 1)[1], curve, breaks) for curve in (surface.curve0, surface.curve1)]
    return bool((still[0] != still[1]).any())
