"""Exact lines and arcs in place of fitted pieces: what they ask of their neighbours, and the spliced curve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.nurbs.curve import Curve
from planner.nurbs.fit_kernel import distinct_points
from planner.nurbs.recognise import ExactPiece, exact_piece, find_runs
from planner.nurbs.segments import ContourTable, refusal

Floats = NDArray[np.float64]


def with_exact_pieces(table: ContourTable, tolerance_mm: float) -> tuple[ContourTable, list[list[ExactPiece]]]:
    """The table of distinct points whose fit meets the exact lines and arcs in their own tangents, and these.

    The ends of every line and arc are marked as corners, so that no tangent is estimated across them; where the
    contour goes on smoothly into a fitted piece, that takes the line's or arc's tangent.
    Raises FitError as `fit.interpolate`, saying which contour.
    """
    chosen, marks, sides, found = [], [], [], []
    for contour in range(len(table.closed)):
        low, high = int(table.offsets[contour]), int(table.offsets[contour + 1])
        kept, corner = np.empty(high - low, np.int64), np.empty(high - low, np.bool_)
        closed = bool(table.closed[contour])
        total = distinct_points(table.points, table.corners, low, high, closed, kept, corner)
        if total < (3 if closed else 2):
            raise refusal(table, contour, total)
        kept, corner = kept[:total], corner[:total].copy()
        points = table.points[kept]
        known = table.tangents[kept] if table.tangents.size else np.full((total, 2, points.shape[1]), np.nan)
        pieces = _pieces(points, corner, closed, tolerance_mm)
        _mark(pieces, corner, known)
        chosen.append(kept)
        marks.append(corner)
        sides.append(known)
        found.append(pieces)
    rows = np.concatenate(chosen)
    offsets = np.concatenate([[0], np.cumsum([len(kept) for kept in chosen])]).astype(np.int64)
    curvatures = table.curvatures[rows] if table.curvatures.size else table.curvatures
    points, corners, tangents = np.ascontiguousarray(table.points[rows]), np.concatenate(marks), np.concatenate(sides)
    return ContourTable(points, offsets, table.closed, corners, tangents, curvatures), found


def _pieces(points: Floats, corner: NDArray[np.bool_], closed: bool, tolerance_mm: float) -> list[ExactPiece]:
    count = len(points)
    solid = np.zeros((count, 3))
    solid[:, : points.shape[1]] = points
    runs, shapes = np.empty((count, 3), np.int64), np.zeros((count, 7))
    found = find_runs(solid, corner, closed, tolerance_mm, runs, shapes)
    return [exact_piece(points, runs[k], shapes[k]) for k in range(found)]


def _mark(pieces: list[ExactPiece], corner: NDArray[np.bool_], known: Floats) -> None:
    """Corners at the ends of all pieces; their tangents on both sides where the contour is smooth there."""
    count = len(corner)
    smooth = ~corner
    for piece in pieces:
        for end, side, tangent in ((piece.first % count, 0, piece.start), (piece.last % count, 1, piece.end)):
            if smooth[end]:
                known[end, side] = tangent
            corner[end] = True
    for piece in pieces:
        known[piece.first % count, 1], known[piece.last % count, 0] = piece.start, piece.end


def spliced(curve: Curve, pieces: list[ExactPiece]) -> Curve:
    """The fitted curve (a Bézier piece per chord, triple knots) with exact pieces in place of their chords."""
    if not pieces:
        return curve
    net = curve.control_points
    chords = len(net) // 3
    rows, weights, widths = [], [], []
    reached = 0
    for first, last, piece in [*((p.first, p.last, p) for p in pieces), (chords, chords, None)]:
        free = net[3 * reached : 3 * first + 1]
        legs = np.linalg.norm(np.diff(free, axis=0), axis=1)
        rows.append(free[:-1])
        weights.append(np.ones(len(free) - 1))
        widths.append(1.5 * (legs[0::3] + legs[2::3]))
        if piece is not None:
            rows.append(piece.rows)
            weights.append(piece.weights)
            widths.append(np.full(len(piece.rows) // 3, 3.0 * piece.length / len(piece.rows)))
        reached = last
    joints = np.concatenate([[0.0], np.cumsum(np.concatenate(widths))])
    inner = np.repeat(joints / joints[-1], 3)
    knots = np.concatenate([[0.0], inner, [1.0]])
    every = np.concatenate([*weights, [1.0]])
    return Curve(3, knots, np.concatenate([*rows, net[-1:]]), None if np.all(every == 1.0) else every)
