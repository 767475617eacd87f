"""Contour points to NURBS: the paper's local cubic interpolation, many contours in one call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import FitError
from planner.nurbs.curve import Curve
from planner.nurbs.exact import spliced, with_exact_pieces
from planner.nurbs.fit_kernel import fit_all
from planner.nurbs.segments import ContourTable, contour_table, refusal

Floats = NDArray[np.float64]
Handles = Literal["speed", "curvature"]


def interpolate(
    points: ArrayLike,
    *,
    closed: bool,
    corners: ArrayLike | None = None,
    tangents: ArrayLike | None = None,
    curvatures: ArrayLike | None = None,
    handles: Handles = "curvature",
    arc_tolerance_mm: float | None = None,
) -> Curve:
    """The cubic NURBS curve through the points.

    points     : (n, 2) or (n, 3) float, mm   In order. A closed contour need not repeat its first point.
    closed     : whether the contour leads back to its first point (smoothly there, unless that point is a corner).
    corners    : (n,) bool or (c,) int        Points where the contour has a corner: one-sided tangents, knot of
                                              multiplicity 3. None: smooth everywhere.
    tangents   : (n, d) float                 Known directions of the curve at the points, NaN rows where Eq. 4 shall
                                              find them; not used at corners. (n, 2, d): arriving and leaving, used
                                              everywhere (where there is no corner, the leaving one).
    curvatures : (n, d) or (n, 2, d) float, 1/mm   Known curvature vectors dT/ds, NaN rows where five points tell.
    handles    : "speed" (paper Eq. 5: C1, equal speed at joints and midpoints) or "curvature" (sixth order; joints
                 share their tangent, knots of multiplicity 3; falls back to speed piece by piece).
    arc_tolerance_mm : if given, runs of points within it of one line (3 points or more) or circle (5 or more) become
                 exact: the curve is then a rational cubic. Choose the noise of the points: any smooth curve is made
                 of arcs to a coarse tolerance.
    Returns a curve on (0, 1), parameter proportional to length at the joints. With n pieces, no corners and "speed":
    2n+2 control points and 2n+6 knots.
    Raises FitError if a point is not finite or fewer than 2 distinct points (closed: 3) remain.
    Source: paper Eqs. 2-11 as corrected; Piegl & Tiller ch. 9.3.4.
    """
    return interpolate_many(
        [points],
        closed=closed,
        corners=None if corners is None else [corners],
        tangents=None if tangents is None else [tangents],
        curvatures=None if curvatures is None else [curvatures],
        handles=handles,
        arc_tolerance_mm=arc_tolerance_mm,
    )[0]


def interpolate_many(
    contours: Sequence[ArrayLike],
    *,
    closed: bool | Sequence[bool],
    corners: Sequence[ArrayLike | None] | None = None,
    tangents: Sequence[ArrayLike | None] | None = None,
    curvatures: Sequence[ArrayLike | None] | None = None,
    handles: Handles = "curvature",
    arc_tolerance_mm: float | None = None,
) -> list[Curve]:
    """One curve per contour as `interpolate` makes it, all contours in one compiled pass.

    closed : for all, or one per contour   corners, tangents, curvatures : one entry per contour, or None for none.
    The curves share memory: they are slices of one table.
    Raises FitError as `interpolate`, saying which contour.
    """
    if handles not in ("speed", "curvature"):
        raise FitError(f"handles are 'speed' or 'curvature', not {handles!r}")
    if not len(contours):
        return []
    table = contour_table(contours, closed, corners, tangents, curvatures)
    if arc_tolerance_mm is None:
        return fit_table(table, handles == "curvature", handles == "curvature")
    if not arc_tolerance_mm > 0.0:
        raise FitError(f"the tolerance of arcs must be positive, not {arc_tolerance_mm:g} mm")
    distinct, pieces = with_exact_pieces(table, arc_tolerance_mm)
    fitted = fit_table(distinct, handles == "curvature", True)
    return [spliced(curve, found) for curve, found in zip(fitted, pieces, strict=True)]


def fit_table(table: ContourTable, matched: bool, keeps_joints: bool) -> list[Curve]:
    """One curve per contour of a table; matched : curvature handles.

    keeps_joints : whether smooth joints stay control points, triple knots.   Raises FitError as `interpolate`.
    """
    count, (rows, dimension) = len(table.closed), table.points.shape
    net, knots = np.empty((3 * rows + count, dimension)), np.empty(3 * rows + 5 * count)
    sizes = np.empty((count, 2), dtype=np.int64)
    bad, found = fit_all(
        table.points, table.offsets, table.closed, table.corners, table.tangents, table.curvatures,
        matched, keeps_joints, net, knots, sizes,
    )  # fmt: skip
    if bad >= 0:
        raise refusal(table, bad, found)
    curves, row, knot = [], 0, 0
    for size, length in sizes.tolist():
        curves.append(Curve.trusted(3, knots[knot : knot + length], net[row : row + size]))
        row, knot = row + size, knot + length
    return curves
