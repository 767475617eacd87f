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
from planner.nurbs.offset import CHORD_ERROR_MM, Region
from planner.nurbs.sampling import divide_evenly

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_CORNER_RAD = np.radians(25.0)  # arcs of offsets turn by 10 degrees at most from point to point
_FINE = 2.0  # times the chord error: what a vertex of a sampled smooth curve may bulge
_TURN_PER_PIECE = 0.4  # rad: one cubic piece per 23 degrees stays within 1e-4 of the radius
_REFINEMENTS = 10


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
    the tolerance allows. Raises ValueError if the tolerance is not positive.
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
            [thinned[i].points for i in waiting], closed=True, corners=[thinned[i].corner for i in waiting]
        )
        still = []
        for index, curve in zip(waiting, fitted, strict=True):
            curves[index] = curve
            if attempt < _REFINEMENTS and thinned[index].refine(curve):
                still.append(index)
        waiting = still
    return [curve for curve in curves if curve is not None]


class _Loop:
    """A dense closed polyline and the few places on it (by length along it) that the curve goes through."""

    def __init__(self, loop: Floats, tolerance_mm: float) -> None:
        path = loop[np.any(loop != np.roll(loop, 1, axis=0), axis=1)]
        turn = turning_angles(path, closed=True)
        start = int(np.argmax(turn))
        path, turn = np.roll(path, -start, axis=0), np.roll(turn, -start)
        sides = np.linalg.norm(np.roll(path, -1, axis=0) - path, axis=1)
        fine = _FINE * min(CHORD_ERROR_MM, tolerance_mm)
        bulge = turn * np.minimum(sides, np.roll(sides, 1)) / 8.0
        self._tolerance = tolerance_mm
        self._path = np.vstack([path, path[:1]])
        self._at = np.concatenate([[0.0], np.cumsum(sides)])
        self._is_corner = (turn > _CORNER_RAD) | (bulge > fine)
        straight = sides * np.maximum(turn, np.roll(turn, -1)) / 8.0 > fine
        self._line = shapely.LineString(self._path)
        shapely.prepare(self._line)
        self._set_places(self._first_places(turn, sides, straight))

    def _first_places(self, turn: Floats, sides: Floats, straight: Mask) -> Floats:
        """Corners, both thirds and ends of straight sides, and vertices so that no piece turns or reaches too far."""
        radius = np.maximum(0.5 * (sides + np.roll(sides, 1)) / np.maximum(turn, 1e-12), 1e-9)
        reach = np.minimum(_TURN_PER_PIECE * radius, (0.1 * self._tolerance * radius**3 / 2.6e-3) ** 0.25)
        smooth = ~self._is_corner
        cost = sides * 0.5 * (smooth / reach + np.roll(smooth / reach, -1))
        cost[straight] = 0.0
        passed = np.concatenate([[0.0], np.cumsum(cost)])[:-1]
        steps = np.floor(passed)
        chosen = np.diff(steps, prepend=-1.0) > 0.0
        chosen |= self._is_corner | straight | np.roll(straight, 1)
        thirds = [self._at[:-1][straight] + share * sides[straight] for share in (1.0 / 3.0, 2.0 / 3.0)]
        chosen[0] = True
        places = np.concatenate([self._at[:-1][chosen], *thirds])
        even = self._at[:-1][np.linspace(0, len(sides) - 1, min(len(sides), 6)).astype(np.intp)]
        return places if len(places) >= 6 else np.concatenate([places, even])

    def _set_places(self, places: Floats) -> None:
        self.places = np.unique(places)
        self.points = np.column_stack([np.interp(self.places, self._at, self._path[:, axis]) for axis in (0, 1)])
        self.corner = np.isin(self.places, self._at[:-1][self._is_corner])

    def refine(self, curve: Curve) -> bool:
        """Add places in every piece of the curve that leaves the tolerance; whether there were any."""
        edges = curve.breaks
        samples = divide_evenly(edges, np.full(len(edges) - 1, 8, dtype=np.intp))[:-1]
        away = shapely.distance(self._line, shapely.points(curve.evaluate(samples))).reshape(-1, 8).max(axis=1)
        low, high = self.places, np.append(self.places[1:], self._at[-1])
        if len(away) != len(low):
            raise FitError("a ring repeats a point within 1e-9 mm", "use a coarser chord error")
        skipped = self._skipped(curve, edges)
        bad = np.flatnonzero(np.maximum(away, skipped) > self._tolerance)
        if bad.size == 0:
            return False
        middle = 0.5 * (low[bad] + high[bad])
        vertices = self._at[:-1]
        nearest = np.searchsorted(vertices, middle)
        pick = vertices[np.minimum(nearest, len(vertices) - 1)]
        lower = vertices[np.maximum(nearest - 1, 0)]
        pick = np.where(np.abs(lower - middle) < np.abs(pick - middle), lower, pick)
        has_vertex = (pick > low[bad]) & (pick < high[bad])
        width = (high - low)[bad][~has_vertex]
        thirds = [low[bad][~has_vertex] + share * width for share in (1.0 / 3.0, 2.0 / 3.0)]
        self._set_places(np.concatenate([self.places, pick[has_vertex], *thirds]))
        return True

    def _skipped(self, curve: Curve, edges: Floats) -> Floats:
        """Per piece, the largest distance of the polyline's own vertices from the piece's samples (as chords)."""
        vertices = self._at[:-1]
        piece = np.clip(np.searchsorted(self.places, vertices, side="right") - 1, 0, len(edges) - 2)
        ends = np.append(self.places, self._at[-1])
        share = (vertices - ends[piece]) / (ends[piece + 1] - ends[piece])
        u = edges[piece] + share * (edges[piece + 1] - edges[piece])
        point, first = curve.derivatives(u, 1)
        away = self._path[:-1] - point
        along = np.einsum("ij,ij->i", away, first) / np.maximum(np.einsum("ij,ij->i", first, first), 1e-300)
        distance = np.linalg.norm(self._path[:-1] - curve.evaluate(np.clip(u + along, edges[0], edges[-1])), axis=1)
        worst = np.zeros(len(edges) - 1)
        np.maximum.at(worst, piece, distance)
        return worst

    def keep_every_side(self) -> None:
        """Go through all vertices, each a corner: the polyline itself."""
        self._is_corner[:] = True
        self._set_places(self._at[:-1])
