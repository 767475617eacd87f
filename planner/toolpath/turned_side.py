"""Side milling of a band that turns: the flank on its rulings, each pose as deep under the band as the piece there allows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.nurbs.offset import outset
from planner.plan import Operation, Pass, Process
from planner.process import Settings
from planner.slicing.regions import LayerRegion
from planner.toolpath.axis import DepthAt, ruled_motions
from planner.toolpath.beside import Stands, blocked_mm, blocked_near
from planner.toolpath.cut import OVERLAP_MM, Left, side_operations
from planner.toolpath.left import left_by_cutter
from planner.toolpath.side import begun_on_flat, side_pass, upright_passes
from planner.toolpath.stretches import LEAST_STRETCH_MM, free_passes
from planner.toolpath.turned_bands import TurnedBand

Floats = NDArray[np.float64]

_FOLLOWS = 0.3  # of the tolerance: how far the flank may cut into the wall under the band, or leave it
_STEEPEST = 1.0  # change of depth along the pass: the cutter's end rises and falls by no more than 45 degrees
_ARC_ROOM_MM = 0.5  # by which arcs on and off a wall may come nearer to it than the pass: they leave it sideways
_ALONG = 0.05  # of an axis on the base's normal: less, and lifting along it leads nowhere


def turned_side_operations(
    made: TurnedBand,
    under: Sequence[LayerRegion],
    excess_mm: float,
    run_down_mm: float,
    settings: Settings,
    stands: Stands | None = None,
) -> tuple[list[Operation], list[Left]]:
    """Milling of a band's walls in the band's frame, and what it leaves.

    under : `layers_under` the band   excess_mm : metal outside the walls   run_down_mm : how far it may have run down
    stands : what must not be cut beside it. Bands that no flank follows are milled as `side_operations` does.
    """
    band = made.band
    passes: list[Pass] = []
    barred = blocked_near(band.region, band.z_bottom, excess_mm, settings, stands)
    if band.kind == "ruled":
        passes = _ruled_passes(made, under, excess_mm, run_down_mm, settings, barred, stands is None)
    if not passes:
        stepped = replace(band, kind="stepped") if band.kind == "ruled" else band
        return side_operations(stepped, under, excess_mm, run_down_mm, settings, stands=stands)
    operation = Operation(
        Process.MILL_SIDE,
        band.last,
        tuple(passes),
        cutter_diameter_mm=settings.cutter_diameter_mm,
        spindle_rpm=settings.spindle_rpm,
        note="ruled",
    )
    found = left_by_cutter(band.region, band.z_bottom, band.z_top, settings)
    kept_off = blocked_mm(band.region, barred, settings)
    if kept_off > LEAST_STRETCH_MM:
        found.append(Left("beside", band.z_bottom, band.z_top, "", 0, kept_off * (band.z_top - band.z_bottom)))
    return [operation], found


def _ruled_passes(
    made: TurnedBand,
    under: Sequence[LayerRegion],
    excess_mm: float,
    run_down_mm: float,
    settings: Settings,
    barred: MultiPolygon,
    is_on_plate: bool,
) -> list[Pass]:
    """Passes round all walls, wall by wall; none if the flank cannot follow one of them.

    barred : where what else stands keeps the tip away   is_on_plate : nothing else stands, the base plane goes on everywhere.
    """
    band = made.band
    on_base = band.first == 0
    below = under if band.continues else ()
    reach = depths(below, made, OVERLAP_MM + run_down_mm, settings, is_on_plate)
    passes: list[Pass] = []
    keep_out = outset(band.region, settings.cutter_radius_mm - _ARC_ROOM_MM)
    for wall in band.walls:
        others = [other for other in band.walls if other is not wall]
        motions = ruled_motions(wall, excess_mm, 0.0, None, settings, others, depth_at=reach)
        if not motions:
            return []
        for motion in motions:
            if barred.is_empty:
                passes.append(side_pass(begun_on_flat(motion), keep_out, excess_mm, settings))
            else:
                passes += free_passes(motion, barred, settings)
    if on_base or not band.continues:
        upright = upright_passes(band.region, band.z_bottom, excess_mm, settings)
        if barred.is_empty:
            return [*upright, *passes]
    return passes


def depths(
    under: Sequence[LayerRegion], made: TurnedBand, most_mm: float, settings: Settings, is_on_plate: bool = True
) -> DepthAt:
    """How far poses may reach under a band: as long as the cutter's axis keeps its distance from what stands there.

    under : from the lowest, up to the band's bottom; none: no deeper than that   most_mm : no deeper than so. Where the
    cutter's end would dip under the piece's base plane, it is lifted: the depth is negative. On a plate that plane goes on
    everywhere, on another piece round the base only.
    """
    z_bottom = made.band.z_bottom
    levels: list[tuple[float, MultiPolygon]] = []
    for layer in reversed(under):
        middle = 0.5 * (layer.z_bottom + layer.z_top)
        levels += [(layer.z_top, layer.areas[2]), (middle, layer.areas[1]), (layer.z_bottom, layer.areas[0])]
    allowed = _FOLLOWS * settings.recipe.tolerance_mm
    for _, area in levels:
        shapely.prepare(area)

    def depth_at(tips: Floats, axes: Floats, normals: Floats, away_mm: float) -> Floats:
        lean = axes[:, 2] * normals[:, 2] / np.linalg.norm(normals[:, :2], axis=1)
        across = np.sqrt(
            np.maximum(1.0 - lean**2, 0.0)
        )  # of a level distance from the wall: how far off it the axis is
        reached = np.zeros(len(tips))
        short = np.full(len(tips), allowed)  # how far the axis may still come nearer, at the last level
        is_free = np.ones(len(tips), dtype=np.bool_)
        last = 0.0
        for height, area in levels:
            down = z_bottom - height
            if down <= last or last >= most_mm:
                continue
            points = tips - (down / axes[:, 2])[:, None] * axes
            apart = shapely.distance(shapely.points(points[:, :2]), area) * across
            spare = apart - away_mm + allowed
            gone = np.where(spare >= 0.0, 1.0, np.clip(short / np.maximum(short - spare, 1e-12), 0.0, 1.0))
            reached = np.where(is_free, last + gone * (down - last), reached)
            is_free &= spare >= 0.0
            short = np.where(is_free, np.maximum(spare, 1e-9), short)
            last = down
        return _levelled(np.minimum(np.minimum(reached, most_mm), over_base(tips, axes)), tips)

    def over_base(tips: Floats, axes: Floats) -> Floats:
        point, normal = made.base[:3], made.base[3:]
        along = axes @ normal
        spare = (tips - point) @ normal - settings.cutter_radius_mm * np.sqrt(np.maximum(1.0 - along**2, 0.0))
        depth = spare * axes[:, 2] / np.maximum(along, _ALONG)
        flat = tips - point - ((tips - point) @ normal)[:, None] * normal
        near = np.linalg.norm(flat, axis=1) <= made.base_radius_mm + settings.cutter_diameter_mm
        return np.where(
            (along > _ALONG) & (near | is_on_plate), np.maximum(depth, made.band.z_bottom - made.band.z_top), most_mm
        )

    return depth_at


def _levelled(depth: Floats, tips: Floats) -> Floats:
    """Depths no deeper than given whose change along a closed pass is bounded.  depth : (n,) mm   tips : (n, 3) mm"""
    steps = _STEEPEST * np.linalg.norm(np.roll(tips, -1, axis=0) - tips, axis=1)
    level = depth.copy()
    for _ in range(2):
        for k in range(len(level)):
            level[k] = min(level[k], level[k - 1] + steps[k - 1])
        for k in range(len(level) - 1, -1, -1):
            level[k] = min(level[k], level[(k + 1) % len(level)] + steps[k])
    return level
