"""How the head is tilted over overhang: from the layer's direction towards the tangent of the side surface (paper II, Fig. 3b)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate
from planner.process import Settings
from planner.toolpath.motion import Motion

Floats = NDArray[np.float64]

MARGIN_DEG = 5.0
"""A bead is tilted by so much more than its wall leans beyond what holds without."""
ALONG_FROM_DEG = 45.0
LEAST_ALONG_DEG = 55.0
"""Walls that lean more than the first are built along their tangent, as far as the material allows, and by no less than the
second: what a bead hangs out by grows faster with the lean than a small tilt takes back."""
TURN_DEG_S = 120.0
"""How fast the tool axis is turned about the layer's direction: rotary tables of five-axis machines reach 90 to 200."""
GOLDEN = 0.5 * (3.0 - 5.0**0.5)
"""Share of a turn by which the start moves from layer to layer: never near an earlier one."""
_TILT_SHARE = 0.5  # of that speed: rotary axes that tilt a table are slower than those that spin it
_SMOOTH_MM = 1.5  # of path on either side over which the axis is averaged: a bead's width and a half in all
_CORNER_DEG = 40.0  # sharper turns of a path are corners
_LEAST_TURN = 1e-6  # rad: below it an axis stands upright or still


def tilt_deg(lean_deg: ArrayLike, settings: Settings) -> Floats:
    """(n,) float   Tilt of the head over walls that lean so much from the layer's direction, outward.

    0 up to the lean that the material holds without; from there what it takes to hold; over steep overhang along the
    wall itself. Never more than the material allows.
    """
    facts = settings.material.deposition
    lean = np.asarray(lean_deg, dtype=np.float64)
    needed = lean - facts.max_overhang_deg + MARGIN_DEG
    tilt = np.where(lean > ALONG_FROM_DEG, np.maximum(lean, LEAST_ALONG_DEG), np.minimum(needed, lean))
    return np.asarray(np.where(lean > facts.max_overhang_deg, np.minimum(tilt, facts.max_tilt_deg), 0.0))


def growth_share(lean_deg: Floats, tilt: Floats) -> Floats:
    """(n,) float   Length of a bead along the tool axis for one mm of the layer's height; also how much wider than its
    width across the axis the bead is in the layer's plane.

    Both follow from the wall's tangent: a step of 1 / cos(lean) along it goes cos(lean - tilt) of that along the axis.
    """
    return np.asarray(np.cos(np.radians(lean_deg - tilt)) / np.cos(np.radians(lean_deg)))


def axes_of(outward: Floats, tilt: Floats) -> Floats:
    """(n, 3) float, unit   outward : (n, 2) float, unit, the way the wall leans   tilt : (n,) float, deg."""
    angle = np.radians(tilt)[:, None]
    return np.hstack([np.sin(angle) * outward, np.cos(angle)])


def across_axis(outward: Floats, tilt: Floats) -> Floats:
    """(n, 3) float, unit   Across the axes of `axes_of`, back over the wall: inward and up."""
    angle = np.radians(tilt)[:, None]
    return np.hstack([-np.cos(angle) * outward, np.sin(angle)])


def smoothed(values: Floats, spacing_mm: float, closed: bool, reach_mm: float = _SMOOTH_MM) -> Floats:
    """Running mean of rows that lie evenly along a path; ends of open paths stay.  values : (n, d) float."""
    half = min(round(reach_mm / spacing_mm), (len(values) - 1) // 2)
    if half < 1:
        return values
    if closed:
        padded = np.vstack([values[-half:], values, values[:half]])
    else:
        padded = np.vstack([np.repeat(values[:1], half, axis=0), values, np.repeat(values[-1:], half, axis=0)])
    sums = np.vstack([np.zeros((1, values.shape[1])), np.cumsum(padded, axis=0)])
    return np.asarray((sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1))


def spread_rows(points: Floats, number: int, closed: bool) -> NDArray[np.int64]:
    """(n,) int   Rows in the order in which pass `number` of many upon each other runs, so that their starts do not line up.

    points : (n, d) float. Closed passes begin a golden share of the round farther each time, counted from the point with the
    largest x; open ones run to and fro.
    """
    rows = np.arange(len(points))
    if not closed:
        return rows if number % 2 == 0 else rows[::-1]
    first = int(np.argmax(np.round(points[:, 0], 2))) + round(GOLDEN * number % 1.0 * len(points))
    return np.roll(rows, -first)


def tilted_motion(tips: Floats, axes: Floats, closed: bool) -> Motion:
    """The motion through tips with a tool axis at each, as a curve on the tip's domain.

    tips : (n, 3) float, mm, neighbours differ; of a closed motion the last is not the first   axes : (n, 3) float, unit
    """
    if np.abs(axes - axes[0]).max() < _LEAST_TURN:
        return Motion(_tip_curve(tips, closed), axes[0])
    tip = _tip_curve(tips, closed)
    knots = np.concatenate([tip.breaks[:1], tip.breaks, tip.breaks[-1:]])
    return Motion(tip, Curve(1, knots, np.vstack([axes, axes[:1]]) if closed else axes))


def turn_deg_mm(axes: Floats, tips: Floats, closed: bool) -> Floats:
    """(n,) float   How fast the axis turns from each tip to the next, deg per mm of path: about the layer's direction, or
    towards and from it at a share of that speed, whichever takes longer."""
    following_tips, following = (np.roll(values, -1, axis=0) for values in (tips, axes))
    sine = axes[:, 0] * following[:, 1] - axes[:, 1] * following[:, 0]
    turn = np.abs(np.arctan2(sine, (axes[:, :2] * following[:, :2]).sum(axis=1)))
    turn[np.hypot(axes[:, 0], axes[:, 1]) < 1e-3] = 0.0
    over = np.abs(np.arccos(np.clip(following[:, 2], -1.0, 1.0)) - np.arccos(np.clip(axes[:, 2], -1.0, 1.0)))
    turn = np.maximum(turn, over / _TILT_SHARE)
    way = np.linalg.norm(following_tips - tips, axis=1)
    if not closed:
        turn[-1] = 0.0
    return np.asarray(np.degrees(turn) / np.maximum(way, 1e-6))


def _tip_curve(tips: Floats, closed: bool) -> Curve:
    """The curve through all tips, whose breaks they are."""
    if len(tips) == 2:
        return Curve.from_polyline(tips)
    ways = np.roll(tips, -1, axis=0) - tips
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    corner = (ways * np.roll(ways, 1, axis=0)).sum(axis=1) < np.cos(np.radians(_CORNER_DEG))
    if not closed:
        corner[[0, -1]] = False
    return interpolate(tips, closed=closed, corners=corner)
