"""Where the side surface of a layer leans outward beyond what it carries: points along the outline, with lean and tilt."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.process import Settings
from planner.slicing.regions import LayerRegion
from planner.toolpath.clearance import cleared_tilt
from planner.toolpath.tilt import MARGIN_DEG, growth_share, smoothed, tilt_deg

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Heights = Callable[[Floats], Floats]

LEVEL_DEG = 80.0
"""Walls that lean more are undersides, built from the side in level passes."""
_STEP_MM = 0.5  # between points along an outline: a quarter of a bead's width
_FEWEST = 12  # points round the smallest outline
_NEAR_MM = 0.3  # of the overhang: where the side surface leans but stands on something, the head stays upright
_CORNER_RAD = np.radians(30.0)
_ENDS = 2.0  # heights of a layer, widths of a wall: so near its ends a side's own lean is not seen
_TILT_SMOOTH_MM = 4.0  # along an outline on either side: a change of tilt takes as long as two beads are wide
_LEAST_RUN_MM = 2.0  # shorter stretches of leaning wall are corners
_SAME_MM = 0.05  # of an outline: on it
_ACROSS_MM = 60.0  # how far the width of a layer is looked for across its outline


@dataclass(frozen=True, eq=False)
class Run:
    """A stretch of an outline along which the wall leans out.

    points : (n, 2) float, mm, on the outline half-way up the layer, the material on their left   closed : all the way round
    outward : (n, 2) float, unit   lean_deg, tilt_deg : (n,) float   height_mm : (n,) float, of the layer there
    across_mm : (n,) float, width of the layer across the outline   spacing_mm : of the points along the outline
    """

    points: Floats
    outward: Floats
    lean_deg: Floats
    tilt_deg: Floats
    height_mm: Floats
    across_mm: Floats
    spacing_mm: float
    closed: bool

    @property
    def share(self) -> Floats:
        """(n,) float   See `growth_share`."""
        return growth_share(self.lean_deg, self.tilt_deg)


def leaning_runs(
    layer: LayerRegion, middle: MultiPolygon, growth_mm: float, settings: Settings, height_at: Heights | None = None
) -> list[Run]:
    """The stretches of a layer's outline that have to be built with the head tilted, in the order of its rings.

    middle : the layer's section half-way up, grown by growth_mm for what is milled off, mm
    height_at : (n, 2) float, mm, to the layer's height there, (n,) float, mm; None: equally high.
    The lean is that between the layer's bottom and top sections.
    """
    if settings.recipe.overhang == "upright" or layer.overhang.is_empty:
        return []
    found = []
    for part in shapely.get_parts(shapely.orient_polygons(middle)):
        for ring in (part.exterior, *part.interiors):
            found += _runs_of(ring, layer, middle, growth_mm, settings, height_at)
    return found


def _runs_of(
    ring: shapely.LinearRing,
    layer: LayerRegion,
    middle: MultiPolygon,
    growth_mm: float,
    settings: Settings,
    height_at: Heights | None,
) -> list[Run]:
    runs = []
    for side, closed in _sides(ring):
        count = max(_FEWEST if closed else 3, int(np.ceil(side.length / _STEP_MM)))
        spacing = side.length / count
        points = shapely.get_coordinates(
            shapely.line_interpolate_point(side, spacing * np.arange(count if closed else count + 1))
        )
        along = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0) if closed else np.gradient(points, axis=0)
        along = along / np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]
        outward = np.column_stack([along[:, 1], -along[:, 0]])
        walls = points - growth_mm * outward
        heights = np.full(len(points), layer.height_mm) if height_at is None else np.asarray(height_at(walls))
        lean = lean_deg(walls, heights, layer)
        if not closed:
            lean = _without_ends(lean, heights, spacing)
        lean = smoothed(lean[:, None], spacing, closed)[:, 0]
        tilt = cleared_tilt(walls, outward, tilt_deg(lean, settings), layer)
        hangs = np.asarray(shapely.dwithin(shapely.points(walls), layer.overhang, _NEAR_MM))
        leans = (tilt > 0.0) & (lean < LEVEL_DEG) & hangs
        tilt = np.maximum(smoothed(tilt[:, None], spacing, closed, _TILT_SMOOTH_MM)[:, 0], MARGIN_DEG)
        for rows, whole in _stretches(leans, spacing, closed):
            across = _across(points[rows], outward[rows], middle)
            if whole and closed:  # what leans on both sides is shared between them
                ends = shapely.points(points[rows] - across[:, None] * outward[rows])
                across = np.where(shapely.distance(ends, ring) < _SAME_MM, 0.5 * across, across)
            else:
                across = _without_ends(across, across, spacing)
            runs.append(
                Run(
                    points[rows],
                    outward[rows],
                    lean[rows],
                    tilt[rows],
                    heights[rows],
                    across,
                    spacing,
                    whole and closed,
                )
            )
    return runs


def _sides(ring: shapely.LinearRing) -> list[tuple[shapely.LineString, bool]]:
    """The outline cut at its corners; itself, and True, where it has none."""
    points = shapely.get_coordinates(ring)[:-1]
    ahead = np.roll(points, -1, axis=0) - points
    points, ahead = points[(ahead**2).sum(axis=1) > 0.0], ahead[(ahead**2).sum(axis=1) > 0.0]
    behind = np.roll(ahead, 1, axis=0)
    turn = np.abs(np.arctan2(behind[:, 0] * ahead[:, 1] - behind[:, 1] * ahead[:, 0], (behind * ahead).sum(axis=1)))
    corners = np.flatnonzero(turn > _CORNER_RAD)
    if not len(corners):
        return [(shapely.LineString(ring), True)]
    sides = []
    for first, last in zip(corners, [*corners[1:], corners[0] + len(points)], strict=True):
        rows = np.arange(first, last + 1) % len(points)
        sides.append((shapely.LineString(points[rows]), False))
    return sides


def _without_ends(values: Floats, reach_mm: Floats, spacing_mm: float) -> Floats:
    """Values along a side, those within reach of its ends, where the next side is nearer, as farther in."""
    count = len(values)
    cut = min(int(np.ceil(_ENDS * float(np.median(reach_mm)) / spacing_mm)), (count - 1) // 2)
    return np.concatenate([np.full(cut, values[cut]), values[cut : count - cut], np.full(cut, values[count - cut - 1])])


def lean_deg(points: Floats, heights: Floats, layer: LayerRegion) -> Floats:
    """(n,) float   How far the wall leans outward at points of the outline half-way up, from the sections below and above.

    points : (n, 2) float, mm   heights : (n,) float, mm, of the layer. Negative where it leans inward.
    """
    low, high = (_depth(points, area) for area in (layer.areas[0], layer.areas[2]))
    return np.asarray(np.degrees(np.arctan2(high - low, heights)))


def _depth(points: Floats, area: MultiPolygon) -> Floats:
    """(n,) float, mm   How deep points lie inside a region, negative outside; nothing is far from an empty one."""
    if area.is_empty:
        return np.zeros(len(points))
    away = np.asarray(shapely.distance(shapely.points(points), area.boundary))
    shapely.prepare(area)
    return np.where(shapely.contains_xy(area, points[:, 0], points[:, 1]), away, -away)


def _stretches(chosen: Bools, spacing_mm: float, closed: bool) -> list[tuple[NDArray[np.int64], bool]]:
    """Rows of each run of chosen points along a side, and whether it is the whole side."""
    count = len(chosen)
    if not closed:
        chosen = np.append(chosen, False)
        return [(rows, len(rows) == count) for rows in _runs_round(chosen) if len(rows) * spacing_mm >= _LEAST_RUN_MM]
    fewest = max(3, int(_LEAST_RUN_MM / spacing_mm))
    bridged = chosen.copy()
    for rows in _runs_round(~chosen):
        if len(rows) < fewest and chosen.any():
            bridged[rows] = True
    if bridged.all():
        return [(np.arange(count), True)]
    return [(rows, False) for rows in _runs_round(bridged) if len(rows) >= fewest]


def _runs_round(chosen: Bools) -> list[NDArray[np.int64]]:
    """Rows of the runs of chosen points round a ring; nothing for a ring that is chosen all round."""
    count = len(chosen)
    starts = np.flatnonzero(chosen & ~np.roll(chosen, 1))
    ends = np.flatnonzero(chosen & ~np.roll(chosen, -1))
    runs = []
    for start in starts:
        length = int((ends - start).min(where=ends >= start, initial=10 * count))
        if length >= 10 * count:
            length = int(ends.min() + count - start)
        runs.append((start + np.arange(length + 1)) % count)
    return runs


def _across(points: Floats, outward: Floats, middle: MultiPolygon) -> Floats:
    """(n,) float, mm   Way through the region from points of its outline, inward across it."""
    rays = np.stack([points - 1e-3 * outward, points - _ACROSS_MM * outward], axis=1)
    inside = shapely.intersection(shapely.linestrings(rays), middle)
    ways = np.full(len(points), 0.0)
    for k, shape in enumerate(inside):
        for piece in shapely.get_parts(shape):
            ends = shapely.get_coordinates(piece)
            far = np.linalg.norm(ends - rays[k, 0], axis=1)
            if len(far) and far.min() < _SAME_MM:
                ways[k] = float(far.max())
    return ways
