"""Between planar regions and closed NURBS curves: curves bound a region, a region's rings become curves again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from planner.errors import FitError
from planner.nurbs.corners import turning_angles
from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate_many
from planner.nurbs.measure import feet_on_segments
from planner.nurbs.offset import CHORD_ERROR_MM, Region
from planner.nurbs.sampling import divide_evenly

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_CORNER_RAD = np.radians(25.0)  # arcs of offsets turn by 10 degrees at most from point to point
_FINE = 2.0  # times the chord error: what a vertex of a sampled smooth curve may bulge
_TURN_PER_PIECE = 0.4  # rad: one cubic piece per 23 degrees stays within 1e-4 of the radius
_REFINEMENTS = 10
_SAME_MM = 1e-7  # vertices that the cutting of polygons left closer than this are one
_HERMITE = 2.6e-3  # error of a cubic piece of length h on a circle: 2.6e-3 h⁴ / R³ (measured: R 23, 100 pieces)
_LEAST_PIECES = 6  # of a closed curve: fewer turn by more than equal speed can follow
_BESIDE = 3  # sides before and after that are looked at: equal speed keeps curve and polyline in step that closely
_PROBES = 8  # per piece, where it is measured against the polyline


@dataclass(frozen=True)
class Ring:
    """One closed curve of a region's outline.

    curve   : 2-D, outlines counter-clockwise, holes clockwise
    is_hole : whether it bounds a hole
    parent  : for a hole, index of its outline in the same list; else -1
    """

    curve: Curve
    is_hole: bool
    parent: int


def region_from_curves(curves: Sequence[Curve], chord_error_mm: float = CHORD_ERROR_MM) -> MultiPolygon:
    """The region that closed curves bound by the even-odd rule, whatever their sense and order.

    curves : closed, in the plane (further coordinates are left out)
    Raises FitError if a curve is open.
    """
    loops = []
    for index, curve in enumerate(curves):
        if not curve.is_closed:
            raise FitError(f"curve {index} is open and bounds no region")
        loops.append(curve.evaluate(curve.sample(chord_error_mm))[:-1, :2])
    return region_from_loops(loops)


def region_from_loops(loops: Sequence[Floats]) -> MultiPolygon:
    """The region that closed polylines bound by the even-odd rule.

    loops : each (n, 2) float, mm, last != first; they may cross or touch themselves and each other.
    """
    polygons = [shapely.make_valid(Polygon(loop), method="linework") for loop in loops if len(loop) >= 3]
    if not polygons:
        return MultiPolygon()
    lines = shapely.unary_union([shapely.boundary(polygon) for polygon in polygons])
    faces = shapely.get_parts(shapely.polygonize([lines]))
    inside = shapely.point_on_surface(faces)
    depth = np.zeros(len(faces), dtype=np.intp)
    for polygon in polygons:
        shapely.prepare(polygon)
        depth += shapely.covers(polygon, inside)
    whole = shapely.union_all(faces[depth % 2 == 1])
    return MultiPolygon([part for part in shapely.get_parts(whole) if part.geom_type == "Polygon"])


def curves_from_region(region: Region, tolerance_mm: float = 1e-3) -> list[Ring]:
    """The region's rings as NURBS curves within the tolerance of them, each outline followed by its holes.

    Corners stay corners, straight sides straight; smooth stretches are fitted through as few of their own points as
    the tolerance allows. A tolerance below the rings' own chord error holds at their vertices only.
    Raises ValueError if the tolerance is not positive.
    """
    if not tolerance_mm > 0.0:
        raise ValueError(f"the tolerance must be positive, not {tolerance_mm:g} mm")
    loops: list[Floats] = []
    roles: list[tuple[bool, int]] = []
    for part in shapely.get_parts(region):
        if part.is_empty:
            continue
        parent = len(loops)
        oriented = shapely.orient_polygons(part)
        for hole, line in enumerate([oriented.exterior, *oriented.interiors]):
            loops.append(shapely.get_coordinates(line)[:-1])
            roles.append((hole > 0, parent if hole else -1))
    curves = fit_loops(loops, tolerance_mm)
    return [Ring(curve, is_hole, parent) for curve, (is_hole, parent) in zip(curves, roles, strict=True)]


def fit_loops(loops: Sequence[Floats], tolerance_mm: float) -> list[Curve]:
    """Curves within the tolerance of dense closed polylines, all refined together.

    loops : each (n, 2) float, mm, last != first.
    """
    thinned = [_Loop(loop, tolerance_mm) for loop in loops]
    curves: list[Curve | None] = [None] * len(thinned)
    waiting = list(range(len(thinned)))
    for attempt in range(_REFINEMENTS + 1):
        if not waiting:
            break
        if attempt == _REFINEMENTS:
            for index in waiting:
                thinned[index].keep_every_side()
        fitted = interpolate_many(
            [thinned[i].points for i in waiting],
            closed=True,
            corners=[thinned[i].corner for i in waiting],
            tangents=[thinned[i].tangents for i in waiting],
            handles="speed",
        )
        still = []
        for index, curve in zip(waiting, fitted, strict=True):
            curves[index] = curve
            if attempt < _REFINEMENTS and thinned[index].refine(curve):
                still.append(index)
        waiting = still
    return [curve for curve in curves if curve is not None]


class _Loop:
    """A dense closed polyline and the few of its vertices that the curve goes through."""

    def __init__(self, loop: Floats, tolerance_mm: float) -> None:
        path = loop[np.linalg.norm(loop - np.roll(loop, 1, axis=0), axis=1) > _SAME_MM]
        turn = turning_angles(path, closed=True)
        start = int(np.argmax(turn))
        self._path, turn = np.roll(path, -start, axis=0), np.roll(turn, -start)
        self._tolerance = tolerance_mm
        sides = np.roll(self._path, -1, axis=0) - self._path
        length = np.linalg.norm(sides, axis=1)
        fine = _FINE * min(CHORD_ERROR_MM, tolerance_mm)
        self._is_corner = (turn > _CORNER_RAD) | (turn * np.minimum(length, np.roll(length, 1)) / 8.0 > fine)
        is_straight = length * np.maximum(turn, np.roll(turn, -1)) / 8.0 > fine
        self._tangents = _circle_tangents(sides / length[:, None], length, is_straight)
        self._at = np.concatenate([[0.0], np.cumsum(length)])
        self._is_chosen = self._first_choice(turn, length, is_straight)

    def _first_choice(self, turn: Floats, length: Floats, is_straight: Mask) -> Mask:
        """Corners, ends of straight sides, and vertices so that no piece turns or reaches too far."""
        radius = np.maximum(0.5 * (length + np.roll(length, 1)) / np.maximum(turn, 1e-12), 1e-9)
        reach = np.minimum(_TURN_PER_PIECE * radius, (0.2 * self._tolerance * radius**3 / _HERMITE) ** 0.25)
        rate = np.where(self._is_corner, 0.0, 1.0 / reach)
        cost = np.where(is_straight, 0.0, 0.5 * length * (rate + np.roll(rate, -1)))
        passed = np.floor(np.concatenate([[0.0], np.cumsum(cost)])[:-1])
        chosen = np.diff(passed, prepend=-1.0) > 0.0
        chosen |= self._is_corner | is_straight | np.roll(is_straight, 1)
        if chosen.sum() < _LEAST_PIECES:
            chosen[np.linspace(0, len(chosen) - 1, min(len(chosen), _LEAST_PIECES)).astype(np.intp)] = True
        return np.asarray(chosen)

    @property
    def points(self) -> Floats:
        """(k, 2) float, mm   The vertices that the curve goes through."""
        return np.asarray(self._path[self._is_chosen])

    @property
    def corner(self) -> Mask:
        """(k,) bool   Which of them are corners."""
        return np.asarray(self._is_corner[self._is_chosen])

    @property
    def tangents(self) -> Floats:
        """(k, 2) float   The polyline's own directions at them."""
        return self._tangents[self._is_chosen]

    def refine(self, curve: Curve) -> bool:
        """Go through one more vertex in every piece of the curve that leaves the tolerance; whether there were any.

        A piece without another vertex becomes straight: both its ends are corners then.
        """
        edges = curve.breaks
        chosen = np.flatnonzero(self._is_chosen)
        if len(edges) != len(chosen) + 1:
            raise FitError("a ring repeats a point within 1e-9 mm", "use a coarser chord error")
        worst = np.maximum(self._strayed(curve, chosen), self._skipped(curve, chosen))
        bad = np.flatnonzero(worst > self._tolerance)
        low, high = chosen[bad], np.append(chosen[1:], len(self._path))[bad]
        middle = np.searchsorted(self._at, 0.5 * (self._at[low] + self._at[high]))
        self._is_chosen[np.clip(middle, low + 1, high - 1)[high - low > 1]] = True
        bare = high - low == 1
        self._is_corner[np.concatenate([low[bare], high[bare] % len(self._path)])] = True
        return bool(bad.size)

    def _strayed(self, curve: Curve, chosen: NDArray[np.intp]) -> Floats:
        """Per piece, the largest distance of its probes from the sides of the polyline about as far along."""
        count = len(self._path)
        u = divide_evenly(curve.breaks, np.full(len(chosen), _PROBES, dtype=np.intp))[:-1]
        at = divide_evenly(np.append(self._at[chosen], self._at[-1]), np.full(len(chosen), _PROBES, dtype=np.intp))[:-1]
        sides = np.searchsorted(self._at, at, side="right")[:, None] - 1 + np.arange(-_BESIDE, _BESIDE + 1)
        low, high = self._path[sides % count], self._path[(sides + 1) % count]
        _, distance = feet_on_segments(curve.evaluate(u)[:, None, :], low, high)
        return np.asarray(distance.min(axis=1).reshape(-1, _PROBES).max(axis=1))

    def _skipped(self, curve: Curve, chosen: NDArray[np.intp]) -> Floats:
        """Per piece, the largest distance from the curve of the vertices that it passes by."""
        edges = curve.breaks
        piece = np.searchsorted(chosen, np.arange(len(self._path)), side="right") - 1
        reached = np.append(self._at[chosen], self._at[-1])
        share = (self._at[:-1] - reached[piece]) / (reached[piece + 1] - reached[piece])
        u = edges[piece] + share * (edges[piece + 1] - edges[piece])
        point, first = curve.derivatives(u, 1)
        along = ((self._path - point) * first).sum(axis=1) / np.maximum((first**2).sum(axis=1), 1e-300)
        foot = curve.evaluate(np.clip(u + along, edges[piece], edges[piece + 1]))
        worst = np.zeros(len(edges) - 1)
        np.maximum.at(worst, piece, np.linalg.norm(self._path - foot, axis=1))
        return worst

    def keep_every_side(self) -> None:
        """Go through all vertices, each a corner: the polyline itself."""
        self._is_corner[:] = True
        self._is_chosen[:] = True


def _circle_tangents(directions: Floats, length: Floats, is_straight: Mask) -> Floats:
    """At every vertex the tangent of the circle through it and its neighbours; beside a straight side, its direction.

    directions : (n, 2) unit, of the side after each vertex.   length : (n,) of it.
    """
    before, length_before = np.roll(directions, 1, axis=0), np.roll(length, 1)
    tangents = before * length[:, None] + directions * length_before[:, None]
    after_straight = np.roll(is_straight, 1)
    tangents = np.where(after_straight[:, None], before, tangents)
    return np.where((is_straight & (~after_straight | (length > length_before)))[:, None], directions, tangents)
