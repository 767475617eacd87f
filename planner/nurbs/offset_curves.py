"""Offsets of closed NURBS curves as closed NURBS curves: polygons say what is left, the source curves where it runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.nurbs.curve import Curve
from planner.nurbs.offset import OffsetRings, signed_offsets
from planner.nurbs.offset_join import joined, points_on, reach_of
from planner.nurbs.offset_pieces import fit_stretches
from planner.nurbs.offset_source import Sides, Source, polygons_of, sides_of, source_of
from planner.nurbs.offset_trace import trace_rings
from planner.nurbs.rings import Ring, fit_loops

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TOLERANCE_MM = 2e-4
"""Of offset curves from the exact offset: a fifth of the 1e-3 mm that is promised."""
_CHORD_MM = 2e-3  # of the polygons that decide what splits, merges and vanishes; it moves no point of the result
_FINE_MM = 1e-4  # of the second try
_NEARER = 1.5  # times the errors of polygon and fit: what is nearer to the polygon than the distance less this is cut off
_SLACK = 3.0  # times the chord error: by how much polygons may miss the distance
_TINY = 15.0  # times the chord error: a shorter stretch may have no place between its neighbours
_LENGTH_SHARE = 0.02  # by which curve and polygon may differ in length
_STRAYED = 4.0  # times the chord error: stretches whose ends or lengths miss the polygon's by more are looked at closely


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
    style = _Style(tolerance_mm, arcs)
    every = [(number, float(distance)) for number in range(len(sets)) for distance in distances_mm]
    found = _offsets(source, every, _CHORD_MM, style)
    for index, rings in enumerate(found):
        if rings is None:
            found[index] = _offsets(source, [every[index]], _FINE_MM, style, always=True)[0]
    width = len(distances_mm)
    return [[rings or [] for rings in found[k * width : (k + 1) * width]] for k in range(len(sets))]


@dataclass(frozen=True)
class _Style:
    """tolerance_mm, arcs : of `offset_curves`."""

    tolerance_mm: float
    arcs: bool


def _offsets(
    source: Source, wanted: Sequence[tuple[int, float]], chord_mm: float, style: _Style, always: bool = False
) -> list[list[Ring] | None]:
    """The rings of each wanted set and distance, None where one cannot be traced (always: then as its polygon runs).

    chord_mm : error of the polygons that decide what is left.
    """
    sides = sides_of(source, chord_mm)
    sets = sorted({number for number, _ in wanted})
    outlines = dict(zip(sets, polygons_of(source, sides, sets), strict=True))
    rings = signed_offsets([outlines[number] for number, _ in wanted], [d for _, d in wanted], chord_mm)
    curves = _traced(source, sides, rings, [wanted[k] for k in rings.owner], outlines, chord_mm, style)
    found: list[list[Ring] | None] = [[] for _ in wanted]
    parent = -1
    for k, (index, is_hole, curve) in enumerate(zip(rings.owner.tolist(), rings.is_hole.tolist(), curves, strict=True)):
        mine = found[index]
        if mine is None or (curve is None and not always):
            found[index] = None
            continue
        parent = parent if is_hole else len(mine)
        if curve is None:
            [curve] = fit_loops([rings.points[rings.first[k] : rings.first[k + 1]]], style.tolerance_mm)
        mine.append(Ring(curve, is_hole, parent if is_hole else -1))
    return found


def _traced(
    source: Source,
    sides: Sides,
    rings: OffsetRings,
    stands_for: list[tuple[int, float]],
    outlines: dict[int, MultiPolygon],
    chord_mm: float,
    style: _Style,
) -> list[Curve | None]:
    """The curves that rings stand for; None where stretches do not meet, or come nearer to the source.

    stands_for : set and distance of each ring.
    """
    if not stands_for:
        return []
    left = np.array([-distance for _, distance in stands_for])
    loops = np.searchsorted(source.owner, np.array([[number, number + 1] for number, _ in stands_for]))
    rows, begin, whole = trace_rings(
        source.coefficients, source.is_corner, sides.points, sides.piece, sides.low, sides.high, sides.after,
        sides.before, sides.loop, source.first, sides.limits, rings.points, rings.first, sides.first[loops], left,
        _SLACK * chord_mm,
    )  # fmt: skip
    nets, starts, fits = fit_stretches(
        source.coefficients, source.is_corner, source.begins, source.first, sides.loop, rows,
        np.repeat(left, np.diff(begin)), style.tolerance_mm, style.arcs,
    )  # fmt: skip
    points = points_on(nets)
    reach = reach_of(points, starts)
    stays = (rows[:, 4] >= _TINY * chord_mm) | (reach <= 3.0 * _TINY * chord_mm)
    expected = np.add.reduceat(rows[:, 4], begin[:-1])
    misses = np.abs(np.add.reduceat(np.where(stays, reach, 0.0), begin[:-1]) - expected)
    whole &= misses <= _TINY * chord_mm * np.diff(begin) + _LENGTH_SHARE * expected
    whole &= np.add.reduceat(stays & ~fits, begin[:-1]) == 0
    whole &= np.logical_or.reduceat(stays, begin[:-1]) & (left != 0.0)
    strayed = np.abs(reach - rows[:, 4]) > _STRAYED * chord_mm + _LENGTH_SHARE * rows[:, 4]
    strayed |= (rows[:, 5] > _STRAYED * chord_mm) | ~stays
    doubtful = np.flatnonzero(strayed & stays & np.repeat(whole, np.diff(begin)))
    ring = np.repeat(np.arange(len(stands_for)), np.diff(begin))[doubtful]
    near = _are_nearer(points, starts, outlines, doubtful, [stands_for[k] for k in ring], chord_mm + style.tolerance_mm)
    whole[ring[near]] = False
    kept = np.repeat(stays & np.repeat(whole, np.diff(begin)), np.diff(starts))
    edges = np.concatenate([[0], np.cumsum(kept)])[starts[begin]]
    curves = iter(joined(nets[kept], np.append(edges[:-1][whole], edges[-1])))
    return [next(curves) if is_whole else None for is_whole in whole]


def _are_nearer(
    points: Floats,
    starts: Ints,
    outlines: dict[int, MultiPolygon],
    asked: Ints,
    stands_for: list[tuple[int, float]],
    error_mm: float,
) -> NDArray[np.bool_]:
    """Which of the stretches asked for come nearer to their set's polygons than they should.

    points : (m, k, 2) float, mm, on the pieces   starts : (s+1,) int, pieces of each stretch
    stands_for : set and distance of each stretch asked for   error_mm : of polygons and curves.
    """
    found = np.zeros(len(asked), dtype=bool)
    lines = {number: outlines[number].boundary for number in {number for number, _ in stands_for}}
    for line in lines.values():
        shapely.prepare(line)
    for index, (k, (number, distance)) in enumerate(zip(asked, stands_for, strict=True)):
        cut_off = abs(distance) - _NEARER * error_mm
        mine = points[starts[k] : starts[k + 1], ::2].reshape(-1, 2)
        if cut_off > 0.0 and len(mine):
            found[index] = shapely.dwithin(lines[number], shapely.points(mine), cut_off).any()
    return found
