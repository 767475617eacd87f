"""What of a layer rests on the layer below and what hangs beside it (paper Eq. 1), as exact regions of one plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely import MultiPolygon

from planner.slicing.plane_regions import SAME_MM, covers, cut_away, is_same, shared

Floats = NDArray[np.float64]

_NOTHING = MultiPolygon()
_FINE = 12  # samples over the narrower side of an overhang: its reach is known to a few percent of itself
_MOST_SAMPLES = 1000  # of one overhang


@dataclass(frozen=True)
class Overhang:
    """Paper Eq. 1 in the plane between two layers, in that plane's xy, mm.

    overlap, overhang : what of the upper layer's bottom lies on the lower layer's top, and what does not
    level : the part of the overhang that is the part's own underside, not the step of a leaning wall
    afloat : pieces of the layer that touch nothing of the layer below; they belong to both of the above
    reach_mm, level_reach_mm : greatest distance from the overlap to a point of the overhang and of its level part
    unsupported_mm : the same measured along the side surface: on a leaning wall from the lower outline up to the layer's
        upper edge; in the plane under an underside. Where nothing overlaps: the overhang's own extent.
    """

    overlap: MultiPolygon
    overhang: MultiPolygon = _NOTHING
    level: MultiPolygon = _NOTHING
    afloat: MultiPolygon = _NOTHING
    reach_mm: float = 0.0
    level_reach_mm: float = 0.0
    unsupported_mm: float = 0.0


def overhang(
    upper_bottom: MultiPolygon,
    lower_top: MultiPolygon,
    height_mm: float = 0.0,
    underside: MultiPolygon | None = None,
) -> Overhang:
    """What of a layer rests on the layer below and what does not (paper Eq. 1), both in their common plane, mm.

    upper_bottom : what the layer is built from   lower_top : what the layer below was built from
    height_mm : of the layer; 0: all overhang counts as underside
    underside : the layer's own bottom section, which tells undersides from leaning walls; None: `upper_bottom`.
    Exact planar regions with holes, overlaid on a fixed grid; slivers thinner than SAME_MM belong to the overlap.
    """
    if upper_bottom.is_empty or is_same(upper_bottom, lower_top) or covers(lower_top, upper_bottom):
        return Overhang(upper_bottom)
    beyond = cut_away(upper_bottom, lower_top)
    if beyond.is_empty:
        return Overhang(upper_bottom)
    overlap = shared(upper_bottom, lower_top)
    level = beyond
    if height_mm > 0.0 and underside is not None:
        rests = is_same(underside, lower_top) or covers(lower_top, underside)
        level = _NOTHING if rests else cut_away(underside, lower_top)
    reach, level_reach, along = _reaches(overlap, beyond, level, height_mm)
    return Overhang(overlap, beyond, level, _afloat(upper_bottom, overlap), reach, level_reach, along)


def _afloat(upper_bottom: MultiPolygon, overlap: MultiPolygon) -> MultiPolygon:
    """The pieces of a layer that touch nothing of the layer below, mm."""
    if overlap.is_empty:
        return upper_bottom
    if len(upper_bottom.geoms) == 1:
        return _NOTHING
    shapely.prepare(overlap)
    return MultiPolygon([piece for piece in upper_bottom.geoms if not shapely.intersects(overlap, piece)])


def _reaches(
    overlap: MultiPolygon, beyond: MultiPolygon, level: MultiPolygon, height_mm: float
) -> tuple[float, float, float]:
    """Greatest distance from the overlap, mm: in the plane, in the plane to the level part, along the side surface."""
    if overlap.is_empty:
        low, high = np.array(beyond.bounds[:2]), np.array(beyond.bounds[2:])
        extent = float(np.linalg.norm(high - low))
        return extent, 0.0 if level.is_empty else extent, extent
    pitch = _pitch(beyond)
    carrier = cKDTree(shapely.get_coordinates(shapely.segmentize(overlap.boundary, pitch)))
    points = _samples(beyond, pitch)
    away = np.asarray(carrier.query(points)[0])
    reach = float(away.max())
    leans = np.hypot(away, height_mm)
    if level.is_empty:
        return reach, 0.0, float(leans.max())
    if level is not beyond:
        grown = shapely.buffer(level, SAME_MM, quad_segs=1)
        shapely.prepare(grown)
        flat = shapely.contains_xy(grown, points[:, 0], points[:, 1])
    else:
        flat = np.ones(len(points), dtype=np.bool_)
    level_reach = float(away[flat].max(initial=0.0))
    return reach, level_reach, max(level_reach, float(leans[~flat].max(initial=0.0)))


def _pitch(region: MultiPolygon) -> float:
    """Distance of samples, mm: a share of how wide the region is, but not so fine that there are too many."""
    across = 2.0 * region.area / region.length
    most = max(region.length / _MOST_SAMPLES, np.sqrt(region.area / _MOST_SAMPLES))
    return float(max(across / _FINE, most, SAME_MM))


def _samples(region: MultiPolygon, pitch_mm: float) -> Floats:
    """(n, 2) float, mm   Points of a region: all its vertices, its outline at the pitch, and the inside at four times it."""
    outline = shapely.get_coordinates(shapely.segmentize(region.boundary, pitch_mm))
    low_x, low_y, high_x, high_y = region.bounds
    grid = 4.0 * pitch_mm
    x, y = np.arange(low_x + 0.5 * grid, high_x, grid), np.arange(low_y + 0.5 * grid, high_y, grid)
    if len(x) * len(y) > 4 * _MOST_SAMPLES:
        return np.asarray(outline)
    inner = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    shapely.prepare(region)
    return np.vstack([outline, inner[shapely.contains_xy(region, inner[:, 0], inner[:, 1])]])
