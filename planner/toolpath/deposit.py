"""The deposition of one layer as operations: contours, hatch, and one bead along the middle of what is too thin."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.nurbs.corners import by_turning_angle
from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate
from planner.nurbs.offset import inset, outset
from planner.plan import Operation, Pass, Process
from planner.process import Bead, Settings
from planner.slicing.regions import LayerRegion
from planner.toolpath.centreline import thin_parts
from planner.toolpath.contour import closed_bead, edge_mm, open_bead
from planner.toolpath.fitting import evened, fitted_stretches, widest_mm
from planner.toolpath.islands import islands_in_order
from planner.toolpath.motion import UP, Motion
from planner.toolpath.overhang import overhang_passes
from planner.toolpath.pattern import part_passes
from planner.toolpath.ramps import on_cold_plate
from planner.toolpath.relief import Relief

Floats = NDArray[np.float64]

THINNEST = 0.35  # of the bead's width: a bead on a thinner wall is mostly beside it
_SMOOTH_DEG = 25.0  # sharper turns of a middle line are corners


def grown_region(layer: LayerRegion, bead: Bead, settings: Settings) -> MultiPolygon:
    """What beads cover: the layer's region with allowance and edge strip on all walls, holes shrunk, mm."""
    growth = outside_mm(bead, settings)
    return outset(layer.region, growth) if growth > 0.0 else layer.region


def outside_mm(bead: Bead, settings: Settings) -> float:
    """How far tracks reach beyond the finished wall, mm."""
    return settings.allowance_mm + edge_mm(bead, settings)


@dataclass(frozen=True)
class Dropped:
    """A piece of a layer that no bead makes.  place : x, y, mm   width_mm : its mean width, and the bead's."""

    layer: int
    place: tuple[float, float]
    area_mm2: float
    width_mm: float
    bead_mm: float


def deposit_operations(
    layer: LayerRegion,
    bead: Bead,
    settings: Settings,
    is_top: bool = False,
    *,
    height_at: Callable[[Floats], Floats] | None = None,
    below: LayerRegion | None = None,
) -> tuple[list[Operation], list[Dropped]]:
    """Operations that deposit a layer on its lower plane, without links, and what falls away.

    bead : for the layer's greatest height   is_top : part of the layer's top is a finished face
    height_at : (n, 2) float, mm, in the layer's plane, to (n,) float, mm, the layer's height there; the beads' heights follow
    it along each pass, by speed and powder. None: as high everywhere as the two planes are apart.
    below : the layer below, where walls may begin to lean between the two.
    Raises RecipeError if the material's window has no bead as high as asked.
    """
    relief = Relief.of(layer, bead, settings, height_at) if height_at is not None else None
    growth = outside_mm(bead, settings)
    grown = grown_region(layer, bead, settings)
    middle = outset(layer.areas[1], growth) if growth > 0.0 else layer.areas[1]
    hanging = overhang_passes(layer, grown, middle, growth, bead, settings, height_at, below)
    grown = hanging.rest
    middles, dropped, wide = _thin_passes(grown, layer, bead, settings, relief)
    contours, fill = _wide_passes(wide, layer, bead, settings, is_top, relief)
    operations: list[Operation] = []
    if layer.index == 0 and settings.is_on_plate:
        contours, middles, fill = (on_cold_plate(passes, settings) for passes in (contours, middles, fill))
    for process, passes in (
        (Process.DEPOSIT_CONTOUR, [*contours, *middles]),
        (Process.DEPOSIT_FILL, fill),
        (Process.DEPOSIT_OVERHANG, hanging.passes),
    ):
        if passes:
            operations.append(
                Operation(
                    process,
                    layer.index,
                    tuple(passes),
                    interpass_s=settings.interpass_s if not operations else 0.0,
                    bead_width_mm=bead.width_mm,
                    bead_height_mm=bead.height_mm,
                )
            )
    return operations, dropped


def _wide_passes(
    wide: MultiPolygon, layer: LayerRegion, bead: Bead, settings: Settings, is_top: bool, relief: Relief | None
) -> tuple[list[Pass], list[Pass]]:
    """Contours and fill, polygon by polygon, each in its own pattern."""
    contours: list[Pass] = []
    fill: list[Pass] = []
    for part in islands_in_order(wide, layer.index):
        rings, inside = part_passes(part, layer.z_bottom, layer.index, bead, settings, is_top, relief)
        contours += rings
        fill += inside
    return contours, fill


def _thin_passes(
    grown: MultiPolygon, layer: LayerRegion, bead: Bead, settings: Settings, relief: Relief | None
) -> tuple[list[Pass], list[Dropped], MultiPolygon]:
    """A bead of fitting width along the middle of each part too narrow for two, what is too thin for any, and the rest."""
    passes: list[Pass] = []
    dropped: list[Dropped] = []
    taken = []
    edge = edge_mm(bead, settings)
    for part in thin_parts(grown, bead.width_mm, widest_mm(bead, edge, settings)):
        taken.append(part.area)
        if part.width_mm < THINNEST * bead.width_mm:
            point = part.area.representative_point()
            dropped.append(Dropped(layer.index, (point.x, point.y), part.area.area, part.width_mm, bead.width_mm))
            continue
        full = shapely.intersection(part.area, inset(grown, edge)) if edge > 0.0 else part.area
        fitted = evened([fitted_stretches(line, bead, edge, settings) for line in part.lines], part, full.area, bead, settings)
        for line, stretches in zip(part.lines, fitted, strict=True):
            motion = Motion(_middle_curve(line.points, line.closed, layer.z_bottom), UP)
            passes.append((closed_bead if line.closed else open_bead)(motion, bead, settings, stretches, relief))
    if not taken:
        return passes, dropped, grown
    rest = shapely.difference(grown, shapely.union_all(taken))
    return passes, dropped, MultiPolygon([piece for piece in shapely.get_parts(rest) if piece.geom_type == "Polygon"])


def _middle_curve(line: Floats, closed: bool, z: float) -> Curve:
    """The middle line as a curve at height z.  line : (n, 2) float, mm, closed lines end where they begin."""
    path = line[:-1] if closed else line
    points = np.column_stack([path, np.full(len(path), z)])
    if len(points) == 2:
        return Curve.from_polyline(points)
    return interpolate(points, closed=closed, corners=by_turning_angle(points, _SMOOTH_DEG, closed=closed))


def dropped_findings(dropped: list[Dropped]) -> list[str]:
    """One line for each place at which pieces of neighbouring layers fall away, with layers and area."""
    groups: list[list[Dropped]] = []
    for piece in dropped:
        for group in groups:
            if piece.layer - group[-1].layer <= 1 and math.dist(piece.place, group[-1].place) <= piece.bead_mm:
                group.append(piece)
                break
        else:
            groups.append([piece])
    return [
        f"layers {group[0].layer}-{group[-1].layer}: {max(piece.area_mm2 for piece in group):.2f} mm² near "
        f"({group[0].place[0]:.1f}, {group[0].place[1]:.1f}) mm fall away: {group[0].width_mm:.2f} mm wide with "
        f"allowance, the bead {group[0].bead_mm:.2f} mm"
        for group in groups
    ]
