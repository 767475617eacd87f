"""Constant-distance offsets of planar regions, exact to a stated chord error.

A ready-made polygon buffer first drops vertices that lie within 1 % of the distance, so its result is off by
that much. Here every side of the boundary is moved by exactly the distance, joints are closed by arcs or mitres, the
crossing lines are cut at their crossings, and of the faces between them those at the right distance are kept: splits,
holes and vanishing regions need no cases of their own.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from planner.nurbs.densify import drop_collinear

Floats = NDArray[np.float64]
Region: TypeAlias = Polygon | MultiPolygon

CHORD_ERROR_MM = 5e-4  # of sampled curves and of arcs round corners: a quarter of the 2e-3 mm promised for offsets
_MAX_ARC_STEP = math.radians(10.0)  # arcs stay round to the eye, and smooth to the corner test, at any radius
_FOLD = 1e-9  # mm: vertices closer than this to their neighbours' chord carry no shape


def outset(region: Region, distance_mm: float, chord_error_mm: float = CHORD_ERROR_MM) -> MultiPolygon:
    """The region grown by the distance on all sides: all points within the distance of it.

    region : planar, mm, valid; holes shrink.   distance_mm : >= 0.
    Its outline keeps exactly the distance from the region's vertices and sides, arcs within chord_error_mm inside.
    Raises ValueError if the distance is negative or the chord error is not positive.
    """
    return _offset(region, distance_mm, chord_error_mm, outward=True)


def inset(region: Region, distance_mm: float, chord_error_mm: float = CHORD_ERROR_MM) -> MultiPolygon:
    """The region shrunk by the distance on all sides: all its points at least the distance from its outline.

    May split into several polygons or vanish (an empty MultiPolygon); holes grow.
    Raises ValueError if the distance is negative or the chord error is not positive.
    """
    return _offset(region, distance_mm, chord_error_mm, outward=False)


def inset_rings(region: Region, first_mm: float, step_mm: float, count: int) -> list[MultiPolygon]:
    """The region inset by first, first + step, ...: at most `count` regions, ending before the first empty one.

    Each is made from the region itself, so errors do not add up. Raises ValueError if the step is not positive.
    """
    if not step_mm > 0.0:
        raise ValueError(f"the step between insets must be positive, not {step_mm:g} mm")
    found = []
    for index in range(count):
        ring = inset(region, first_mm + index * step_mm)
        if ring.is_empty:
            break
        found.append(ring)
    return found


def _offset(region: Region, distance_mm: float, chord_error_mm: float, outward: bool) -> MultiPolygon:
    if not (distance_mm >= 0.0 and math.isfinite(distance_mm)) or not chord_error_mm > 0.0:
        raise ValueError(f"cannot offset by {distance_mm:g} mm with a chord error of {chord_error_mm:g} mm")
    polygons = [part for part in shapely.get_parts(region) if not part.is_empty]
    if not polygons or distance_mm == 0.0:
        return MultiPolygon(polygons)
    rings = [_oriented(part.exterior, False) for part in polygons]
    rings += [_oriented(hole, True) for part in polygons for hole in part.interiors]
    signed = distance_mm if outward else -distance_mm
    raw = [shapely.LinearRing(_raw_offset(ring, signed, chord_error_mm)) for ring in rings]
    faces = shapely.get_parts(shapely.polygonize([shapely.unary_union(raw)]))
    if len(faces) == 0:
        return MultiPolygon()
    inside = shapely.point_on_surface(faces)
    whole = MultiPolygon(polygons)
    shapely.prepare(whole)
    boundary = shapely.boundary(whole)
    shapely.prepare(boundary)
    within = shapely.covers(whole, inside)
    away = shapely.distance(boundary, inside)
    kept = within | (away < distance_mm) if outward else within & (away > distance_mm)
    return _without_slivers(shapely.union_all(faces[kept]), chord_error_mm)


def _oriented(line: shapely.LinearRing, is_hole: bool) -> Floats:
    """The ring's distinct points with the region on the left: outlines counter-clockwise, holes clockwise."""
    ring = shapely.get_coordinates(line)
    points = ring[:-1][np.any(ring[:-1] != ring[1:], axis=1)]
    points, _ = drop_collinear(points, _FOLD, closed=True)
    following = np.roll(points, -1, axis=0)
    area = float((points[:, 0] * following[:, 1] - points[:, 1] * following[:, 0]).sum())
    return points[::-1] if (area > 0.0) == is_hole else points


def _raw_offset(ring: Floats, signed_mm: float, chord_error_mm: float) -> Floats:
    """Every side moved by the signed distance to its right, joined at the vertices; it may cross itself.

    A vertex between nearly parallel sides moves along its bisector by exactly the distance (so do points of a sampled
    curve). A gap is filled by an arc of points at the distance; an overlap ends at the mitre where both sides are
    long enough for it, and else keeps both full ends.
    """
    distance = abs(signed_mm)
    sides = np.roll(ring, -1, axis=0) - ring
    length = np.linalg.norm(sides, axis=1)
    along = sides / length[:, None]
    before = np.roll(along, 1, axis=0)
    turn = np.arctan2(before[:, 0] * along[:, 1] - before[:, 1] * along[:, 0], (before * along).sum(axis=1))
    half = 0.5 * np.abs(turn)
    even = distance * (1.0 / np.maximum(np.cos(half), 1e-9) - 1.0) <= chord_error_mm
    gap = (turn > 0.0) == (signed_mm > 0.0)
    retreat = distance * np.tan(np.minimum(half, 0.5 * math.pi - 1e-9))
    mitre = ~even & ~gap & (retreat <= np.minimum(length, np.roll(length, 1)))
    step = min(_MAX_ARC_STEP, 2.0 * math.acos(max(1.0 - chord_error_mm / distance, 0.0)))
    arc_points = np.ceil(np.abs(turn) / step).astype(np.intp) + 1
    counts = np.where(even | mitre, 1, np.where(gap, arc_points, 2))
    owner = np.repeat(np.arange(len(ring)), counts)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = np.where(counts[owner] > 1, place / np.maximum(counts[owner] - 1, 1), 0.5)
    heading = np.arctan2(before[owner, 1], before[owner, 0]) + share * turn[owner]
    reach = np.where(mitre[owner], signed_mm / np.maximum(np.cos(half[owner]), 1e-9), signed_mm)
    return np.asarray(ring[owner] + reach[:, None] * np.column_stack([np.sin(heading), -np.cos(heading)]))


def _without_slivers(shape: Region, chord_error_mm: float) -> MultiPolygon:
    """Drop polygons and holes whose mean width (2 area / length) is below the chord error: crumbs of the cutting."""
    kept = []
    for part in shapely.get_parts(shape):
        if part.geom_type != "Polygon" or 2.0 * part.area < chord_error_mm * part.length:
            continue
        holes = [hole for hole in part.interiors if 2.0 * Polygon(hole).area >= chord_error_mm * hole.length]
        kept.append(Polygon(part.exterior, holes))
    return MultiPolygon(kept)
