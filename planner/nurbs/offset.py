"""Constant-distance offsets of planar regions, exact to a stated chord error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import shapely
from numba import njit
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
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


@dataclass(frozen=True, eq=False)
class OffsetRings:
    """The outlines of many offset regions, material on the left, each outline followed by its holes.

    points : (n, 2) float, mm, of all rings, none repeats its first   first : (r+1,) int, first point of each ring
    owner : (r,) int, which region a ring belongs to   is_hole : (r,) bool
    """

    points: Floats
    first: Ints
    owner: Ints
    is_hole: NDArray[np.bool_]


def signed_offsets(
    regions: Sequence[Region], distances_mm: Sequence[float], chord_error_mm: float = CHORD_ERROR_MM
) -> OffsetRings:
    """Each region grown (> 0) or shrunk (< 0) by its own distance, those of one distance in one call.

    Raises ValueError as `outset`, or if there are not as many distances as regions.
    """
    given, reach = np.array([*regions, None], dtype=object)[:-1], np.asarray(distances_mm, dtype=np.float64)
    if reach.shape != given.shape:
        raise ValueError(f"{reach.size} distances for {given.size} regions")
    moved = given.copy()
    for distance in np.unique(reach):
        mine = np.flatnonzero(reach == distance) if math.isfinite(distance) else np.arange(len(reach))
        moved[mine] = _moved(given[mine], float(distance), chord_error_mm)
    parts, owner = shapely.get_parts(moved, return_index=True)
    filled = (shapely.get_type_id(parts) == 3) & ~shapely.is_empty(parts)
    parts, owner = parts[filled], owner[filled]
    lines, part = shapely.get_rings(parts, return_index=True)
    return _rings(shapely.get_coordinates(lines), shapely.get_num_coordinates(lines), owner, part, chord_error_mm)


def _rings(
    path: Floats, counts: Ints, owner: Ints, part: Ints, chord_error_mm: float
) -> OffsetRings:
    """Rings turned material left, without those whose mean width is below the chord error.

    path : (n, 2) float, mm, closed rings of `counts` points   owner : of each part   part : of each ring.
    """
    points, first, kept, is_hole = _turned(path, counts.astype(np.int64), part.astype(np.int64), chord_error_mm)
    return OffsetRings(points, first, owner[part[kept]], is_hole)


@njit(cache=True, error_model="numpy", nogil=True)
def _turned(
    path: Floats, counts: Ints, part: Ints, chord_error_mm: float
) -> tuple[Floats, Ints, Ints, NDArray[np.bool_]]:  # pragma: no cover
    """Points and first points of the rings that stay, which of the given they are, and which are holes."""
    points = np.empty((len(path), 2))
    first, kept = np.zeros(len(counts) + 1, dtype=np.int64), np.empty(len(counts), dtype=np.int64)
    is_hole = np.zeros(len(counts), dtype=np.bool_)
    found, start, wide = 0, 0, True
    for ring in range(len(counts)):
        end = start + counts[ring] - 1
        inner = ring > 0 and part[ring] == part[ring - 1]
        area, length = 0.0, 0.0
        for k in range(start, end):
            dx, dy = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
            area += (path[k, 0] - path[start, 0]) * dy - (path[k, 1] - path[start, 1]) * dx
            length += np.sqrt(dx * dx + dy * dy)
        stays = abs(area) >= chord_error_mm * length and (wide or not inner)
        if not inner:
            wide = stays
        if stays:
            at = first[found]
            for k in range(end - start):
                points[at + k] = path[end - k] if (area < 0.0) != inner else path[start + k]
            first[found + 1] = at + end - start
            kept[found], is_hole[found] = ring, inner
            found += 1
        start = end + 1
    return points[: first[found]].copy(), first[: found + 1], kept[:found], is_hole[:found]


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
