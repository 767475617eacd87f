"""Ruled walls from outlines alone, where contours fit the facets so closely that their corners leave fans of rulings."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate
from planner.plan import Wall

Floats = NDArray[np.float64]

_STEP_MM = 0.4  # between rulings
_EVEN_MM = 0.8  # along the outline, over which the rulings' directions are evened
_FEWEST = 24  # rulings of a wall
_CORNER = np.cos(np.radians(25.0))  # an outline that turns more from ruling to ruling has a corner there


Lift = Callable[[Floats], Floats]
"""Heights, (n,) mm, of a section at places, (n, 2) mm."""


def even_walls(areas: Sequence[MultiPolygon], lifts: tuple[Lift, Lift]) -> tuple[Wall, ...]:
    """Walls whose rulings cross the outlines by the shortest way, their directions evened along the outline.

    areas : bottom, middle and top section, seen along one direction, mm   lifts : of bottom and top, which may lean
    Rulings go through places evenly round the middle outline, to the nearest place of the bottom's and of the top's. How
    near the walls come to the sections is for the caller to measure. Empty where outlines do not correspond one to one.
    """
    rings = [[ring for part in area.geoms for ring in (part.exterior, *part.interiors)] for area in areas]
    if not rings[0] or len({len(each) for each in rings}) > 1:
        return ()
    walls = []
    for middle in rings[1]:
        near = [min(each, key=lambda ring: float(shapely.hausdorff_distance(ring, middle))) for each in (rings[0], rings[2])]
        wall = _wall(middle, near[0], near[1], lifts)
        if wall is None:
            return ()
        walls.append(wall)
    return tuple(walls)


def _wall(
    middle: shapely.LinearRing, low: shapely.LinearRing, high: shapely.LinearRing, lifts: tuple[Lift, Lift]
) -> Wall | None:
    """One wall; None where rulings meet, so that one of its outlines has fewer places than the other."""
    count = max(_FEWEST, int(np.ceil(middle.length / _STEP_MM)))
    spacing = middle.length / count
    places = shapely.line_interpolate_point(middle, spacing * np.arange(count))
    points = shapely.get_coordinates(places)
    chords = np.roll(points, -1, axis=0) - points
    chords /= np.maximum(np.linalg.norm(chords, axis=1), 1e-9)[:, None]
    corners = (chords * np.roll(chords, 1, axis=0)).sum(axis=1) < _CORNER
    curves = []
    for ring, lift in ((low, lifts[0]), (high, lifts[1])):
        nearest = shapely.get_coordinates(shapely.shortest_line(places, ring))[1::2]
        moved = points + _evened(nearest - points, spacing)
        curves.append(interpolate(np.column_stack([moved, lift(moved)]), closed=True, corners=corners))
    bottom, top = curves
    if len(bottom.breaks) != len(top.breaks):
        return None
    return Wall(_evenly_run(bottom), _evenly_run(top), 0.0)


def _evenly_run(curve: Curve) -> Curve:
    """The curve with its breaks spread evenly over 0 to 1, so that both ends of a ruling have one parameter."""
    breaks = curve.breaks
    knots = np.linspace(0.0, 1.0, len(breaks))[np.searchsorted(breaks, curve.knots)]
    return Curve(curve.degree, knots, curve.control_points, curve.weights)


def _evened(vectors: Floats, spacing_mm: float) -> Floats:
    """Vectors (n, 2) round a closed outline, weighted with their neighbours'."""
    reach = int(np.ceil(2.5 * _EVEN_MM / spacing_mm))
    steps = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (steps * spacing_mm / _EVEN_MM) ** 2)
    weights /= weights.sum()
    return np.asarray(sum(weight * np.roll(vectors, step, axis=0) for weight, step in zip(weights, steps, strict=True)))
