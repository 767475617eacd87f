"""A tip curve with its tool axis: cutting, turning, lifting and joining such motions, and making passes of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.nurbs import construct
from planner.nurbs.curve import Curve
from planner.plan import Pass

Floats = NDArray[np.float64]

UP: Floats = np.array([0.0, 0.0, 1.0])
UP.setflags(write=False)
_SAME_SHARE = 1e-9  # of the domain: parameters nearer than this to a knot mean the knot
_LEAST_MM = 1e-6  # shorter stretches are left out: they have no direction
_QUARTER = 4.0 / 3.0 * (np.sqrt(2.0) - 1.0)  # handle of a cubic quarter circle, radius 1; 2.7e-4 off at most


@dataclass(frozen=True, eq=False)
class Motion:
    """A tip curve and the unit vector from the tip into the head along it.

    tip  : 3-D curve, mm, build frame
    axis : (3,) float, constant, or a Curve on the tip's domain, normalised after evaluation
    """

    tip: Curve
    axis: Floats | Curve

    @property
    def length(self) -> float:
        """Arc length of the tip, mm."""
        return self.tip.length

    def axis_at(self, u: float) -> Floats:
        """(3,) float   Unit tool axis at one parameter."""
        return axis_at(self.axis, u)

    def ends(self) -> tuple[Floats, Floats, Floats, Floats]:
        """First tip, first axis, last tip, last axis, (3,) float each."""
        low, high = self.tip.domain
        first, last = self.tip.evaluate([low, high])
        return first, self.axis_at(low), last, self.axis_at(high)

    def raw_axis_at(self, u: float) -> Floats:
        """(3,) float   The axis at one parameter as it stands in its curve, so that pieces can be joined to it."""
        return np.asarray(self.axis.evaluate([u])[0]) if isinstance(self.axis, Curve) else self.axis

    def tangent(self, at_end: bool = False) -> Floats:
        """(3,) float   Unit direction of motion of the tip at the start, or at the end."""
        low, high = self.tip.domain
        speed = self.tip.derivatives([high if at_end else low], 1, "left" if at_end else "right")[1][0]
        return np.asarray(speed / np.linalg.norm(speed))

    def from_arc(self, s: float) -> tuple[Motion, Motion]:
        """The motion before and after an arc length strictly inside (0, length)."""
        u = float(self.tip.at_arc_length([s])[0])
        inner = self.tip.breaks[1:-1]
        if len(inner):
            nearest = float(inner[np.argmin(np.abs(inner - u))])
            u = nearest if abs(nearest - u) <= _SAME_SHARE * float(np.ptp(self.tip.domain)) else u
        before, after = self.tip.split(u)
        if not isinstance(self.axis, Curve):
            return Motion(before, self.axis), Motion(after, self.axis)
        axis_before, axis_after = self.axis.split(u)
        return Motion(before, axis_before), Motion(after, axis_after)

    def started_at(self, s: float) -> Motion:
        """A closed motion, begun at another arc length."""
        if not 0.01 < s < self.length - 0.01:
            return self
        before, after = self.from_arc(s)
        return joined([after, before])


def axis_at(axis: Floats | Curve, u: float) -> Floats:
    """(3,) float   The unit vector of a constant or varying tool axis at a parameter."""
    vector = axis.evaluate([u])[0] if isinstance(axis, Curve) else axis
    return np.asarray(vector / np.linalg.norm(vector))


def lifted(curve: Curve, z: float, axis: Floats = UP) -> Motion:
    """A planar curve as a motion at height z with a constant axis."""
    matrix = np.eye(4)
    matrix[2, 3] = z
    return Motion(curve.transformed(matrix), axis)


def straight(points: ArrayLike, axis: Floats = UP) -> Motion:
    """Straight from point to point.  points : (n, 3) float, mm, neighbours differ."""
    path = np.asarray(points, dtype=np.float64)
    keep = np.concatenate([[True], np.linalg.norm(np.diff(path, axis=0), axis=1) > _LEAST_MM])
    return Motion(Curve.from_polyline(path[keep]), axis)


def turning(points: ArrayLike, axes: ArrayLike) -> Motion:
    """Straight from point to point while the axis turns from vector to vector.

    points : (n, 3) float, mm   axes : (n, 3) float, unit. Neighbouring points differ.
    """
    path = np.asarray(points, dtype=np.float64)
    vectors = np.asarray(axes, dtype=np.float64)
    tip = Curve.from_polyline(path)
    if np.abs(vectors - vectors[0]).max() < 1e-12:
        return Motion(tip, vectors[0])
    return Motion(tip, Curve(1, tip.knots, vectors))


def quarter_arc(start: ArrayLike, corner: ArrayLike, end: ArrayLike, axis: Floats) -> Motion:
    """A quarter turn from start to end, tangent to start-corner and corner-end.  (3,) float, mm, each."""
    first, middle, last = (np.asarray(p, dtype=np.float64) for p in (start, corner, end))
    net = np.array([first, first + _QUARTER * (middle - first), last + _QUARTER * (middle - last), last])
    return Motion(Curve(3, np.array([0.0] * 4 + [1.0] * 4), net), axis)


def joined(motions: Sequence[Motion]) -> Motion:
    """One motion through all of them; each must start where the one before it ends.

    Each piece keeps its domain's width scaled to its length, so that the parameter runs evenly.
    Raises FitError if they do not meet.
    """
    pieces, at = [], 0.0
    for motion in motions:
        length = motion.length
        axis = motion.axis.with_domain(at, at + length) if isinstance(motion.axis, Curve) else motion.axis
        pieces.append(Motion(motion.tip.with_domain(at, at + length), axis))
        at += length
    tip = construct.join([piece.tip for piece in pieces])
    first_axis = pieces[0].axis
    if not isinstance(first_axis, Curve) and all(
        not isinstance(piece.axis, Curve) and np.array_equal(piece.axis, first_axis) for piece in pieces
    ):
        return Motion(tip, first_axis)
    return Motion(tip, construct.join([_axis_curve(piece) for piece in pieces], gap_tolerance_mm=1e-3))


def _axis_curve(motion: Motion) -> Curve:
    """The axis as a curve of degree 1 on the tip's domain."""
    if isinstance(motion.axis, Curve):
        return motion.axis
    low, high = motion.tip.domain
    return Curve(1, np.array([low, low, high, high]), np.array([motion.axis, motion.axis]))


def process_pass(motion: Motion, setpoints: ArrayLike, *, is_link: bool = False, rapid: bool = False) -> Pass:
    """The pass of a motion.  setpoints : (k, 5) float, rows as in `Pass`."""
    rows = np.atleast_2d(np.asarray(setpoints, dtype=np.float64))
    return Pass(motion.tip, motion.axis, rows, is_link=is_link, rapid=rapid)
