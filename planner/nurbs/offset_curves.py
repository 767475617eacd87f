"""Offsets of closed NURBS curves as closed NURBS curves: polygons say what is left, the source curves where it runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.nurbs.curve import Curve
from planner.nurbs.offset import signed_offsets
from planner.nurbs.offset_pieces import fit_stretch
from planner.nurbs.offset_source import Sides, Source, polygons_of, sides_of, source_of
from planner.nurbs.offset_trace import trace_ring
from planner.nurbs.rings import Ring, fit_loops

Floats = NDArray[np.float64]

TOLERANCE_MM = 2e-4
"""Of offset curves from the exact offset: a fifth of the 1e-3 mm that is promised."""
_CHORD_MM = 1e-3  # of the polygons that decide what splits, merges and vanishes; it moves no point of the result
_FINE_MM = 1e-4  # of the second try
_NEARER = 1.5  # times the errors of polygon and fit: what is nearer to the polygon than the distance less this is cut off
_SLACK = 6.0  # times the chord error: by how much polygons may miss the distance
_TINY = 30.0  # times the chord error: a shorter stretch may have no place between its neighbours
_SHARES = np.array([0.0, 0.25, 0.5, 0.75])
_BASIS = np.column_stack([(1 - _SHARES) ** 3, 3 * _SHARES * (1 - _SHARES) ** 2, 3 * _SHARES**2 * (1 - _SHARES), _SHARES**3])


def offset_curves(
    curves: Sequence[Curve], distance_mm: float, *, tolerance_mm: float = TOLERANCE_MM, arcs: bool = True
) -> list[Curve]:
    """The outline of the region that the curves bound, grown (> 0) or shrunk (< 0) by a distance.

    curves       : closed, planar or at one height; outlines and holes by the even-odd rule, whatever their sense.
    distance_mm  : every point of the result is this far from the curves, within tolerance_mm.
    arcs         : arcs become exact rational arcs (a circle's offset is a circle); else all pieces are cubics.
    Returns closed curves of degree 3, each outline (counter-clockwise) before its holes (clockwise); none where nothing
    is left. Corners where the offset cuts itself off, arcs round corners, tangents meet elsewhere (triple knots).
    Raises FitError if a curve is open or not level, ValueError if distance or tolerance is no number for an offset.
    Source: paper Fig. 4; Tiller, Hanson, Offsets of two-dimensional profiles, IEEE CG&A 4 (1984).
    """
    rings = offset_many([curves], [distance_mm], tolerance_mm=tolerance_mm, arcs=arcs)[0][0]
    if not curves or curves[0].dimension == 2:
        return [ring.curve for ring in rings]
    lift = np.eye(4)
    lift[2, 3] = float(curves[0].control_points[0, 2])
    return [ring.curve.transformed(lift) for ring in rings]


def offset_many(
    sets: Sequence[Sequence[Curve]],
    distances_mm: Sequence[float],
    *,
    tolerance_mm: float = TOLERANCE_MM,
    arcs: bool = True,
) -> list[list[list[Ring]]]:
    """Offsets of many sets of curves by many distances in one pass: result[set][distance] is a list of rings.

    sets : each as in `offset_curves`; further coordinates than x and y are left out. Raises as `offset_curves`.
    """
    if not tolerance_mm > 0.0:
        raise ValueError(f"the tolerance must be positive, not {tolerance_mm:g} mm")
    source = source_of(sets)
    sides = sides_of(source, _CHORD_MM)
    regions = polygons_of(source, sides, len(sets))
    moved = signed_offsets(regions, distances_mm, _CHORD_MM)
    found: list[list[list[Ring]]] = []
    for number, (region, row) in enumerate(zip(regions, moved, strict=True)):
        outline = region.boundary
        shapely.prepare(outline)
        found.append([])
        for shape, distance in zip(row, distances_mm, strict=True):
            task = _Task(source, sides, number, outline, -float(distance), _CHORD_MM, tolerance_mm, arcs)
            rings = _rings(task, shape, False)
            found[-1].append(_finer(task, distance) if rings is None else rings)
    return found


@dataclass(frozen=True, eq=False)
class _Task:
    """One set of a source, to be offset by left_mm to the left of its loops.

    outline : of its polygons, prepared   chord_mm : error of these   tolerance_mm, arcs : of `offset_curves`.
    """

    source: Source
    sides: Sides
    number: int
    outline: shapely.Geometry
    left_mm: float
    chord_mm: float
    tolerance_mm: float
    arcs: bool

    @cached_property
    def span(self) -> tuple[int, int]:
        """The set's sides: first, and one past the last."""
        mine = np.flatnonzero(self.source.owner == self.number)
        return int(self.sides.first[mine[0]]), int(self.sides.first[mine[-1] + 1])


def _finer(task: _Task, distance_mm: float) -> list[Ring]:
    """The same on finer polygons; where a ring cannot be traced on them either, from the ring itself."""
    sides = sides_of(task.source, _FINE_MM)
    region = polygons_of(task.source, sides, task.number + 1)[task.number]
    moved = signed_offsets([region], [distance_mm], _FINE_MM)[0][0]
    outline = region.boundary
    shapely.prepare(outline)
    return _rings(replace(task, sides=sides, outline=outline, chord_mm=_FINE_MM), moved, True) or []


def _rings(task: _Task, region: MultiPolygon, always: bool) -> list[Ring] | None:
    """The rings of one offset region, traced on its source; None (or, always, the ring's own fit) if one cannot be."""
    found: list[Ring] = []
    for part in shapely.get_parts(shapely.orient_polygons(region)):
        parent = len(found)
        for index, line in enumerate([part.exterior, *part.interiors]):
            ring = np.ascontiguousarray(shapely.get_coordinates(line)[:-1])
            curve = _traced(task, ring) if task.left_mm else None
            if curve is None:
                if not always and task.left_mm:
                    return None
                curve = fit_loops([ring], task.tolerance_mm)[0]
            found.append(Ring(curve, index > 0, parent if index else -1))
    return found


def _traced(task: _Task, ring: Floats) -> Curve | None:
    """The curve that a ring stands for; None where its stretches do not meet, or come nearer to the source."""
    source, sides = task.source, task.sides
    rows, met = trace_ring(
        source.coefficients, source.is_corner, sides.points, sides.piece, sides.low, sides.high, sides.after,
        sides.before, sides.loop, source.first, ring, task.span, task.left_mm, _SLACK * task.chord_mm,
    )  # fmt: skip
    if not met:
        return None
    nets: list[Floats] = []
    for row in rows:
        loop = sides.loop[int(row[0])]
        low, high = int(source.first[loop]), int(source.first[loop + 1])
        pieces, fits = fit_stretch(
            source.coefficients, source.is_corner, source.begins, low, high, row, task.left_mm, task.tolerance_mm, task.arcs
        )
        if row[4] < _TINY * task.chord_mm and _path(pieces)[1] > 3.0 * _TINY * task.chord_mm:
            continue
        if not fits:
            return None
        nets.append(pieces)
    if not nets:
        return None
    whole = np.concatenate(nets)
    points, length = _path(whole)
    expected = float(rows[:, 4].sum())
    cut_off = abs(task.left_mm) - _NEARER * (task.chord_mm + task.tolerance_mm)
    near = cut_off > 0.0 and shapely.dwithin(task.outline, shapely.points(points), cut_off).any()
    if near or abs(length - expected) > _TINY * task.chord_mm * len(rows) + 0.02 * expected:
        return None
    return _joined(whole)


def _path(pieces: Floats) -> tuple[Floats, float]:
    """Points on the pieces, (4 m, 2) float, mm, and the length of the polygon through them, mm."""
    rows = np.einsum("tk,pkd->ptd", _BASIS, pieces * np.where(np.arange(3) < 2, pieces[:, :, 2:], 1.0)).reshape(-1, 3)
    path = rows[:, :2] / rows[:, 2:]
    return path, float(np.hypot(*np.diff(path, axis=0).T).sum() + np.hypot(*(pieces[-1, 3, :2] - path[-1])))


def _joined(pieces: Floats) -> Curve:
    """One closed curve through all pieces, parameter about as their lengths, domain (0, 1).

    pieces : (m, 4, 3) float   Control points and weights; each ends where the next begins, the last at the first.
    """
    reach = np.hypot(*np.moveaxis(np.diff(pieces[:, :, :2], axis=1), 2, 0)).sum(axis=1)
    at = np.concatenate([[0.0], np.cumsum(reach)]) / reach.sum()
    knots = np.concatenate([[0.0], np.repeat(at[:-1], 3), [1.0, 1.0, 1.0, 1.0]])
    rows = np.concatenate([pieces[:, :3].reshape(-1, 3), pieces[:1, 0]])
    weights = None if (rows[:, 2] == 1.0).all() else rows[:, 2]
    return Curve(3, knots, rows[:, :2], weights)
