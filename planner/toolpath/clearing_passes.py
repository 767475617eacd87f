"""Passes that clear metal from one direction: levels that step with the part's own surface, rings round what stays."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.decompose.solids import polygons
from planner.nurbs.offset import inset, outset
from planner.plan import Pass
from planner.process import Settings
from planner.toolpath.access import Access
from planner.toolpath.engagement import eased, engagement_limit_rad
from planner.toolpath.motion import Motion, joined, process_pass, straight

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_TERRACE = 0.8  # of the tolerance: how far steps between levels may stand out of the part's surface
_FINISH_MM = 0.3  # what roughing leaves on the part
_ENTRY_MM = 1.0  # air before the metal where a stretch begins
_MOST_TERRACES = 24  # in a clearing: on surfaces that would ask for more they stand out farther
_PLATE_MM = 0.8  # steps that may stay on the plate
_SAME_MM2 = 0.01
_TOUCHES_MM = 0.1  # surfaces of the part this near to the metal are finished here
_CHORD_MM = 0.02
_SPACING_MM = 0.5  # of points by which it is told where an outline comes into reach: half of the air before the metal
_STRAIGHT_MM = 1e-4
_GRID_MM = 1e-4


def level_passes(access: Access, goal: Flags, stays: Flags, excess_mm: float) -> tuple[list[Pass], Flags]:
    """The passes from the top down, and which cells of the metal they remove.

    goal : (n,) bool, cells that are to go   stays : (n,) bool, cells of metal that are kept clear of like the plate
    excess_mm : how far metal stands out of its nominal faces.
    Films thinner than a cell keep the cutter off nothing: its flank takes them along. The last ring of each level runs
    along what stays; where the part's surface steps out under the tool, terraces between the levels follow it. They stand
    out by four fifths of the tolerance, or by more where that would take too many of them.
    """
    half = 0.5 * access.metal.pitch_mm
    heights = access.at[:, 2]
    levels = _levels(access, heights[goal].min() - half - excess_mm, heights[goal].max() + half + excess_mm)
    most = max(2, _MOST_TERRACES // (len(levels) - 1))
    gone = np.zeros(len(goal), dtype=np.bool_)
    missed = np.zeros(len(goal), dtype=np.bool_)
    passes: list[Pass] = []
    for high, low in pairwise(levels.tolist()):
        above = inset(access.covered((stays & (heights > high)) | missed), access.metal.pitch_mm, 0.05)
        keep = access.keep(low, above)
        near = goal & (heights <= high + excess_mm) & (heights > low - excess_mm)
        bare = _bare(access, near, low - excess_mm, high + excess_mm)
        passes += _level(outset(bare, excess_mm, _CHORD_MM), keep, low, access.settings)
        at = [low]
        steps = polygons(shapely.difference(outset(bare, _TOUCHES_MM, 0.05), above))
        for z in _terraces(access, high, low, steps, most):
            nearer = access.keep(z, above)
            block = polygons(shapely.intersection(shapely.difference(keep, nearer), steps))
            passes += _level(block, nearer, z, access.settings)
            at.append(z)
        _sweep(access, goal, gone, sorted(at), above)
        missed |= goal & (heights <= high) & (heights > low) & ~gone
    return passes, gone


def _sweep(access: Access, goal: Flags, gone: Flags, at: list[float], above: MultiPolygon) -> None:
    """Marks as gone what the cutter goes over with its end at some heights, lowest first, mm: its flank takes films along."""
    heights = access.at[:, 2]
    for z in at:
        rows = np.flatnonzero(goal & ~gone & (heights > z))
        if len(rows):
            gone[rows[access.swept(rows, access.keep(z, above))]] = True


def _levels(access: Access, low: float, high: float) -> Floats:
    """(n+1,) float, mm   Heights to which the cutter goes, from above the metal down past its bottom, evenly."""
    depth = access.settings.material.milling.axial_depth_mm
    rise = float(access.direction[2])
    if 1e-6 < rise < 1.0 - 1e-6:
        depth = min(depth, _PLATE_MM * np.sqrt(1.0 - rise**2) / rise)
    return np.linspace(high, low, max(1, int(np.ceil((high - low) / depth - 1e-9))) + 1)


def _bare(access: Access, chosen: Flags, low: float, high: float) -> MultiPolygon:
    """What some cells cover, with the outline of the metal itself between two heights, mm."""
    if not chosen.any():
        return MultiPolygon()
    cells = outset(access.covered(chosen), access.metal.pitch_mm, 0.05)
    return polygons(shapely.intersection(access.between(low, high), cells, grid_size=_GRID_MM))


def _terraces(access: Access, high: float, low: float, near: MultiPolygon, most: int) -> list[float]:
    """Heights between two levels, from the top down, at which the part's surface has stepped out by what is allowed, mm.

    most : of them; if there would be more, more is allowed.
    """
    allowed = _TERRACE * access.settings.recipe.tolerance_mm
    if near.is_empty or not _grows(access, low, shapely.buffer(access.part_shadow(high), allowed), near):
        return []
    out = shapely.intersection(shapely.difference(access.part_shadow(low), access.part_shadow(high)), near)
    widest = _width(out)
    allowed = max(allowed, widest / most)
    found: list[float] = []
    at, step = high, high - low
    while at - low > 1e-3 and len(found) < 2 * most:
        start = shapely.buffer(access.part_shadow(at), allowed)
        step = min(1.6 * step, at - low)
        while step > 0.02 and _grows(access, at - step, start, near):
            step *= 0.6
        at -= step
        if at - low > 1e-3:
            found.append(at)
    return found


def _width(region: shapely.Geometry) -> float:
    """How far a region reaches at most across itself, mm: twice the radius of the largest circle in it."""
    if region.is_empty:
        return 0.0
    return max(2.0 * float(shapely.maximum_inscribed_circle(piece, 0.05).length) for piece in polygons(region).geoms)


def _grows(access: Access, z: float, start: shapely.Geometry, near: MultiPolygon) -> bool:
    """Whether what stands above a height reaches beyond where it began, near the metal."""
    beyond = shapely.difference(shapely.intersection(access.part_shadow(z), near), start)
    return bool(beyond.area > _SAME_MM2)


def _level(metal: MultiPolygon, keep: MultiPolygon, z: float, settings: Settings) -> list[Pass]:
    """The passes of one level, outside in; stretches between which the way is free are one pass."""
    if metal.is_empty or shapely.difference(metal, keep).area < _SAME_MM2:
        return []
    radius = settings.cutter_radius_mm
    reach = outset(metal, radius + _ENTRY_MM, _CHORD_MM)
    near = polygons(shapely.intersection(keep, outset(reach, 2.0 * radius, 0.05), grid_size=_GRID_MM))
    motions = [
        straight(np.column_stack([path, np.full(len(path), z)]))
        for ring in _rings(metal, near, settings)
        for path in _stretches(ring, reach)
    ]
    limit = engagement_limit_rad(settings.material.milling.radial_depth_mm, radius)
    waste = polygons(shapely.difference(metal, keep))
    return eased(_chained(motions, metal, keep, settings), waste, radius, limit)


def _stretches(ring: MultiPolygon, reach: MultiPolygon) -> list[Floats]:
    """(n, 2) float, mm, each   What of a region's outline lies in reach, the region on its right (climb milling)."""
    shapely.prepare(reach)
    found: list[Floats] = []
    for piece in ring.geoms:
        turned = shapely.geometry.polygon.orient(piece, -1.0)
        for outline in (turned.exterior, *turned.interiors):
            points = shapely.get_coordinates(shapely.segmentize(outline, _SPACING_MM))
            inside = shapely.contains_xy(reach, points[:, 0], points[:, 1])
            if not inside.all() and inside.any():
                first = int(np.flatnonzero(~inside)[0])
                points = np.vstack([points[first:-1], points[: first + 1]])
                inside = np.concatenate([inside[first:-1], inside[: first + 1]])
            ends = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(np.int8), [0]])))
            for start, end in zip(ends[::2].tolist(), ends[1::2].tolist(), strict=True):
                if end - start >= 2:
                    line = shapely.LineString(points[start:end]).simplify(_STRAIGHT_MM)
                    found.append(shapely.get_coordinates(line))
    return found


def _rings(metal: MultiPolygon, keep: MultiPolygon, settings: Settings) -> list[MultiPolygon]:
    """Regions whose outlines the cutter's centre follows, outermost first; the last one touches what is kept."""
    radius, step = settings.cutter_radius_mm, settings.material.milling.radial_depth_mm
    rings: list[MultiPolygon] = []
    if keep.is_empty:
        grown = radius - step
        while not (
            ring := outset(metal, grown, _CHORD_MM) if grown > 0.0 else inset(metal, -grown, _CHORD_MM)
        ).is_empty:
            rings.append(ring)
            grown -= step
        return rings
    reach = outset(metal, radius, _CHORD_MM)
    leave = 0.0
    while shapely.difference(reach, ring := outset(keep, radius + leave, _CHORD_MM)).area > _SAME_MM2:
        rings.append(ring)
        leave = leave + step if leave else _FINISH_MM
    return rings[::-1]


def _chained(motions: list[Motion], metal: MultiPolygon, keep: MultiPolygon, settings: Settings) -> list[Pass]:
    """Passes of motions in order; one goes on into the next where the straight way cuts neither metal nor what is kept."""
    row = [0.0, settings.mill_feed_mm_s, 0.0, 0.0, 0.0]
    left: shapely.Geometry = metal
    passes: list[Pass] = []
    chain: list[Motion] = []
    for motion in motions:
        start = motion.ends()[0]
        if chain and _is_free(chain[-1].ends()[2], start, left, keep, settings):
            if np.linalg.norm(start - chain[-1].ends()[2]) > 1e-6:
                chain.append(straight([chain[-1].ends()[2], start]))
        elif chain:
            passes.append(process_pass(joined(chain), row))
            chain = []
        chain.append(motion)
        path = shapely.LineString(motion.tip.control_points[:, :2]).simplify(0.05)
        left = shapely.difference(left, shapely.buffer(path, settings.cutter_radius_mm - 0.05, quad_segs=6))
    if chain:
        passes.append(process_pass(joined(chain), row))
    return passes


def _is_free(here: Floats, there: Floats, left: shapely.Geometry, keep: MultiPolygon, settings: Settings) -> bool:
    """Whether a cutter that goes straight from one point to another keeps off, and meets less metal than a pass takes."""
    way = shapely.buffer(shapely.LineString([here[:2], there[:2]]), settings.cutter_radius_mm - 0.01, quad_segs=6)
    if shapely.intersects(way, keep):
        return False
    met = float(shapely.intersection(way, left).area)
    return met <= settings.material.milling.radial_depth_mm * settings.cutter_radius_mm
