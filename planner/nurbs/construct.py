"""Exact curves from a drawing's words (line, arc, circle), and joining curves end to end."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import FitError
from planner.nurbs.curve import Curve

Floats = NDArray[np.float64]


def line(start: ArrayLike, end: ArrayLike) -> Curve:
    """The straight line from start to end, (d,) float mm each, domain (0, 1). Raises ValueError if they coincide."""
    return Curve.from_polyline(np.array([start, end], dtype=np.float64))


def arc(centre: ArrayLike, x_axis: ArrayLike, y_axis: ArrayLike, radius_mm: float, start: float, sweep: float) -> Curve:
    """An exact circular arc as a rational quadratic, domain (0, 1).

    centre        : (d,) float, mm
    x_axis, y_axis: (d,) float   Unit, at right angles: the arc's plane and its sense (from x to y).
    start, sweep  : rad; 0 < sweep <= 2 pi.
    Raises ValueError if radius or sweep is out of range. Source: Piegl & Tiller A7.1.
    """
    if not radius_mm > 0.0 or not 0.0 < sweep <= 2.0 * math.pi * (1.0 + 1e-12):
        raise ValueError(f"no arc of radius {radius_mm:g} mm sweeps {sweep:g} rad")
    pieces = max(1, math.ceil(sweep / (0.5 * math.pi) - 1e-9))
    half = 0.5 * sweep / pieces
    angles = start + half * np.arange(2 * pieces + 1)
    reach = np.where(np.arange(2 * pieces + 1) % 2 == 1, radius_mm / math.cos(half), radius_mm)
    axes = np.array([x_axis, y_axis], dtype=np.float64)
    unit = np.column_stack([np.cos(angles), np.sin(angles)])
    points = np.asarray(centre, dtype=np.float64) + (reach[:, None] * unit) @ axes
    weights = np.where(np.arange(2 * pieces + 1) % 2 == 1, math.cos(half), 1.0)
    if abs(sweep - 2.0 * math.pi) < 1e-12:
        points[-1] = points[0]
    inner = np.repeat(np.arange(pieces + 1) / pieces, 2)
    return Curve(2, np.concatenate([[0.0], inner, [1.0]]), points, weights)


def circle(centre: ArrayLike, radius_mm: float) -> Curve:
    """An exact full circle, counter-clockwise, in the plane of x and y through the centre ((2,) or (3,) float, mm)."""
    middle = np.asarray(centre, dtype=np.float64)
    return arc(middle, np.eye(len(middle))[0], np.eye(len(middle))[1], radius_mm, 0.0, 2.0 * math.pi)


def join(curves: Sequence[Curve], gap_tolerance_mm: float = 1e-6, smooth_within_mm: float | None = None) -> Curve:
    """One curve that runs through all of them in order; degrees are raised to the highest, joints are C0 knots.

    The domain starts at the first curve's start; each curve keeps the width of its domain.
    smooth_within_mm : if given, knots at the joints are removed again as long as the curve moves less than this, so
                       that joining what `Curve.split` cut gives the curve that was split.
    Raises FitError if an end does not meet the next start within the tolerance, or if there is no curve.
    """
    if not curves:
        raise FitError("no curves to join")
    degree = max(curve.degree for curve in curves)
    rational = any(curve.weights is not None for curve in curves)
    knots, rows = np.empty(0), np.empty((0, curves[0].dimension + rational))
    joints: list[float] = []
    for index, curve in enumerate(curve.with_degree(degree) for curve in curves):
        own = curve.homogeneous
        if rational and curve.weights is None:
            own = np.column_stack([own, np.ones(len(own))])
        if index == 0:
            knots, rows = curve.knots, own
            continue
        if rational:
            own = own * (rows[-1, -1] / own[0, -1])
        reached = rows[-1, :-1] / rows[-1, -1] if rational else rows[-1]
        gap = float(np.abs(curve.control_points[0] - reached).max())
        if gap > gap_tolerance_mm:
            raise FitError(f"curve {index} starts {gap:.3g} mm from the end of the one before it")
        joints.append(knots[-1])
        further = curve.knots[degree + 1 :]
        further = further if curve.knots[0] == knots[-1] else further - curve.knots[0] + knots[-1]
        knots = np.concatenate([knots[:-1], further])
        rows = np.vstack([rows, own[1:]])
    joined = Curve.from_homogeneous(degree, knots, rows, rational)
    return joined if smooth_within_mm is None else joined.without_knots(smooth_within_mm, only=joints)[0]
