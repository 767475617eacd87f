"""Boring from the side: a hole that was built full is cut out along its own axis with an end mill."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from planner.decompose.bores import Bore, across_axes, has_way_in
from planner.mesh.mesh import Mesh
from planner.nurbs import construct
from planner.nurbs.fit import interpolate
from planner.plan import Operation, Pass, Process
from planner.process import Settings
from planner.toolpath.holder import holder_radius_mm, stickout_mm
from planner.toolpath.links import CLEARANCE_MM, Pose, linked_from_beside
from planner.toolpath.motion import Motion, joined, process_pass, quarter_arc, straight

Floats = NDArray[np.float64]

_FINISH_MM = 0.2  # what roughing leaves on the wall for the last turn
_RAMP = np.tan(np.radians(3.0))  # of helical entry: what end mills without teeth at the centre stand
_CORELESS = 0.45  # of the diameter: a helix of at most this radius leaves no core
_LEAST_TURN_MM = 0.5  # of the centre's path round a bore: in narrower ones the cutter has no room for chips
_BEYOND_MM = 0.5  # how far the cutter comes out of the far mouth of a through bore
_BEFORE_MM = 1.0  # air before the mouth where feed begins
_PAST_START_MM = 1.0  # how far the last turn runs past its start, so that no witness mark stands
_LEAD_MM = 1.5  # radius of the arcs on and off the wall
_HELIX_RAD = np.radians(20.0)  # between points of a helix: the curve through them is within 1e-4 mm of it


@dataclass(frozen=True)
class Boring:
    """A bore to be cut.  settings : of its cutter   beside_mm : how far before its mouth the tool stands beside the part."""

    bore: Bore
    settings: Settings
    beside_mm: float


def borings(solid: Mesh, bores: Sequence[Bore], settings: Settings) -> tuple[list[Boring], list[str]]:
    """The bores that a cutter can make from outside with the way it takes, and a line for each bore that none can.

    solid : the part with all bores full.
    """
    cutters = [cutter for cutter in (settings, settings.with_small_cutter()) if cutter is not None]
    found, notes = [], []
    for bore in bores:
        sides = [bore, bore.turned()] if bore.is_through else [bore]
        open_ways = [way for way in sides if has_way_in(solid, way)]
        fitting = [cutter for cutter in cutters if fits(bore, cutter)]
        ways = [
            (way, cutter)
            for cutter in fitting
            for way in open_ways
            if has_way_in(solid, way, stickout_mm(cutter) - bore.depth_mm - _BEYOND_MM, holder_radius_mm(cutter))
        ]
        if ways:
            way, cutter = ways[0]
            farthest = float(((solid.vertices - way.mouth) @ way.axis).max())
            found.append(Boring(way, cutter, farthest + CLEARANCE_MM))
            notes.append(f"{way}: its roof would hang, it is built full and bored from the side")
        else:
            why = "narrower than the cutter needs" if open_ways else "no cutter comes in straight from outside"
            if open_ways and fitting:
                why = "the tool's holder has no room before it"
            notes.append(f"{bore}: its roof hangs and {why}: it is built open")
    return found, notes


def fits(bore: Bore, settings: Settings) -> bool:
    """Whether the cutter has room to turn in a bore."""
    return bore.radius_mm - settings.cutter_radius_mm >= _LEAST_TURN_MM


def bore_operation(boring: Boring, layer: int, here: Pose, metal_top: float) -> tuple[Operation, Pose]:
    """The boring of one hole with its ways, and the pose in which it leaves the tool: upright beside the part.

    layer : after which it is done   here : pose before it   metal_top : highest metal, mm.
    """
    bore, settings = boring.bore, boring.settings
    operation = Operation(
        Process.MILL_SIDE,
        layer,
        (bore_pass(bore, settings),),
        cutter_diameter_mm=settings.cutter_diameter_mm,
        spindle_rpm=settings.spindle_rpm,
        note="bore",
    )
    beyond = Pose(bore.mouth + boring.beside_mm * bore.axis, bore.axis)
    return linked_from_beside(operation, here, beyond, metal_top)


def bore_pass(bore: Bore, settings: Settings) -> Pass:
    """One pass: level by level down a helix and outwards in rings, then once round at full depth with arcs on and off.

    The part is on the right all the way (climb milling, spindle clockwise); the axis is the bore's.
    """
    milling = settings.material.milling
    reach = bore.radius_mm - settings.cutter_radius_mm
    rough = max(reach - _FINISH_MM, 0.5 * reach)
    helix = min(rough, _CORELESS * settings.cutter_diameter_mm)
    count = max(0, int(np.ceil((rough - helix) / milling.radial_depth_mm - 1e-9)))
    radii = np.linspace(helix, rough, count + 1)
    depth = bore.depth_mm + (_BEYOND_MM if bore.is_through else 0.0)
    levels = np.linspace(0.0, depth, int(np.ceil(depth / milling.axial_depth_mm - 1e-9)) + 1)
    frame = _Frame(bore)
    motions = [frame.line((helix, 0.0, -_BEFORE_MM), (helix, 0.0, 0.0))]
    for above, level in pairwise(levels.tolist()):
        motions += [frame.helix(helix, above, level), frame.ring(helix, level)]
        for inner, outer in pairwise(radii.tolist()):
            motions += [frame.line((inner, 0.0, level), (outer, 0.0, level)), frame.ring(outer, level)]
        if level < levels[-1] and count:
            motions.append(frame.line((radii[-1], 0.0, level), (helix, 0.0, level)))
    motions += _last_turn(frame, reach, float(radii[-1]), depth)
    return process_pass(joined(motions), [0.0, settings.mill_feed_mm_s, 0.0, 0.0, 0.0])


def _last_turn(frame: _Frame, reach: float, here: float, depth: float) -> list[Motion]:
    """Once round the wall at full depth and out along the axis.  here : radius at which roughing ended, mm."""
    lead = min(_LEAD_MM, 0.5 * reach)
    past = min(_PAST_START_MM / reach, 1.0)
    on, off = frame.turned(0.0), frame.turned(past)
    start, end = (reach - lead, -lead, depth), (reach - lead, lead, depth)
    return [
        frame.line((here, 0.0, depth), start),
        on.quarter(start, (reach, -lead, depth), (reach, 0.0, depth)),
        frame.ring(reach, depth),
        frame.arc(reach, depth, past),
        off.quarter((reach, 0.0, depth), (reach, lead, depth), end),
        off.line(end, (0.0, 0.0, depth)),
        frame.line((0.0, 0.0, depth), (0.0, 0.0, -_BEFORE_MM)),
    ]


class _Frame:
    """Curves in a bore's own coordinates: across its axis, mm, and depth below its mouth, mm."""

    def __init__(self, bore: Bore, turn_rad: float = 0.0) -> None:
        self.bore = bore
        first, second = across_axes(bore.axis)
        cos, sin = np.cos(turn_rad), np.sin(turn_rad)
        self.axes = np.array([cos * first + sin * second, cos * second - sin * first, -bore.axis])

    def turned(self, angle_rad: float) -> _Frame:
        """The frame turned counter-clockwise about the axis."""
        return _Frame(self.bore, angle_rad)

    def points(self, local: object) -> Floats:
        """(n, 3) float, mm   Points in the build frame."""
        return np.asarray(self.bore.mouth + np.asarray(local, dtype=np.float64) @ self.axes)

    def line(self, start: tuple[float, float, float], end: tuple[float, float, float]) -> Motion:
        """Straight on."""
        return straight(self.points([start, end]), self.bore.axis)

    def arc(self, radius: float, depth: float, sweep: float) -> Motion:
        """Counter-clockwise about the bore's axis, from its first axis on."""
        centre = self.points([[0.0, 0.0, depth]])[0]
        return Motion(construct.arc(centre, self.axes[0], self.axes[1], radius, 0.0, sweep), self.bore.axis)

    def ring(self, radius: float, depth: float) -> Motion:
        """Once round."""
        return self.arc(radius, depth, 2.0 * np.pi)

    def helix(self, radius: float, above: float, level: float) -> Motion:
        """Down in whole turns."""
        turns = max(1, int(np.ceil((level - above) / (2.0 * np.pi * radius * _RAMP))))
        angle = np.linspace(0.0, 2.0 * np.pi * turns, int(np.ceil(2.0 * np.pi * turns / _HELIX_RAD)) + 1)
        down = np.linspace(above, level, len(angle))
        path = self.points(np.column_stack([radius * np.cos(angle), radius * np.sin(angle), down]))
        return Motion(interpolate(path, closed=False), self.bore.axis)

    def quarter(self, *points: tuple[float, float, float]) -> Motion:
        """A quarter turn; start, corner, end."""
        start, corner, end = self.points(points)
        return quarter_arc(start, corner, end, self.bore.axis)
