"""The deposition of one layer as operations: contours, hatch, and one bead along the middle of what is too thin."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.nurbs.corners import by_turning_angle
from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate
from planner.nurbs.offset import outset
from planner.plan import Operation, Pass, Process
from planner.process import Bead, Settings
from planner.slicing.regions import LayerRegion
from planner.toolpath.centreline import ThinPart, thin_parts
from planner.toolpath.contour import closed_bead, contour_passes, open_bead
from planner.toolpath.fill import fill_passes
from planner.toolpath.motion import UP, Motion

Floats = NDArray[np.float64]

_THINNEST = 0.35  # of the bead's width: a bead on a thinner wall is mostly beside it
_SMOOTH_DEG = 25.0  # sharper turns of a middle line are corners


def grown_region(layer: LayerRegion, settings: Settings) -> MultiPolygon:
    """What is deposited: the layer's region with the stock allowance on all walls, holes shrunk, mm."""
    return outset(layer.region, settings.allowance_mm) if settings.allowance_mm > 0.0 else layer.region


def deposit_operations(layer: LayerRegion, bead: Bead, settings: Settings) -> tuple[list[Operation], list[str]]:
    """Operations that deposit a layer on its lower plane, without links, and findings."""
    grown = grown_region(layer, settings)
    contours = contour_passes(grown, layer.z_bottom, layer.index, bead, settings)
    middles, findings = _thin_passes(grown, layer, bead, settings)
    fill = fill_passes(grown, layer.z_bottom, layer.index, bead, settings)
    operations = []
    for process, passes in ((Process.DEPOSIT_CONTOUR, [*contours, *middles]), (Process.DEPOSIT_FILL, fill)):
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
    return operations, findings


def _thin_passes(
    grown: MultiPolygon, layer: LayerRegion, bead: Bead, settings: Settings
) -> tuple[list[Pass], list[str]]:
    """A bead along the middle of each part that is thinner than a bead; a finding for what falls away."""
    passes, findings = [], []
    for part in thin_parts(grown, bead.width_mm):
        if part.width_mm < _THINNEST * bead.width_mm:
            findings.append(_falls_away(part, layer, bead))
            continue
        for line, closed in zip(part.lines, part.closed, strict=True):
            motion = Motion(_middle_curve(line, closed, layer.z_bottom), UP)
            passes.append((closed_bead if closed else open_bead)(motion, bead, settings))
    return passes, findings


def _middle_curve(line: Floats, closed: bool, z: float) -> Curve:
    """The middle line as a curve at height z.  line : (n, 2) float, mm, closed lines end where they begin."""
    path = line[:-1] if closed else line
    points = np.column_stack([path, np.full(len(path), z)])
    if len(points) == 2:
        return Curve.from_polyline(points)
    return interpolate(points, closed=closed, corners=by_turning_angle(points, _SMOOTH_DEG, closed=closed))


def _falls_away(part: ThinPart, layer: LayerRegion, bead: Bead) -> str:
    place = part.area.representative_point()
    return (
        f"layer {layer.index}: {part.area.area:.2f} mm² near ({place.x:.1f}, {place.y:.1f}, {layer.z_bottom:.1f}) mm "
        f"fall away: {part.width_mm:.2f} mm wide, the bead {bead.width_mm:.2f} mm"
    )
