"""Facing: the cutter's end brings a layer's top to its plane, entering from outside."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from planner.nurbs.offset import inset, outset
from planner.nurbs.rings import curves_from_region
from planner.plan import Pass
from planner.process import Settings
from planner.toolpath.beside import polygons
from planner.toolpath.contour import PATH_TOLERANCE_MM
from planner.toolpath.motion import Motion, joined, lifted, process_pass, straight
from planner.toolpath.side import stretches_within

Floats = NDArray[np.float64]

_FIRST_RINGS = (0.25, 0.125, 0.0)  # of the diameter: how far inside the outline the first ring's centre runs
_WIDEST_STEP = 0.48  # of the diameter: rings farther apart leave a ridge where the region narrows
_ENTRY_MM = 1.0  # air between cutter and metal where it comes down beside the part
_NOWHERE = MultiPolygon()
_LEFT_MM2 = 1e-3  # metal that may be left uncovered: rounding of the offsets


def widest_step_mm(settings: Settings) -> float:
    """Between neighbouring rings of facing: the material's, and no more than leaves no ridge."""
    return min(settings.material.milling.face_step_over, _WIDEST_STEP) * settings.cutter_diameter_mm


def face_rings(metal: MultiPolygon, settings: Settings) -> list[MultiPolygon]:
    """Regions whose outlines the cutter's centre follows so that all metal is swept, outermost first.

    metal : what stands, bulge of the beads included, mm.
    """
    diameter = settings.cutter_diameter_mm
    step = widest_step_mm(settings)
    rings: list[MultiPolygon] = []
    for share in _FIRST_RINGS:
        rings, depth = [], share * diameter
        while not (ring := inset(metal, depth, 0.01)).is_empty:
            rings.append(ring)
            depth += step
        if not rings:
            continue
        swept = shapely.union_all([ring.boundary.buffer(0.5 * diameter, quad_segs=32) for ring in rings])
        if shapely.difference(metal, swept).area <= _LEFT_MM2 + 1e-4 * metal.area:
            break
    return rings


def face_passes(
    metal: MultiPolygon, z: float, settings: Settings, blocked: MultiPolygon = _NOWHERE
) -> list[Pass]:
    """One pass per separate piece of metal: down beside it, in from outside, ring by ring at the plane z.

    blocked : where the cutter's centre must not go; beside it, rings are cut to the stretches outside it, one pass each.
    All of it lies in the plane, above which nothing of the finished part stands, so ways between rings are cut too.
    """
    row = [0.0, settings.mill_feed_mm_s, 0.0, 0.0, 0.0]
    passes = []
    for piece in sorted(metal.geoms, key=lambda p: (p.bounds[1], p.bounds[0])):
        rings = [
            ring.curve
            for region in face_rings(MultiPolygon([piece]), settings)
            for ring in curves_from_region(region, PATH_TOLERANCE_MM)
        ]
        if not rings:
            continue
        near = shapely.buffer(piece.envelope, settings.cutter_diameter_mm + 2.0 * _ENTRY_MM)
        if not blocked.is_empty and shapely.intersects(blocked, near):
            loops = [lifted(curve.reversed(), z) for curve in rings]
            free = polygons(shapely.difference(near, blocked))
            passes += [process_pass(part, row) for loop in loops for part in stretches_within(loop, free)]
            continue
        at = entry_point(piece, rings[0].evaluate([0.0])[0], settings.cutter_radius_mm + _ENTRY_MM)
        motions: list[Motion] = []
        left = [lifted(curve.reversed(), z) for curve in rings]
        here = np.array([*at, z])
        while left:
            starts = np.array([motion.ends()[0] for motion in left])
            chosen = 0 if not motions else int(np.argmin(np.linalg.norm(starts - here, axis=1)))
            loop = _begun_nearest(left.pop(chosen), here)
            start = loop.ends()[0]
            if np.linalg.norm(start - here) > 1e-3:
                motions.append(straight([here, start]))
            elif motions:
                start = here
            motions.append(loop)
            here = loop.ends()[2]
        passes.append(process_pass(joined(motions), row))
    return passes


def _begun_nearest(loop: Motion, here: Floats) -> Motion:
    """A closed motion begun near a point, to a hundredth of its length."""
    arcs = np.linspace(0.0, loop.length, 100, endpoint=False)
    points = loop.tip.evaluate(loop.tip.at_arc_length(arcs))
    return loop.started_at(float(arcs[int(np.argmin(np.linalg.norm(points - here, axis=1)))]))


def entry_point(piece: Polygon, inner: Floats, away_mm: float) -> Floats:
    """(2,) float, mm   The point nearest to `inner` that keeps away_mm from the outside of a piece of metal."""
    outline = outset(MultiPolygon([Polygon(piece.exterior)]), away_mm, 0.01).geoms[0].exterior
    nearest = outline.interpolate(outline.project(shapely.Point(inner[:2])))
    return np.array([nearest.x, nearest.y])
