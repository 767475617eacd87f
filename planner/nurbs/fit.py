"""Contour points to NURBS: the paper's local cubic interpolation, many contours in one call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import FitError
from planner.nurbs.curve import Curve
from planner.nurbs.handles import equal_speed, matched_curvature
from planner.nurbs.segments import Chords, chain_chords
from planner.nurbs.tangents import five_point_tangents

Floats = NDArray[np.float64]
Handles = Literal["speed", "curvature"]


def interpolate(
    points: ArrayLike,
    *,
    closed: bool,
    corners: ArrayLike | None = None,
    tangents: ArrayLike | None = None,
    handles: Handles = "speed",
) -> Curve:
    """The cubic NURBS curve through the points.

    points  : (n, 2) or (n, 3) float, mm   In order. A closed contour need not repeat its first point.
    closed  : whether the contour leads back to its first point (smoothly there, unless that point is a corner).
    corners : (n,) bool or (c,) int        Points where the contour has a corner: one-sided tangents, knot of
                                           multiplicity 3. None: smooth everywhere.
    tangents: (n, d) float                 Known directions of the curve at the points, NaN rows where Eq. 4 shall
                                           find them. At corners and open ends they are not used.
    handles : "speed" (paper Eq. 5: C1, equal speed at joints and midpoints) or "curvature" (sixth order; joints share
              their tangent, knots of multiplicity 3).
    Returns a curve on (0, 1), parameter proportional to length at the joints. With n pieces, no corners and "speed":
    2n+2 control points and 2n+6 knots.
    Raises FitError if a point is not finite or fewer than 2 distinct points (closed: 3) remain.
    Source: paper Eqs. 2-11 as corrected; Piegl & Tiller ch. 9.3.4.
    """
    return interpolate_many([points], closed=closed, corners=[corners], tangents=[tangents], handles=handles)[0]


def interpolate_many(
    contours: Sequence[ArrayLike],
    *,
    closed: bool | Sequence[bool],
    corners: Sequence[ArrayLike | None] | None = None,
    tangents: Sequence[ArrayLike | None] | None = None,
    handles: Handles = "speed",
) -> list[Curve]:
    """One curve per contour as `interpolate` makes it, all contours in one vectorised pass.

    closed : for all, or one per contour   corners, tangents : one entry per contour, or None for none anywhere.
    Raises FitError as `interpolate`, saying which contour.
    """
    if handles not in ("speed", "curvature"):
        raise FitError(f"handles are 'speed' or 'curvature', not {handles!r}")
    if not contours:
        return []
    flags = [closed] * len(contours) if isinstance(closed, (bool, np.bool_)) else list(closed)
    marks = [None] * len(contours) if corners is None else list(corners)
    known = [None] * len(contours) if tangents is None else list(tangents)
    if not len(flags) == len(marks) == len(known) == len(contours):
        raise FitError(f"{len(contours)} contours but {len(flags)} closed, {len(marks)} corners, {len(known)} tangents")
    chords = chain_chords(contours, flags, marks, known)
    tangent_start, tangent_end, chords = five_point_tangents(chords)
    speed = equal_speed(chords.vectors, tangent_start, tangent_end)
    if handles == "speed":
        third = (speed / 3.0)[:, None]
        return _assemble(chords, tangent_start * third, tangent_end * third, speed, True)
    first, second = matched_curvature(chords, tangent_start, tangent_end)
    width = 1.5 * (first + second)
    return _assemble(chords, tangent_start * first[:, None], tangent_end * second[:, None], width, False)


def _assemble(chords: Chords, handle_start: Floats, handle_end: Floats, widths: Floats, smooth: bool) -> list[Curve]:
    """Control points (Eq. 10) and knots (Eqs. 9, 11) of every contour.

    Where the way on is C1 the joint is no control point and its knot is double; elsewhere it is one and triple.
    handle_start, handle_end : (S, d) float, mm   P1 - P0 and P3 - P2.   widths : (S,) float   Knot span of each piece.
    """
    start, end = chords.points[chords.start], chords.points[chords.end]
    first_of = np.flatnonzero(np.diff(chords.contour, prepend=-1))
    counts = np.diff(np.append(first_of, len(chords.start)))
    keeps_joint = chords.precedes < 0 if smooth else np.ones(len(start), dtype=bool)
    keeps_joint[first_of] = True
    nets = np.stack([start, start + handle_start, end - handle_end], axis=1)
    kept = np.ones((len(start), 3), dtype=bool)
    kept[:, 0] = keeps_joint
    rows = nets[kept]
    ends_at = np.cumsum(kept.sum(axis=1))
    reached = np.cumsum(widths) - widths
    base = np.repeat(reached[first_of], counts)
    total = np.repeat(np.add.reduceat(widths, first_of), counts)
    repeats = np.where(keeps_joint, 3, 2)
    repeats[first_of] = 4
    knots = np.repeat((reached - base) / total, repeats)
    knots_end = np.cumsum(repeats)
    curves = []
    row, knot = 0, 0
    for first, count in zip(first_of, counts, strict=True):
        last = first + count - 1
        net = np.concatenate([rows[row : ends_at[last]], end[last : last + 1]])
        curves.append(Curve(3, np.append(knots[knot : knots_end[last]], (1.0, 1.0, 1.0, 1.0)), net))
        row, knot = int(ends_at[last]), int(knots_end[last])
    return curves
