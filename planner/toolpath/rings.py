"""Contour-parallel fill: beads beside the outline all the way in, and along the middle of what is left too thin for two."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from planner.nurbs.corners import by_turning_angle
from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate
from planner.nurbs.offset import inset
from planner.nurbs.rings import curves_from_region
from planner.plan import Pass
from planner.process import Bead, Settings
from planner.toolpath.centreline import MiddleLine, thin_parts
from planner.toolpath.contour import PATH_TOLERANCE_MM, closed_bead, open_bead, overlap_mm, spread_start
from planner.toolpath.fitting import Stretch, scaled_bead
from planner.toolpath.motion import UP, Motion, lifted
from planner.toolpath.relief import Relief

Floats = NDArray[np.float64]

_ONE_BEAD = 1.5  # of the step: strips up to it take one bead along their middle
_MOST_LEVELS = 200  # rings inside each other: half a metre of them
_ROUNDS = 4  # of evening out
_CHANGE = 0.12  # of the step: a larger change of a strip's width begins another stretch
_SMOOTH_DEG = 25.0  # sharper turns of a middle line are corners


@dataclass(frozen=True, eq=False)
class Strip:
    """A bead to be.  motion : of its middle   closed : all the way round   widths_mm : ((arc length, mm), ...) that it stands for."""

    motion: Motion
    closed: bool
    widths_mm: tuple[tuple[float, float], ...]

    @property
    def area_mm2(self) -> float:
        """Area that it stands for."""
        at = np.array([row[0] for row in self.widths_mm] + [self.motion.length])
        return float(np.diff(at) @ np.array([row[1] for row in self.widths_mm]))


def even_step(region: Polygon, step_mm: float) -> float:
    """The step at which beads of equal distance tile the region where it is widest, mm."""
    across = 2.0 * float(shapely.maximum_inscribed_circle(region).length)
    return across / max(1, round(across / step_mm))


def ring_strips(region: Polygon, z: float, step_mm: float) -> tuple[list[Strip], MultiPolygon]:
    """Strips that tile a region from its outline inward, outermost first, and what is left over.

    region : that the strips stand for, mm   z : of the surface that receives the beads
    """
    step = even_step(region, step_mm)
    left = MultiPolygon([region])
    strips: list[Strip] = []
    over: list[Polygon] = []
    for _ in range(_MOST_LEVELS):
        if left.is_empty:
            break
        thin = thin_parts(left, step, _ONE_BEAD * step)
        for part in thin:
            strips += [_middle(line, z) for line in part.lines]
        wide = shapely.difference(left, shapely.union_all([part.area for part in thin])) if thin else left
        following: list[Polygon] = []
        for piece in shapely.get_parts(wide):
            if piece.geom_type != "Polygon":
                continue
            inner = inset(piece, step)
            rings = curves_from_region(inset(piece, 0.5 * step), PATH_TOLERANCE_MM)
            length = sum(ring.curve.length for ring in rings)
            if length <= step:
                over.append(piece)
                continue
            share = (piece.area - inner.area) / length
            strips += [Strip(lifted(ring.curve, z), True, ((0.0, share),)) for ring in rings]
            following += inner.geoms
        left = MultiPolygon(following)
    return strips, MultiPolygon(over)


def _middle(line: MiddleLine, z: float) -> Strip:
    """The strip of a middle line, whose width changes along it."""
    path = line.points[:-1] if line.closed else line.points
    points = np.column_stack([path, np.full(len(path), z)])
    if len(points) == 2:
        curve = Curve.from_polyline(points)
    else:
        curve = interpolate(points, closed=line.closed, corners=by_turning_angle(points, _SMOOTH_DEG, closed=line.closed))
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line.points, axis=0), axis=1))])
    middles = 0.5 * (line.widths_mm[1:] + line.widths_mm[:-1])
    rows: list[tuple[float, float]] = []
    first = 0
    usual = float(line.widths_mm.max())
    for k in range(1, len(middles) + 1):
        if k < len(middles) and np.ptp(middles[first : k + 1]) <= _CHANGE * usual:
            continue
        rows.append((float(at[first]), float(np.average(middles[first:k], weights=np.diff(at[first : k + 1])))))
        first = k
    return Strip(Motion(curve, UP), line.closed, tuple(rows))


def strip_passes(
    strips: list[Strip], area_mm2: float, layer: int, bead: Bead, settings: Settings, relief: Relief | None = None
) -> list[Pass]:
    """The beads of strips, with the metal that an area takes, as far as the material's window allows.

    Starts of closed ones move from layer to layer; open ones run to and fro.
    """
    stood = sum(strip.area_mm2 for strip in strips)
    if stood <= 0.0:
        return []
    beads = _beads(strips, area_mm2, bead, settings)
    passes = []
    for number, (strip, stretches) in enumerate(zip(strips, beads, strict=True)):
        if not strip.closed:
            passes.append(open_bead(strip.motion, bead, settings, stretches, relief))
            continue
        loop = strip.motion if len(stretches) > 1 else spread_start(strip.motion, layer + number)
        passes.append(closed_bead(loop, bead, settings, stretches, relief))
    return passes


def _beads(strips: list[Strip], area_mm2: float, bead: Bead, settings: Settings) -> list[list[Stretch]]:
    """The beads of each strip, with the metal that an area takes in all: where the window has no bead as small or as large as a
    strip wants, the others make up for it. Within a pass beads differ in speed alone."""
    times = area_mm2 / sum(strip.area_mm2 for strip in strips) / bead.step_mm
    found: list[list[Stretch]] = []
    for _ in range(_ROUNDS):
        found, brought = [], 0.0
        for strip in strips:
            alone = len(strip.widths_mm) == 1
            made = [Stretch(at, scaled_bead(bead, times * width, settings, flow_stays=not alone)) for at, width in strip.widths_mm]
            lit = strip.motion.length + (overlap_mm(strip.motion, bead) if strip.closed else 0.0)
            ends = [*(stretch.at_mm for stretch in made[1:]), lit]
            brought += sum((end - stretch.at_mm) * stretch.bead.area_mm2 for stretch, end in zip(made, ends, strict=True))
            found.append(made)
        times *= area_mm2 * bead.height_mm / brought
    return found
