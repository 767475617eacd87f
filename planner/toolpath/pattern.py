"""The pattern in which a region is filled: raster, contour-parallel or spiral, as asked or as its shape wants it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely
from shapely import MultiPolygon, Polygon

from planner.nurbs.offset import inset
from planner.plan import Pass
from planner.process import Bead, Settings
from planner.toolpath.balance import balance_of, lit_beads, lit_mm, metal_mm3
from planner.toolpath.contour import contour_passes, edge_mm
from planner.toolpath.fill import fillable, infill_region, raster_passes
from planner.toolpath.fitting import scaled_bead
from planner.toolpath.relief import Relief
from planner.toolpath.rings import ring_strips, strip_passes
from planner.toolpath.spiral import spiral_passes

_EVEN = 0.7  # of the widest place: a strip whose mean width is more is one of even width
_MOST_ACROSS = 1.6  # steps inside the contours: wider regions are hatched, whose turning lines fill the valleys below
_FEWER = 0.5  # of the tracks: beads beside the outline are chosen where they are at least so few
_MOST_MORE = 1.4  # of a bead's metal: larger ones would be other beads
TOP_DENSER = 1.25
"""Times as many beads under a finished face: its edge and the valleys between beads are full above the plane that is milled, as no
next layer fills them. By proofs of a ring and a table: without, metal is missing at the edge; with beads that cross, no less is."""
_RATHER_MORE = 1.01  # times the metal of the fill
_MOST_OFF = 1.018  # times the metal of the whole: a layer's balance may be off by 2 %
_LEAST_FILL = 0.75  # times the metal of the fill: with less there would be grooves
_VOID = 0.1  # of the bead's width: the widest gap between beads


def part_passes(
    part: Polygon, z: float, layer: int, bead: Bead, settings: Settings, is_top: bool = False, relief: Relief | None = None
) -> tuple[list[Pass], list[Pass]]:
    """Contours and fill of one polygon of a layer, together with the metal that it takes.

    part : region to fill, allowance and edge strip included, mm   z : of the surface that receives it
    is_top : has a finished face: all its beads lie closer, so that there is more metal everywhere and no bead upon a bead
    relief : of a layer that is not equally high everywhere.
    """
    asked = settings.pattern_of(part, z)
    if is_top:
        bead = replace(bead, step_mm=bead.step_mm / TOP_DENSER)
    if asked in ("auto", "spiral"):
        passes = spiral_passes(part, z, layer, bead, settings, relief)
        if passes:
            return passes, []
    alone = MultiPolygon([part])
    usual = fillable(infill_region(alone, bead, settings), bead)
    if not settings.is_milled and asked in ("auto", "raster"):
        return _alike(part, z, layer, bead, settings, is_top, relief)
    rings = _contours(alone, usual, z, layer, bead, settings, relief)
    rather = _rather(alone, usual, rings, bead, settings) if settings.is_milled and relief is None else 1.0
    if asked in ("contour", "spiral") or (asked == "auto" and not is_top and _is_strip(usual, bead)):
        fill = ring_passes(usual, z, layer, bead, settings, relief, rather)
        if asked != "auto":
            return rings, fill
        tracks = raster_passes(usual, z, layer, bead, settings, relief, rather)
        if len(fill) <= _FEWER * len(tracks) and _void_beads(alone, [*rings, *fill], bead, settings) <= _VOID:
            return rings, fill
    region = fillable(infill_region(alone, bead, settings, is_top), bead) if is_top else usual
    return rings, raster_passes(region, z, layer, bead, settings, relief, 1.0 if is_top else rather, 1.0 if is_top else 0.0)


def _alike(
    part: Polygon, z: float, layer: int, bead: Bead, settings: Settings, is_top: bool, relief: Relief | None
) -> tuple[list[Pass], list[Pass]]:
    """Contours and hatch of a part that is only deposited, all of one bead, which brings the metal that the polygon takes."""
    alone = MultiPolygon([part])
    region = fillable(infill_region(alone, bead, settings, is_top), bead)
    rings, tracks = _of_one_bead(alone, region, z, layer, bead, settings, relief)
    lit = lit_mm([*rings, *tracks])
    made = scaled_bead(bead, min(part.area / (bead.step_mm * lit), _MOST_MORE), settings) if lit else bead
    return (rings, tracks) if made == bead else _of_one_bead(alone, region, z, layer, made, settings, relief)


def _of_one_bead(
    alone: MultiPolygon, region: MultiPolygon, z: float, layer: int, bead: Bead, settings: Settings, relief: Relief | None
) -> tuple[list[Pass], list[Pass]]:
    rings = contour_passes(alone, z, layer, bead, settings, relief)
    return rings, raster_passes(region, z, layer, bead, settings, relief, evens=False)


def ring_passes(
    region: MultiPolygon,
    z: float,
    layer: int,
    bead: Bead,
    settings: Settings,
    relief: Relief | None = None,
    rather: float = 1.0,
) -> list[Pass]:
    """Contour-parallel beads with so many times the metal that a region takes; short lines where neither ring nor middle has room."""
    passes: list[Pass] = []
    for polygon in region.geoms:
        strips, over = ring_strips(polygon, z, bead.step_mm)
        lines = raster_passes(over, z, layer, bead, settings, relief, rather) if not over.is_empty else []
        passes += strip_passes(strips, rather * (polygon.area - (over.area if lines else 0.0)), layer, bead, settings, relief)
        passes += lines
    return passes


def _contours(
    alone: MultiPolygon, fill: MultiPolygon, z: float, layer: int, bead: Bead, settings: Settings, relief: Relief | None
) -> list[Pass]:
    """The contours of a polygon, with the metal of all that is not filled inside them."""
    edge = edge_mm(bead, settings)
    full = inset(alone, edge).area if edge > 0.0 else alone.area
    return contour_passes(alone, z, layer, bead, settings, relief, full - fill.area)


def _rather(alone: MultiPolygon, fill: MultiPolygon, rings: list[Pass], bead: Bead, settings: Settings) -> float:
    """Times the metal that the fill of a milled part brings: rather more, as a cutter takes off what is too much, but with what
    the contours bring, overlap at their starts included, within what a layer's balance may be off."""
    if fill.is_empty:
        return 1.0
    edge = edge_mm(bead, settings)
    full = inset(alone, edge).area if edge > 0.0 else alone.area
    left = _MOST_OFF * full - metal_mm3(rings, settings) / bead.height_mm
    return float(max(min(_RATHER_MORE, left / fill.area), _LEAST_FILL))


def _is_strip(region: MultiPolygon, bead: Bead) -> bool:
    """Whether all polygons are strips of even width, a few beads wide."""
    for polygon in region.geoms:
        across = 2.0 * float(shapely.maximum_inscribed_circle(polygon).length)
        if across > _MOST_ACROSS * bead.step_mm or 2.0 * polygon.area / polygon.length < _EVEN * across:
            return False
    return bool(region.geoms)


def _void_beads(alone: MultiPolygon, passes: list[Pass], bead: Bead, settings: Settings) -> float:
    """The widest gap that passes leave in a region, in widths of the bead."""
    edge = edge_mm(bead, settings)
    full = inset(alone, edge) if edge > 0.0 else alone
    return balance_of(full, lit_beads(passes, settings), bead.height_mm, settings).void_beads if not full.is_empty else np.inf
