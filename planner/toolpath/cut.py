"""The milling of tops and walls as operations, and what the cutter leaves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely import MultiPolygon

from planner.mesh.mesh import Mesh
from planner.nurbs.offset import outset
from planner.plan import Operation, Pass, Process, Wall
from planner.process import Settings
from planner.slicing.regions import LayerRegion, united
from planner.toolpath.axis import ends_clear, goes_on_below, leans_inward, ruled_motions, steepest_lean
from planner.toolpath.ball import Milled
from planner.toolpath.ball_band import ball_milled, fillets, steps_of_missed
from planner.toolpath.bands import Band
from planner.toolpath.beside import Stands, blocked_mm, blocked_near, passes_beside, polygons
from planner.toolpath.engagement import eased, eased_round, engagement_limit_rad
from planner.toolpath.face import face_passes, widest_step_mm
from planner.toolpath.flank import flank_left
from planner.toolpath.holder import stickout_mm
from planner.toolpath.left import Left, left_by_cutter, left_findings
from planner.toolpath.motion import Motion, axis_at
from planner.toolpath.side import (
    PAST_START_MM,
    begun_on_flat,
    places,
    side_pass,
    stretch_passes,
    swept_by,
    unreached,
    upright_passes,
)

__all__ = ["BULGE", "OVERLAP_MM", "Left", "face_operation", "faced", "left_findings", "side_operations"]

BULGE = 0.04  # of the bead's width: how far melt may run out beyond a track's nominal edge
OVERLAP_MM = 0.1  # by which a band reaches under its bottom where the same wall goes on there
_SAME_MM = 1e-6  # levels nearer than this are one
_CRUMB_MM2 = 0.5  # of a top: smaller places are rims of beads
_CLEAR_MM = 0.02  # how far the cutter's end may reach into what stands: rounding of offsets
_ALONG_HOLDER_MM = (0.0, 20.0, 40.0)
"""Places along a holder at which a leaning one is asked for."""
_BESIDE_MM = 0.01  # the same on stretches that are chosen to lie beside it


def face_operation(
    metal: MultiPolygon,
    layer: LayerRegion,
    above_mm: float,
    settings: Settings,
    note: str = "",
    *,
    stands: Stands | None = None,
) -> Operation | None:
    """Facing of a layer's top, in depths of at most the axial depth; None where there is nothing to face.

    metal : what stands there, bulge included, mm   above_mm : height of the metal over the plane   stands : what else does.
    """
    depth = settings.material.milling.axial_depth_mm
    cuts = max(1, -int(-(above_mm - 1e-9) // depth))
    radius, passes = settings.cutter_radius_mm, list[Pass]()
    limit = engagement_limit_rad(widest_step_mm(settings), radius)
    for cut in range(cuts):
        z = layer.z_top + (cuts - cut - 1) * above_mm / cuts
        blocked = stands(z, settings) if stands is not None else MultiPolygon()
        passes.extend(eased(face_passes(metal, z, settings, blocked), metal, radius, limit))
    return _milled(Process.MILL_FACE, layer.index, passes, settings, note) if passes else None


def faced(
    metal: MultiPolygon,
    layer: LayerRegion,
    above_mm: float,
    settings: Settings,
    stands: Stands | None,
    left: list[Left],
) -> list[Operation]:
    """Facing of a layer's top; what stands keeps the cutter from is left to the small one, what it does not reach is told.

    left : gets what neither reaches.
    """
    first = face_operation(metal, layer, above_mm, settings, stands=stands)
    done = [] if first is None else [first]
    if stands is None or stands(layer.z_top, settings).is_empty:
        return done
    rest = _unfaced(metal, first, settings)
    small = settings.with_small_cutter()
    if small is not None and rest.area > _CRUMB_MM2:
        second = face_operation(rest, layer, above_mm, small, "rest", stands=stands)
        done += [] if second is None else [second]
        rest = _unfaced(rest, second, small)
    if rest.area > _CRUMB_MM2:
        left.append(Left("unfaced", layer.z_bottom, layer.z_top, places(rest), 0, float(rest.area)))
    return done


def _unfaced(metal: MultiPolygon, operation: Operation | None, settings: Settings) -> MultiPolygon:
    """What of a region the cutter's end does not cover."""
    if operation is None:
        return metal
    return polygons(shapely.difference(metal, swept_by(list(operation.passes), settings.cutter_radius_mm)))


def side_operations(
    band: Band,
    below: Sequence[LayerRegion],
    excess_mm: float,
    run_down_mm: float,
    settings: Settings,
    *,
    stands: Stands | None = None,
    others: Sequence[Mesh] = (),
) -> tuple[list[Operation], list[Left]]:
    """Milling of a band's walls, with the small cutter after the other where the recipe names one, and what they leave.

    below : the finished layers under the band, from the lowest   excess_mm : metal outside the walls
    run_down_mm : how far its metal may have run down on a wall that leans inward   stands : what must not be cut beside it
    others : the same as bodies, mm, in the band's frame.
    """
    small = settings.with_small_cutter()
    note: str = band.kind
    passes = _ruled_passes(band, below, excess_mm, run_down_mm, settings, stands) if band.kind == "ruled" else []
    if stands is not None and _meets(passes, band, stands, settings):
        passes = []
    rest: list[Pass] = []
    flank = flank_left(band.walls, passes, band.z_bottom, band.z_top, settings) if passes else []
    ball: Milled | None = None
    if not passes:
        note = "upright" if band.kind == "upright" else "stepped"
        ball = ball_milled(band, settings, stands, others)
        if ball is not None:
            note = "before ball" if not ball.missed else note
            band = replace(band, steps=steps_of_missed(band, ball.missed))
        passes, rest = _upright_passes(band, below, excess_mm, run_down_mm, settings, small, stands)
    elif small is not None:
        rest = _rest_passes(band, below, excess_mm, 0.0, settings, small, stands)
    operations = [_milled(Process.MILL_SIDE, band.last, passes, settings, note)] if passes else []
    if rest and small is not None:
        operations.append(_milled(Process.MILL_SIDE, band.last, rest, small, f"{note}, rest"))
    if ball is not None and ball.passes:
        operations.append(_milled(Process.MILL_SCALLOP, band.last, ball.passes, settings.with_ball_cutter() or settings, "scallop"))
    last = small if rest and small is not None else settings
    left = [*left_by_cutter(band.region, band.z_bottom, band.z_top, last), *flank]
    missed = blocked_mm(band.region, blocked_near(band.region, band.z_bottom, 0.0, last, stands), last)
    if missed > _CLEAR_MM and note != "ruled":
        left.append(Left("beside", band.z_bottom, band.z_top, "", 0, missed * (band.z_top - band.z_bottom)))
    left += fillets(ball, band, settings)
    if note == "stepped" or not operations:
        left.append(Left("cusps" if operations else "none", band.z_bottom, band.z_top, "", 0, 0.0))
    return operations, left


def _milled(process: Process, layer: int, passes: list[Pass], settings: Settings, note: str) -> Operation:
    diameter, rpm = settings.cutter_diameter_mm, settings.spindle_rpm
    return Operation(process, layer, tuple(passes), cutter_diameter_mm=diameter, spindle_rpm=rpm, note=note)


def _upright_passes(
    band: Band,
    below: Sequence[LayerRegion],
    excess_mm: float,
    run_down_mm: float,
    settings: Settings,
    small: Settings | None,
    stands: Stands | None = None,
) -> tuple[list[Pass], list[Pass]]:
    """Passes round a band, and those of the small cutter where the other does not come.

    They reach as deep under the band's bottom as metal may have run down, where the wall goes on there. Where it goes on
    along a part of the outline only, that part has passes of its own, so that no fin stands at the bottom.
    """
    sunk = run_down_mm if band.kind == "upright" else 0.0
    sunk = min(sunk, band.z_bottom - below[0].z_bottom) if below else 0.0
    passes, is_sunk = _lowered(
        lambda z: passes_beside(band.region, z, excess_mm, settings, stands), band, below, sunk, settings
    )
    passes = eased_round(passes, band.region, excess_mm, settings)
    rest = [] if small is None else _rest_passes(band, below, excess_mm, sunk, settings, small, stands)
    passes += _stepped_passes(band, excess_mm, settings, stands)
    if not is_sunk:
        (passes if small is None else rest).extend(_under_passes(band, below, sunk, small or settings, stands))
    return passes, rest


def _lowered(
    make: Callable[[float], list[Pass]], band: Band, below: Sequence[LayerRegion], sunk: float, cutter: Settings
) -> tuple[list[Pass], bool]:
    """Passes made for a height as deep under a band as they meet nothing that must stand, and whether that is deeper than it."""
    passes = make(band.z_bottom)
    for depth in (sunk, OVERLAP_MM):
        if passes and depth > 0.0 and _may_reach_under(band, below, passes, depth, cutter):
            return make(band.z_bottom - depth), True
    return passes, False


def _rest_passes(
    band: Band,
    below: Sequence[LayerRegion],
    excess_mm: float,
    sunk: float,
    settings: Settings,
    small: Settings,
    stands: Stands | None,
) -> list[Pass]:
    """Upright passes of the small cutter round a band where the other does not come."""
    missed = _missed(band, settings, stands)
    if missed.is_empty:
        return []
    beside = outset(missed, small.cutter_radius_mm + PAST_START_MM)

    def beside_at(z: float) -> list[Pass]:
        blocked = blocked_near(band.region, z, excess_mm, small, stands)
        free = polygons(shapely.difference(beside, blocked))
        return stretch_passes(band.region, free, z, excess_mm, small)

    limit = engagement_limit_rad(small.material.milling.radial_depth_mm, small.cutter_radius_mm)
    return eased(_lowered(beside_at, band, below, sunk, small)[0], missed, small.cutter_radius_mm, limit)


def _stepped_passes(band: Band, excess_mm: float, settings: Settings, stands: Stands | None) -> list[Pass]:
    """Passes level by level, downwards, where the flank cannot follow a wall, or not deep enough: what is left are small steps."""
    passes: list[Pass] = []
    for z, region in band.steps:
        if region.is_empty or abs(z - band.z_bottom) <= _SAME_MM:
            continue
        out = float(shapely.hausdorff_distance(band.region.boundary, region.boundary)) if z > band.z_bottom else 0.0
        passes += passes_beside(region, z, excess_mm + out, settings, stands)
    return passes


def _meets(passes: Sequence[Pass], band: Band, stands: Stands, settings: Settings) -> bool:
    """Whether the cutter's end, or the holder over it, comes into what stands beside a band on passes whose axis leans.

    The holder is asked for at places along its axis, each as that of an upright cutter that reaches as high.
    """
    if not passes:
        return False
    for step in passes:
        u = step.tip.sample(0.05)
        tips = step.tip.evaluate(u)
        axes = np.array([axis_at(step.axis, value) for value in u])
        for along in (0.0, *(stickout_mm(settings) + np.array(_ALONG_HOLDER_MM))):
            there = tips + along * axes
            low = float(there[:, 2].min()) - (stickout_mm(settings) if along else 0.0)
            blocked = stands(max(low, band.z_bottom) if not along else low, settings)
            if not blocked.is_empty and shapely.intersects(shapely.LineString(there[:, :2]), blocked):
                return True
    return False


def _missed(band: Band, settings: Settings, stands: Stands | None) -> MultiPolygon:
    """Where the cutter leaves metal outside a band's walls, mm."""
    missed = unreached(band.region, settings.cutter_radius_mm)
    blocked = blocked_near(band.region, band.z_bottom, 0.0, settings, stands)
    kept_off = MultiPolygon()
    if not blocked.is_empty:
        round_wall = shapely.difference(outset(band.region, settings.cutter_diameter_mm), band.region)
        kept_off = polygons(shapely.intersection(shapely.buffer(blocked, settings.cutter_radius_mm), round_wall))
    return MultiPolygon([*missed.closed.geoms, *missed.corners.geoms, *kept_off.geoms])


def _within(band: Band, below: Sequence[LayerRegion], depth_mm: float) -> list[LayerRegion]:
    """The layers under a band down to a depth."""
    return [layer for layer in below if layer.z_top > band.z_bottom - depth_mm]


def _under_passes(
    band: Band, below: Sequence[LayerRegion], depth_mm: float, settings: Settings, over: Stands | None = None
) -> list[Pass]:
    """Stretches round a band, under its bottom, on which the cutter's end meets nothing that must stand."""
    near = _within(band, below, depth_mm)
    if depth_mm <= 0.0 or not near or not all(layer.is_upright for layer in near):
        return []
    stands = outset(united([layer.region for layer in near]), settings.cutter_radius_mm - _BESIDE_MM)
    stands = shapely.union(stands, blocked_near(band.region, band.z_bottom, 0.0, settings, over))
    far = shapely.box(*band.region.bounds).buffer(settings.cutter_diameter_mm)
    free = polygons(far - stands)
    return stretch_passes(band.region, free, band.z_bottom - depth_mm, 0.0, settings)


def _may_reach_under(
    band: Band, below: Sequence[LayerRegion], passes: list[Pass], depth_mm: float, settings: Settings
) -> bool:
    """Whether the cutter's end, let down by a depth where the wall goes on, would meet nothing that must stand."""
    near = _within(band, below, depth_mm)
    if not near or not band.continues:
        return False
    swept = swept_by(passes, settings.cutter_radius_mm - _CLEAR_MM)
    areas = [area for layer in near for area in (layer.areas if depth_mm > OVERLAP_MM else layer.areas[2:])]
    return all(shapely.intersection(swept, area).area < 1e-3 for area in areas)


def _ruled_passes(
    band: Band,
    below: Sequence[LayerRegion],
    excess_mm: float,
    run_down_mm: float,
    settings: Settings,
    stands: Stands | None = None,
) -> list[Pass]:
    """Passes round all walls of a ruled band, wall by wall; none if the flank cannot follow one of them.

    The end of a leaning cutter rises away from the wall and leaves a wedge at the foot of what stands outside. Where the
    same wall goes on below, the cutter reaches under the wedge, and as far as metal may have run down on it; else an
    upright pass clears it, and where the wall goes out below, passes in small steps.
    """
    passes: list[Pass] = []
    is_deep = True
    for wall in band.walls:
        motions, reaches = _wall_motions(wall, band, below, excess_mm, run_down_mm, settings)
        if not motions:
            return []
        is_deep = is_deep and reaches
        keep_out = outset(band.region, settings.cutter_radius_mm - 0.5)
        passes += [side_pass(begun_on_flat(motion), keep_out, excess_mm, settings) for motion in motions]
    if band.first == 0 or not band.continues:
        passes = [*upright_passes(band.region, band.z_bottom, excess_mm, settings), *passes]
    return passes if is_deep else [*passes, *_stepped_passes(band, excess_mm, settings, stands)]


def _wall_motions(
    wall: Wall, band: Band, below: Sequence[LayerRegion], excess_mm: float, run_down_mm: float, settings: Settings
) -> tuple[list[Motion], bool]:
    """The motions along one wall, as deep under its bottom as they may go, and whether that is where metal runs down to."""
    others = [other for other in band.walls if other is not wall]
    wedge = OVERLAP_MM + excess_mm * steepest_lean(wall)
    if below and band.continues:
        deep = min(wedge + run_down_mm, band.z_bottom)
        if leans_inward(wall) and goes_on_below(wall, deep, below):
            motions = ruled_motions(wall, excess_mm, deep, 0.0, settings, others)
            if motions and ends_clear(motions, deep, below, settings.cutter_radius_mm):
                return motions, True
        if goes_on_below(wall, wedge, below):
            return ruled_motions(wall, excess_mm, wedge, None, settings, others), not leans_inward(wall)
        dip = 2.0 * settings.cutter_radius_mm * steepest_lean(wall)
        for depth in (OVERLAP_MM, 0.0):
            if depth == 0.0 or goes_on_below(wall, depth, below):
                motions = ruled_motions(wall, excess_mm, depth, None, settings, others)
                if motions and ends_clear(motions, depth + dip, below, settings.cutter_radius_mm):
                    return motions, not leans_inward(wall)
    flat = ruled_motions(wall, excess_mm, 0.0, 0.0 if band.first == 0 else band.z_bottom, settings, others)
    return flat, band.first == 0 or not leans_inward(wall)
