"""How far round cutters stand in metal over a whole plan: the greatest angle of each kind of milling, and where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.plan import Layer, Operation, Pass, Process
from planner.process import Settings
from planner.toolpath.beside import polygons
from planner.toolpath.cut import BULGE
from planner.toolpath.engagement import engagement_limit_rad, engagements
from planner.toolpath.face import widest_step_mm

Floats = NDArray[np.float64]

_CHORD_MM = 0.05  # of beads
_UPRIGHT = 1.0 - 1e-9  # z of a normal or an axis that does not lean


@dataclass(frozen=True)
class Engagement:
    """The greatest of one kind of milling.

    angle_deg, limit_deg : of the cutter's edge in metal, found and asked for by the material   feed_share : of the usual feed there
    place : (3,) float, mm, build frame, of the cutter's end
    """

    process: Process
    note: str
    angle_deg: float
    limit_deg: float
    feed_share: float
    place: tuple[float, float, float]


def engagement_of(layers: Sequence[Layer], settings: Settings) -> list[Engagement]:
    """The greatest engagement of each kind of milling with an upright axis in upright layers, in the order they come.

    What stands is told by the beads laid since walls were last cut, seen along the build direction; facing meets the beads of
    its own layer. Leaning axes and layers are not looked at.
    """
    found: dict[tuple[Process, str], Engagement] = {}
    beads: list[MultiPolygon] = []
    piece = -1
    for layer in layers:
        if layer.subcomponent != piece:
            beads, piece = [], layer.subcomponent
        if layer.top[5] < _UPRIGHT:
            continue
        beads.append(_beads(layer))
        cut = False
        for operation in layer.operations:
            if operation.process in (Process.MILL_FACE, Process.MILL_SIDE):
                is_face = operation.process is Process.MILL_FACE
                metal = beads[-1] if is_face else polygons(shapely.union_all(beads))
                if not is_face:
                    metal = polygons(shapely.difference(metal, _walls_of(layer)))
                _look(operation, metal, settings, found)
                cut = cut or not is_face
        beads = [] if cut else beads
    return list(found.values())


def _look(
    operation: Operation, metal: MultiPolygon, settings: Settings, found: dict[tuple[Process, str], Engagement]
) -> None:
    """Takes an operation's greatest engagement in, if it is greater than what is known of its kind."""
    passes = [one for one in operation.passes if not one.rapid and not one.is_link and _is_upright(one)]
    radius = 0.5 * operation.cutter_diameter_mm
    is_face = operation.process is Process.MILL_FACE
    depth = widest_step_mm(settings) * operation.cutter_diameter_mm / settings.cutter_diameter_mm
    limit = engagement_limit_rad(depth if is_face else settings.material.milling.radial_depth_mm, radius)
    for one, seen in zip(passes, engagements(passes, metal, radius), strict=True):
        at = int(np.argmax(seen.angle_rad))
        known = found.get((operation.process, operation.note))
        if known is None or np.degrees(seen.angle_rad[at]) > known.angle_deg:
            rows = one.setpoints
            row = int(np.searchsorted(rows[:, 0], seen.arc_mm[at] + 1e-6, side="right")) - 1
            x, y, z = one.tip.evaluate(one.tip.at_arc_length([float(seen.arc_mm[at])]))[0].tolist()
            share = float(rows[row, 1] / rows[:, 1].max())
            angle = float(np.degrees(seen.angle_rad[at]))
            found[operation.process, operation.note] = Engagement(
                operation.process, operation.note, angle, float(np.degrees(limit)), share, (x, y, z)
            )


def _is_upright(one: Pass) -> bool:
    return isinstance(one.axis, np.ndarray) and bool(one.axis[2] >= _UPRIGHT)


def _beads(layer: Layer) -> MultiPolygon:
    """What a layer's beads cover, melt that runs out with them, mm."""
    lines = []
    for operation in layer.operations:
        if operation.process.is_deposit:
            half = (0.5 + BULGE) * operation.bead_width_mm
            for one in operation.passes:
                if not one.is_link and (one.setpoints[:, 2] > 0.0).any():
                    points = one.tip.evaluate(one.tip.sample(_CHORD_MM))[:, :2]
                    lines.append(shapely.buffer(shapely.LineString(points), half, quad_segs=8))
    return polygons(shapely.union_all(lines)) if lines else MultiPolygon()


def _walls_of(layer: Layer) -> MultiPolygon:
    """The region that a layer's contours enclose, mm."""
    rings = [shapely.Polygon(c.curve.evaluate(c.curve.sample(_CHORD_MM))[:, :2]) for c in layer.contours]
    region: shapely.Geometry = MultiPolygon()
    for ring in sorted(rings, key=lambda ring: -ring.area):
        region = shapely.symmetric_difference(region, shapely.make_valid(ring))
    return polygons(region)


def engagement_findings(layers: Sequence[Layer], settings: Settings) -> list[str]:
    """One line: the greatest engagement of each kind of milling where it is more than the material asks for."""
    over = [one for one in engagement_of(layers, settings) if one.angle_deg > one.limit_deg + 10.0]
    if not over:
        return []
    parts = [
        f"{one.process.value} ({one.note or 'tops'}) {one.angle_deg:.0f}° of {one.limit_deg:.0f}° at "
        f"({one.place[0]:.1f}, {one.place[1]:.1f}, {one.place[2]:.1f}) mm, feed there {100.0 * one.feed_share:.0f} %"
        for one in over
    ]
    return [f"the cutter stands in metal farther round than its radial depth asks for: {'; '.join(parts)}"]
