"""Contours as short cubics without weights, so that walls can be sampled and joined piece by piece."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.nurbs.curve import Curve

Floats = NDArray[np.float64]

LARGEST_TURN = np.radians(5.0)
"""Of one piece; on an arc it leaves the circle by 2e-11 of the radius, and directions within it are nearly linear."""
_STRAIGHT = 1e-9  # rad: a piece that turns less is a line


def short_cubics(curve: Curve) -> Curve:
    """The same curve in pieces that turn by LARGEST_TURN at most, none with weights.

    curve : of degree 3; weighted pieces are circular arcs and lines. Pieces of equal weights keep their shape exactly; on
    an arc each cubic has the arc's ends, directions and middle: off by 4/27 sin⁶(turn/4) of the radius.
    Source: Goldapp, Approximation of circular arcs by cubic polynomials, Comp. Aided Geom. Design 8 (1991).
    """
    breaks = curve.breaks
    ahead, behind = curve.derivatives(breaks[:-1], 1)[1], curve.derivatives(breaks[1:], 1, "left")[1]
    inner = curve.derivatives(0.5 * (breaks[:-1] + breaks[1:]), 1)[1]
    turn = _angle(ahead, inner) + _angle(inner, behind)
    parts = np.maximum(np.ceil(turn / LARGEST_TURN), 1).astype(np.intp)
    is_arc = np.zeros(len(parts), dtype=bool)
    if curve.weights is not None:
        weights = curve.weights[np.arange(len(parts))[:, None] * 3 + np.arange(4)]
        is_arc = np.ptp(weights, axis=1) > 1e-12 * weights.max(axis=1)
    elif (parts == 1).all():
        return curve
    piece = np.repeat(np.arange(len(parts)), parts)
    step = np.arange(len(piece)) - np.repeat(np.cumsum(parts) - parts, parts)
    u = np.append(breaks[piece] + step / parts[piece] * np.diff(breaks)[piece], breaks[-1])
    points = curve.evaluate(u)
    ahead, behind = curve.derivatives(u[:-1], 1)[1], curve.derivatives(u[1:], 1, "left")[1]
    handle_ahead, handle_behind = _handles(points, ahead, behind, np.diff(u), is_arc[piece])
    net = np.stack([points[:-1], points[:-1] + handle_ahead, points[1:] - handle_behind], axis=1)
    knots = np.concatenate([[u[0]], np.repeat(u, 3), [u[-1]]])
    return Curve(3, knots, np.vstack([net.reshape(-1, points.shape[1]), points[-1:]]))


def _handles(
    points: Floats, ahead: Floats, behind: Floats, width: Floats, is_arc: NDArray[np.bool_]
) -> tuple[Floats, Floats]:
    """Vectors from both ends of each piece to its inner Bézier points, (k, d) each."""
    turn = _angle(ahead, behind)
    chord = np.linalg.norm(np.diff(points, axis=0), axis=1)
    bends = turn > _STRAIGHT
    half = np.where(bends, 0.5 * turn, 1.0)
    radius = chord / (2.0 * np.sin(half))
    length = np.where(bends, 4.0 / 3.0 * np.tan(0.5 * half) * radius, chord / 3.0)
    found = []
    for way in (ahead, behind):
        speed = np.linalg.norm(way, axis=1)
        own = length / np.where(speed > 0.0, speed, 1.0)
        found.append(np.where(is_arc, own, width / 3.0)[:, None] * way)
    return found[0], found[1]


def _angle(first: Floats, second: Floats) -> Floats:
    """Angles between vectors (k, d) each, rad."""
    unit = [way / np.maximum(np.linalg.norm(way, axis=1), 1e-300)[:, None] for way in (first, second)]
    return np.asarray(2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(unit[1] - unit[0], axis=1), 1.0)))
