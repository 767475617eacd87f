"""A closed curve measured by length and turning: the scale on which two contours are compared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.errors import FitError
from planner.nurbs.curve import Curve

Floats = NDArray[np.float64]

TURNING_SHARE = 0.5
"""How much of an outline's measure is turning, the rest is length: equal shares put as many samples on the corners
and bends, which fix the matching, as on the straight runs between them."""
CORNER_RAD = np.radians(5.0)
"""Tangents that differ more at a joint make a corner: far above the fit's noise, below any crease that is kept."""
_PER_PIECE = 4  # samples of a cubic piece; contour points are dense, a piece turns little


@dataclass(frozen=True, eq=False)
class Outline:
    """A closed cubic curve with its measure x, which runs from 0 to 1 once round.

    curve : domain (0, 1), closed     points : (k, 3) float, mm
    x, u, theta : (k,) float    not decreasing x and u; theta (rad) is the tangent's direction, unwrapped. At a corner
        u stays while x and theta go on. The last row is the first, one turn later.
    corners : (c,) float        parameters of the corners
    """

    curve: Curve
    x: Floats
    u: Floats
    theta: Floats
    points: Floats
    corners: Floats

    def at(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Parameter (0 ... 1), direction (rad, unwrapped) and point (k, 3) at any measures (k,), also beyond 0 ... 1."""
        turns = np.floor(x)
        rest = x - turns
        theta = np.interp(rest, self.x, self.theta) + turns * (self.theta[-1] - self.theta[0])
        points = np.column_stack([np.interp(rest, self.x, self.points[:, k]) for k in range(3)])
        return np.interp(rest, self.x, self.u), theta, points

    def measure(self, u: Floats, side: str) -> Floats:
        """Measure of parameters (k,) in 0 ... 1, at corners before ("left") or behind ("right") the turn."""
        if side == "right":
            # a corner at u = 0 turns at the end of the round: its far side is x = 0
            return np.asarray(np.interp(u, *_steps(self.u, self.x, last=True)))
        return np.asarray(np.interp(u, *_steps(self.u, self.x, last=False)))


def _steps(u: Floats, x: Floats, last: bool) -> tuple[Floats, Floats]:
    """Rows with distinct u: of equal ones the first or the last."""
    change = np.flatnonzero(np.diff(u) > 0.0)
    rows = np.append(change, len(u) - 1) if last else np.concatenate([[0], change + 1])
    return u[rows], x[rows]


def outline_of(curve: Curve, plane_axes: Floats) -> Outline:
    """The outline of a closed curve.

    plane_axes : (2, 3) float   unit vectors against which directions are measured
    Raises FitError if the curve is no closed cubic without weights, or too small to turn.
    """
    if curve.weights is not None or curve.degree > 3:
        raise FitError("walls are matched along cubic curves without weights")
    cubic = curve.with_domain(0.0, 1.0)
    cubic = cubic if cubic.degree == 3 else cubic.with_degree(3)
    breaks = cubic.breaks
    share = np.arange(_PER_PIECE) / _PER_PIECE
    u = np.append((breaks[:-1, None] + np.diff(breaks)[:, None] * share).ravel(), 1.0)
    points = cubic.evaluate(u)
    ahead = cubic.derivatives(u[:-1], 1)[1] @ plane_axes.T
    behind = cubic.derivatives(u[1:], 1, "left")[1] @ plane_axes.T
    angle_ahead, angle_behind = np.arctan2(ahead[:, 1], ahead[:, 0]), np.arctan2(behind[:, 1], behind[:, 0])
    within = _wrapped(angle_behind - angle_ahead)
    jump = _wrapped(np.roll(angle_ahead, -1) - angle_behind)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    turning = np.abs(within).sum() + np.abs(jump).sum()
    total = lengths.sum()
    if not total > 0.0 or not turning > 0.0:
        raise FitError("a contour without length cannot be matched")
    steps_x = np.empty(2 * len(within))
    steps_x[0::2] = (1.0 - TURNING_SHARE) * lengths / total + TURNING_SHARE * np.abs(within) / turning
    steps_x[1::2] = TURNING_SHARE * np.abs(jump) / turning
    steps_theta = np.column_stack([within, jump]).ravel()
    x = np.concatenate([[0.0], np.cumsum(steps_x)])
    theta = angle_ahead[0] + np.concatenate([[0.0], np.cumsum(steps_theta)])
    doubled = np.repeat(np.arange(1, len(u)), 2)
    corners = np.flatnonzero(np.abs(jump) > CORNER_RAD) + 1
    return Outline(
        cubic,
        x / x[-1],
        np.concatenate([[0.0], u[doubled]]),
        theta,
        np.vstack([points[:1], points[doubled]]),
        np.sort(u[corners] % 1.0),
    )


def _wrapped(angle: Floats) -> Floats:
    """Angles brought to -pi ... pi."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)
