"""Undersides: level passes at constant distances from the outline of what carries a layer, each carried by the one before."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from planner.nurbs.offset import outset
from planner.plan import Pass
from planner.process import Bead, Settings
from planner.slicing.regions import LayerRegion
from planner.toolpath.clearance import cleared_tilt
from planner.toolpath.contour import closed_bead, open_bead
from planner.toolpath.fitting import Stretch, fitted_bead
from planner.toolpath.tilt import TURN_DEG_S, axes_of, smoothed, spread_rows, tilted_motion

Floats = NDArray[np.float64]

_ADVANCE = 0.38  # of the bead's width: how far a pass reaches beyond the one before; what it hangs out by holds
_TIP_UP = 0.25  # of the layer's height above its bottom plane: the focus meets the side of the pass before
_LEAST_WIDE_MM = 0.2  # beyond what holds by itself: narrower undersides are the rounding of sections
_STEP_MM = 0.5  # between points of a pass
_LEAST_LINE_MM = 1.5  # shorter passes are drops
_ASIDE_MM = 0.1  # to either side of a pass, to see which is farther from what carries it
_POINT_NEAR_MM = 1e-3  # ends of passes lie on the outline


def ledge_passes(
    layer: LayerRegion, taken: Sequence[shapely.Geometry], bead: Bead, settings: Settings
) -> tuple[list[Pass], MultiPolygon]:
    """Passes that build a layer's undersides out from what carries them, and where.

    taken : what the beads along leaning walls stand for, mm. Where an outline bends too sharply for the tool axis to
    follow, straight passes go across from one side to the other.
    """
    hangs = shapely.difference(layer.overhang, shapely.union_all(list(taken))) if taken else layer.overhang
    passes: list[Pass] = []
    covered = []
    if settings.recipe.overhang == "upright" or layer.overlap.is_empty:
        return [], MultiPolygon()
    narrow = fitted_bead(bead, 0.1 * bead.width_mm, 0.0, settings)
    holds = layer.height_mm * np.tan(np.radians(settings.material.deposition.max_overhang_deg))
    for part in shapely.get_parts(hangs):
        if part.geom_type != "Polygon" or shapely.buffer(part, -0.5 * (holds + _LEAST_WIDE_MM)).is_empty:
            continue
        carried = shapely.intersection(shapely.buffer(part, 0.01), layer.overlap.boundary)
        if carried.is_empty:
            continue
        advance = min(_ADVANCE * narrow.width_mm, settings.material.deposition.max_unsupported_mm)
        made = _passes_over(part, carried, advance, narrow, layer, settings)
        if made:
            passes += made
            covered.append(part)
    return passes, _polygons(shapely.union_all(covered)) if covered else MultiPolygon()


def _passes_over(
    part: Polygon, carried: shapely.Geometry, advance: float, bead: Bead, layer: LayerRegion, settings: Settings
) -> list[Pass]:
    """The passes over one underside, from what carries it outward."""
    reach = float(shapely.hausdorff_distance(part.boundary, carried))
    radius = float(np.sqrt(part.area / np.pi))
    tightest = settings.material.deposition.speed_mm_s.min / np.radians(TURN_DEG_S)
    is_hole = carried.length > 0.8 * part.length
    if is_hole and radius < 2.0 * tightest + advance:
        return _across(part, advance, bead, layer, settings)
    count = max(1, int(np.ceil(reach / advance)))
    step = reach / count
    passes = []
    for number in range(count):
        line = _edge(part, layer.overlap, number * step)
        for piece in line:
            made = _outward_pass(piece, layer.index + number, step, bead, layer, settings)
            if made is not None:
                passes.append(made)
    return passes


def _edge(part: Polygon, overlap: MultiPolygon, distance_mm: float) -> list[shapely.Geometry]:
    """The outline of what carries the layer, moved out by a distance, as far as it runs over the underside."""
    moved = outset(overlap, distance_mm) if distance_mm > 0.0 else overlap
    lines = shapely.intersection(moved.boundary, shapely.buffer(part, _POINT_NEAR_MM))
    merged = shapely.line_merge(lines) if lines.geom_type == "MultiLineString" else lines
    return [piece for piece in shapely.get_parts(merged) if piece.length >= _LEAST_LINE_MM]


def _outward_pass(
    line: shapely.Geometry, number: int, step_mm: float, bead: Bead, layer: LayerRegion, settings: Settings
) -> Pass | None:
    """One tilted pass along an edge, the head leaning the way in which the layer grows.  number : spreads the starts"""
    closed = bool(line.is_ring)
    count = max(4, int(np.ceil(line.length / _STEP_MM)))
    spacing = line.length / (count if closed else count - 1)
    points = shapely.get_coordinates(shapely.line_interpolate_point(line, spacing * np.arange(count)))
    along = (np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)) if closed else np.gradient(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    outward = np.column_stack([along[:, 1], -along[:, 0]])
    carrier = layer.overlap
    ahead, behind = (
        shapely.distance(shapely.points(points + way * outward), carrier) for way in (_ASIDE_MM, -_ASIDE_MM)
    )
    outward = outward if float((ahead - behind).sum()) > 0.0 else -outward
    outward = smoothed(outward, spacing, closed)
    outward /= np.maximum(np.linalg.norm(outward, axis=1), 1e-9)[:, None]
    tilt = cleared_tilt(points, outward, np.full(count, settings.material.deposition.max_tilt_deg), layer)
    axes = axes_of(outward, smoothed(tilt[:, None], spacing, closed)[:, 0])
    tips = np.column_stack([points, np.full(count, layer.z_bottom + _TIP_UP * layer.height_mm)])
    rows = spread_rows(tips, number, closed)
    motion = tilted_motion(tips[rows], axes[rows], closed)
    made = _ledge_bead(step_mm, bead, layer, settings)
    return (closed_bead if closed else open_bead)(motion, made, settings, [Stretch(0.0, made)])


def _across(part: Polygon, advance: float, bead: Bead, layer: LayerRegion, settings: Settings) -> list[Pass]:
    """Straight passes over a small hole, from one side to the other, the head leaning the way in which they follow."""
    low, high = part.bounds[0], part.bounds[2]
    count = max(1, int(np.ceil((high - low) / advance)))
    step = (high - low) / count
    z = layer.z_bottom + _TIP_UP * layer.height_mm
    made = _ledge_bead(step, bead, layer, settings)
    passes = []
    for number in range(count):
        x = low + (number + 0.25) * step
        chord = shapely.intersection(shapely.LineString([(x, part.bounds[1] - 1.0), (x, part.bounds[3] + 1.0)]), part)
        for piece in shapely.get_parts(chord):
            ends = shapely.get_coordinates(piece)
            ends = ends if number % 2 == 0 else ends[::-1]
            if len(ends) < 2 or float(np.linalg.norm(ends[-1] - ends[0])) < 0.2:
                continue
            along_x = np.array([[1.0, 0.0], [1.0, 0.0]])
            tilt = cleared_tilt(ends[[0, -1]], along_x, np.full(2, settings.material.deposition.max_tilt_deg), layer)
            axes = axes_of(along_x, np.full(2, tilt.min()))
            tips = np.column_stack([ends[[0, -1]], np.full(2, z)])
            passes.append(open_bead(tilted_motion(tips, axes, False), made, settings, [Stretch(0.0, made)]))
    return passes


def _ledge_bead(step_mm: float, bead: Bead, layer: LayerRegion, settings: Settings) -> Bead:
    """The narrow bead that brings the metal of one step of a layer."""
    return settings.with_area(bead, step_mm * layer.height_mm * (1.0 + settings.overbuild))


def _polygons(shape: shapely.Geometry) -> MultiPolygon:
    return MultiPolygon([part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"])
