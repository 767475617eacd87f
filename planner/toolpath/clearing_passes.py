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
from planner.toolpath.motion import Motion, joined, process_pass, straight

Floats = NDArray[np.float64]

_TERRACE = 0.8  # of the tolerance: how far steps between levels may stand out of the part's surface
_FINISH_MM = 0.3  # what roughing leaves on the part
_ENTRY_MM = 1.0  # air before the metal where a stretch begins
_HALVINGS = 5  # of a level's step: to a tenth of a millimetre
_SAME_MM2 = 0.01
_TOUCHES_MM = 0.1  # surfaces of the part this near to the metal are finished here
_CHORD_MM = 5e-3
_SPACING_MM = 0.5  # of points by which it is told where an outline comes into reach: half of the air before the metal
_STRAIGHT_MM = 1e-4
_GRID_MM = 1e-4


def level_passes(access: Access, excess_mm: float) -> tuple[list[Pass], Floats, list[MultiPolygon]]:
    """The passes from the top down, the heights of the levels, and what of the metal stays between them.

    excess_mm : how far metal stands out of its nominal faces.
    The last ring of each level runs along what stays; where the part's surface steps out under the tool the levels follow
    it, so that terraces stand out by four fifths of the tolerance at most.
    """
    levels = part_levels(access, excess_mm)
    above = MultiPolygon()
    passes: list[Pass] = []
    kept: list[MultiPolygon] = []
    for high, low in pairwise(levels.tolist()):
        bare = access.section(0.5 * (high + low))
        keep = access.keep(low, above)
        metal = outset(bare, excess_mm, _CHORD_MM)
        missed = access.missed(bare, keep)
        if not missed.is_empty:
            above = polygons(shapely.union(above, missed, grid_size=_GRID_MM))
        passes += _level(metal, keep, low, access.settings)
        kept.append(missed)
    return passes, levels, kept


def part_levels(access: Access, excess_mm: float) -> Floats:
    """(n+1,) float, mm   Heights to which the cutter goes, from above the metal down past its bottom."""
    depth = access.settings.material.milling.axial_depth_mm
    allowed = _TERRACE * access.settings.recipe.tolerance_mm
    low, at = access.low_mm - excess_mm, access.high_mm + excess_mm
    levels = [at]
    while at - low > 1e-6:
        step = min(depth, at - low)
        start = shapely.buffer(access.part_shadow(at - min(allowed, step)), allowed)
        near = outset(_touched(access, at, step), _TOUCHES_MM, 0.05)
        if _grows(access, at - step, start, near):
            least, most = min(allowed, step), step
            for _ in range(_HALVINGS):
                middle = 0.5 * (least + most)
                least, most = (least, middle) if _grows(access, at - middle, start, near) else (middle, most)
            step = least
        at -= step
        levels.append(at)
    return np.array(levels)


def _touched(access: Access, high: float, step_mm: float) -> MultiPolygon:
    """Where there is metal at the heights of a level, mm."""
    heights = high - np.array([0.02, 0.5, 0.98]) * step_mm
    inside = heights[(heights > access.low_mm) & (heights < access.high_mm)]
    return polygons(shapely.union_all([access.section(float(z)) for z in inside]))


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
    return _chained(motions, metal, near, settings)


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
