"""Regions of one plane: whether they are the same, their union, what they share, what one has beyond the other."""

from __future__ import annotations

from functools import reduce

import numpy as np
import shapely
from shapely import MultiPolygon

SAME_MM = 1e-4
"""Sections nearer than this to each other count as one: a hundredth of what a five-axis machine holds."""
_GRID_MM = 1e-6  # overlays are made on this grid, so that nearly equal outlines leave no slivers


def is_same(first: MultiPolygon, second: MultiPolygon, tolerance_mm: float = SAME_MM) -> bool:
    """Whether the outlines of two regions lie within the tolerance of each other."""
    if first.is_empty or second.is_empty:
        return bool(first.is_empty and second.is_empty)
    if len(first.geoms) != len(second.geoms):
        return False
    if np.abs(np.subtract(first.bounds, second.bounds)).max() > tolerance_mm:
        return False
    return _is_near(first, second, tolerance_mm) and _is_near(second, first, tolerance_mm)


def _is_near(first: MultiPolygon, second: MultiPolygon, tolerance_mm: float) -> bool:
    """Whether all vertices of one outline lie within the tolerance of the other outline."""
    outline = second.boundary
    shapely.prepare(outline)
    return bool(shapely.dwithin(outline, shapely.points(shapely.get_coordinates(first)), tolerance_mm).all())


def united(areas: list[MultiPolygon]) -> MultiPolygon:
    """The union; one of the regions itself where they are the same or it holds all others."""
    filled = [area for area in areas if not area.is_empty]
    if not filled:
        return MultiPolygon()
    largest = max(filled, key=lambda area: area.area)
    if all(is_same(largest, area) for area in filled):
        return largest
    whole = shapely.union_all(filled, grid_size=_GRID_MM)
    if whole.area - largest.area <= SAME_MM * largest.length:
        return largest
    return MultiPolygon([part for part in shapely.get_parts(whole) if part.geom_type == "Polygon"])


def common(areas: list[MultiPolygon]) -> MultiPolygon:
    """What all regions cover; one of them itself where they are the same or all others hold it."""
    if not areas or any(area.is_empty for area in areas):
        return MultiPolygon()
    smallest = min(areas, key=lambda area: area.area)
    if all(is_same(smallest, area) for area in areas):
        return smallest
    core = reduce(lambda first, second: shapely.intersection(first, second, grid_size=_GRID_MM), areas)
    if smallest.area - core.area <= SAME_MM * smallest.length:
        return smallest
    return MultiPolygon([part for part in shapely.get_parts(core) if part.geom_type == "Polygon"])


def covers(outer: MultiPolygon, inner: MultiPolygon) -> bool:
    """Whether a region holds all of another."""
    if outer.is_empty or inner.is_empty:
        return bool(inner.is_empty)
    if (np.array(inner.bounds[:2]) < outer.bounds[:2]).any() or (np.array(inner.bounds[2:]) > outer.bounds[2:]).any():
        return False
    shapely.prepare(outer)
    return bool(shapely.covers(outer, inner))


def cut_away(region: MultiPolygon, other: MultiPolygon) -> MultiPolygon:
    """What a region has beyond another, mm; pieces thinner than SAME_MM are rounding and left out."""
    return _without_slivers(shapely.difference(region, other, grid_size=_GRID_MM))


def shared(first: MultiPolygon, second: MultiPolygon) -> MultiPolygon:
    """What both regions cover, mm; pieces thinner than SAME_MM are left out."""
    return _without_slivers(shapely.intersection(first, second, grid_size=_GRID_MM))


def _without_slivers(shape: shapely.Geometry) -> MultiPolygon:
    """The polygons of a shape that are wider than SAME_MM."""
    pieces = [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
    return MultiPolygon([part for part in pieces if 2.0 * part.area > SAME_MM * part.length])
