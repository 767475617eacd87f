"""Constant-distance offsets of planar regions, exact to a stated chord error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

Region: TypeAlias = Polygon | MultiPolygon

CHORD_ERROR_MM = 5e-4  # of sampled curves and of arcs round corners: a quarter of the 2e-3 mm promised for offsets
_ARC_STEP = math.radians(10.0)  # at most, so that arcs stay smooth to the corner test at any radius


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


def signed_offsets(
    regions: Sequence[Region], distances_mm: Sequence[float], chord_error_mm: float = CHORD_ERROR_MM
) -> list[list[MultiPolygon]]:
    """Each region grown (> 0) or shrunk (< 0) by each distance: result[region][distance].

    Raises ValueError as `outset`.
    """
    columns = [_moved(np.array(regions, dtype=object), float(d), chord_error_mm) for d in distances_mm]
    return [[_without_slivers(column[k], chord_error_mm) for column in columns] for k in range(len(regions))]


def _moved(regions: NDArray[np.object_], distance_mm: float, chord_error_mm: float) -> NDArray[np.object_]:
    """Buffers with round joins, arcs fine enough for the chord error, crumbs still in them."""
    reach = abs(distance_mm)
    if not math.isfinite(reach) or not chord_error_mm > 0.0:
        raise ValueError(f"cannot offset by {distance_mm:g} mm with a chord error of {chord_error_mm:g} mm")
    if reach == 0.0:
        return regions
    step = min(_ARC_STEP, 2.0 * math.acos(max(1.0 - chord_error_mm / reach, 0.0)))
    return np.asarray(shapely.buffer(regions, distance_mm, quad_segs=math.ceil(0.5 * math.pi / step)), dtype=object)


def _offset(region: Region, distance_mm: float, chord_error_mm: float, outward: bool) -> MultiPolygon:
    """One buffer, polygons only, crumbs dropped."""
    if not distance_mm >= 0.0:
        raise ValueError(f"cannot offset by {distance_mm:g} mm: the sense is in the name")
    signed = distance_mm if outward else -distance_mm
    moved = _moved(np.array([region], dtype=object), signed, chord_error_mm)[0]
    return _without_slivers(moved, chord_error_mm if distance_mm > 0.0 else 0.0)


def _without_slivers(shape: Region, chord_error_mm: float) -> MultiPolygon:
    """Drop polygons and holes whose mean width (2 area / length) is below the chord error: crumbs of the cutting."""
    kept = []
    for part in shapely.get_parts(shape):
        if part.geom_type != "Polygon" or 2.0 * part.area < chord_error_mm * part.length:
            continue
        holes = [hole for hole in part.interiors if 2.0 * Polygon(hole).area >= chord_error_mm * hole.length]
        kept.append(Polygon(part.exterior, holes))
    return MultiPolygon(kept)
