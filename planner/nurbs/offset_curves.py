"""Offsets of closed NURBS curves as closed NURBS curves: polygons say what is left, the source curves where it runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.nurbs.curve import Curve
from planner.nurbs.offset import signed_offsets
from planner.nurbs.offset_pieces import fit_stretches
from planner.nurbs.offset_source import Sides, Source, polygons_of, sides_of, source_of
from planner.nurbs.offset_trace import trace_rings
from planner.nurbs.rings import Ring, fit_loops

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

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
    lines: list[shapely.Geometry] = []
    owner: list[int] = []
    holes: list[bool] = []
    for index, shape in enumerate(_moved(outlines, wanted, chord_mm)):
        for part in shapely.get_parts(shapely.orient_polygons(shape)):
            lines += [part.exterior, *part.interiors]
            holes += [False] + [True] * len(part.interiors)
            owner += [index] * (1 + len(part.interiors))
    rings = [np.ascontiguousarray(shapely.get_coordinates(line)[:-1]) for line in lines]
    curves = _traced(source, sides, rings, [wanted[k] for k in owner], outlines, chord_mm, style)
    found: list[list[Ring] | None] = [[] for _ in wanted]
    parent = -1
    for index, is_hole, ring, curve in zip(owner, holes, rings, curves, strict=True):
        mine = found[index]
        if mine is None or (curve is None and not always):
            found[index] = None
            continue
        parent = parent if is_hole else len(mine)
        mine.append(Ring(curve or fit_loops([ring], style.tolerance_mm)[0], is_hole, parent if is_hole else -1))
    return found


def _moved(
    outlines: dict[int, MultiPolygon], wanted: Sequence[tuple[int, float]], chord_mm: float
) -> list[MultiPolygon]:
    """The offset regions of sets and distances; those of one distance in one call."""
    found: dict[tuple[int, float], MultiPolygon] = {}
    for distance in sorted({distance for _, distance in wanted}):
        numbers = [number for number, own in wanted if own == distance]
        shapes = signed_offsets([outlines[number] for number in numbers], [distance], chord_mm)
        found.update({(number, distance): row[0] for number, row in zip(numbers, shapes, strict=True)})
    return [found[key] for key in wanted]


def _traced(
    source: Source,
    sides: Sides,
    rings: list[Floats],
    stands_for: list[tuple[int, float]],
    outlines: dict[int, MultiPolygon],
    chord_mm: float,
    style: _Style,
) -> list[Curve | None]:
    """The curves that rings stand for; None where stretches do not meet, or come nearer to the source.

    stands_for : set and distance of each ring.
    """
    if not rings:
        return []
    first = np.concatenate([[0], np.cumsum([len(ring) for ring in rings])])
    left = np.array([-distance for _, distance in stands_for])
    loops = np.searchsorted(source.owner, np.array([[number, number + 1] for number, _ in stands_for]))
    rows, begin, whole = trace_rings(
        source.coefficients, source.is_corner, sides.points, sides.piece, sides.low, sides.high, sides.after,
        sides.before, sides.loop, source.first, np.concatenate(rings), first, sides.first[loops], left,
        _SLACK * chord_mm,
    )  # fmt: skip
    whole &= left != 0.0
    per_row = np.repeat(left, np.diff(begin))
    nets, starts, fits = fit_stretches(
        source.coefficients, source.is_corner, source.begins, source.first, sides.loop, rows, per_row,
        style.tolerance_mm, style.arcs,
    )  # fmt: skip
    points, lengths = _path(nets)
    reach = np.add.reduceat(np.append(lengths, 0.0), starts[:-1])
    out_of_place = (rows[:, 4] < _TINY * chord_mm) & (reach > 3.0 * _TINY * chord_mm)
    near = _are_nearer(points, starts[begin], outlines, stands_for, np.diff(begin) > 1, chord_mm + style.tolerance_mm)
    found: list[Curve | None] = []
    for k in range(len(rings)):
        mine = np.flatnonzero(~out_of_place[begin[k] : begin[k + 1]]) + begin[k]
        expected = float(rows[begin[k] : begin[k + 1], 4].sum())
        misses = abs(float(reach[mine].sum()) - expected)
        fair = mine.size and fits[mine].all() and misses <= _TINY * chord_mm * (begin[k + 1] - begin[k]) + 0.02 * expected
        if not (whole[k] and fair) or near[k]:
            found.append(None)
        elif len(mine) == begin[k + 1] - begin[k]:
            found.append(_joined(nets[starts[begin[k]] : starts[begin[k + 1]]]))
        else:
            found.append(_joined(np.concatenate([nets[starts[row] : starts[row + 1]] for row in mine])))
    return found


def _are_nearer(
    points: Floats,
    first: Ints,
    outlines: dict[int, MultiPolygon],
    stands_for: list[tuple[int, float]],
    asked: NDArray[np.bool_],
    error_mm: float,
) -> NDArray[np.bool_]:
    """Which rings come nearer to their set's polygons than they should, of those asked for: others meet nothing.

    points : (m, k, 2) float, mm, of the pieces   first : (r+1,) int, pieces of each ring   error_mm : of both.
    """
    found = np.zeros(len(asked), dtype=bool)
    lines = {number: shape.boundary for number, shape in outlines.items()}
    for line in lines.values():
        shapely.prepare(line)
    for k in np.flatnonzero(asked):
        number, distance = stands_for[k]
        cut_off = abs(distance) - _NEARER * error_mm
        mine = points[first[k] : first[k + 1]].reshape(-1, 2)
        if cut_off > 0.0 and len(mine):
            found[k] = shapely.dwithin(lines[number], shapely.points(mine), cut_off).any()
    return found


def _path(pieces: Floats) -> tuple[Floats, Floats]:
    """Two points on each piece, (m, 2, 2) float, mm, and the length of the polygon through them, (m,) float, mm."""
    rows = np.einsum("tk,pkd->ptd", _BASIS, pieces * np.where(np.arange(3) < 2, pieces[:, :, 2:], 1.0))
    path = rows[:, :, :2] / rows[:, :, 2:]
    corners = np.concatenate([path, pieces[:, 3:, :2]], axis=1)
    return path[:, ::2], np.hypot(*np.moveaxis(np.diff(corners, axis=1), 2, 0)).sum(axis=1)


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
