"""Rings and tubes: one bead from the outer to the inner outline, round after round, each joined to the next by a short oblique way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from planner.nurbs.curve import Curve
from planner.nurbs.offset import inset
from planner.nurbs.rings import curves_from_region
from planner.plan import Pass
from planner.process import Bead, Settings
from planner.toolpath.contour import PATH_TOLERANCE_MM, edge_mm, open_bead, spread_start
from planner.toolpath.fitting import Stretch, scaled_bead
from planner.toolpath.motion import Motion, joined, lifted
from planner.toolpath.relief import Relief

Floats = NDArray[np.float64]

_EVEN = 0.1  # of the step: how much the width of a ring may vary
_LINK = 1.0  # of the bead's width: length of the way from one round to the next
_LEAST_ROUND = 4.0  # of that: shorter rounds are no rings
_TOGETHER = 0.6  # of a bead's metal: where one round begins, and the last one ends, beside the way to the next


@dataclass(frozen=True, eq=False)
class Annulus:
    """A ring between two outlines at one distance.  outer : what the outer one encloses   across_mm : that distance."""

    outer: Polygon
    across_mm: float


def annulus_of(part: Polygon, step_mm: float) -> Annulus | None:
    """A region as a ring of even width; None where it is none."""
    if len(part.interiors) != 1:
        return None
    outer, inner = part.exterior, part.interiors[0]
    across = np.asarray(shapely.distance(shapely.points(shapely.get_coordinates(outer)), inner))
    back = np.asarray(shapely.distance(shapely.points(shapely.get_coordinates(inner)), outer))
    least, most = min(across.min(), back.min()), max(across.max(), back.max())
    if most - least > _EVEN * step_mm:
        return None
    return Annulus(Polygon(outer), float(0.5 * (least + most)))


def spiral_passes(
    part: Polygon, z: float, layer: int, bead: Bead, settings: Settings, relief: Relief | None = None
) -> list[Pass]:
    """One bead that fills a ring of even width; none where the region is no such ring.

    part : region to fill, allowance and edge strip included, mm   z : of the surface that receives the bead
    relief : of the layer, where it is not equally high everywhere. The first round lies half a width inside the outer
    outline, the last one half a width inside the inner one, the others evenly between; every other layer runs outward.
    """
    ring = annulus_of(part, bead.step_mm)
    if ring is None or ring.across_mm < bead.width_mm + 0.5 * bead.step_mm:
        return []
    between = ring.across_mm - bead.width_mm
    gaps = max(1, round(between / bead.step_mm))
    depths = 0.5 * bead.width_mm + between / gaps * np.arange(gaps + 1)
    loops = [_loop(ring.outer, float(depth), z) for depth in depths]
    if any(loop is None or loop.length < _LEAST_ROUND * _LINK * bead.width_mm for loop in loops):
        return []
    edges = np.concatenate([[edge_mm(bead, settings)], 0.5 * (depths[1:] + depths[:-1]), [ring.across_mm - edge_mm(bead, settings)]])
    enclosed = np.array([inset(ring.outer, float(edge)).area if edge > 0.0 else ring.outer.area for edge in edges])
    rounds = [loop for loop in loops if loop is not None]
    areas = -np.diff(enclosed)
    if not settings.is_milled:  # beads of one size: what lies outside the outermost middle is theirs together
        lengths = np.array([loop.length for loop in rounds])
        areas = areas.sum() * lengths / lengths.sum()
    if layer % 2:
        rounds, areas = rounds[::-1], areas[::-1]
    return [_through(rounds, areas, layer, bead, settings, relief)]


def _loop(outer: Polygon, depth_mm: float, z: float) -> Motion | None:
    rings = curves_from_region(inset(outer, depth_mm), PATH_TOLERANCE_MM)
    return lifted(rings[0].curve, z) if len(rings) == 1 else None


def _through(
    rounds: list[Motion], areas: Floats, layer: int, bead: Bead, settings: Settings, relief: Relief | None
) -> Pass:
    """The bead through all rounds.

    The first begins a link's length before the place where it is left, and the last one ends where it was reached, so that
    beside each link there is half a bead too much: there the bead brings less.
    """
    link = _LINK * bead.width_mm
    first = spread_start(rounds[0], layer)
    pieces: list[Motion] = [first]
    stretches: list[Stretch] = []
    at = 0.0
    for number, (loop, area) in enumerate(zip(rounds, areas, strict=True)):
        made = scaled_bead(bead, float(area) / loop.length / bead.step_mm, settings, flow_stays=True)
        less = scaled_bead(bead, _TOGETHER * float(area) / loop.length / bead.step_mm, settings, flow_stays=True)
        if number == 0:
            stretches += [Stretch(0.0, less), Stretch(link, made)]
            at = first.length
            continue
        start = _begun_beside(loop, pieces[-1].ends()[2], link)
        pieces += [_link(pieces[-1], start), start]
        at += pieces[-2].length
        stretches.append(Stretch(at - 0.5 * pieces[-2].length, made))
        if number < len(rounds) - 1:
            pieces[-1] = start.from_arc(start.length - link)[0]
        at += pieces[-1].length
        if number == len(rounds) - 1:
            stretches.append(Stretch(at - link, less))
    return open_bead(joined(pieces), bead, settings, stretches, relief)


def _begun_beside(loop: Motion, place: Floats, ahead_mm: float) -> Motion:
    """A closed motion begun so far ahead of its point nearest to a place."""
    arcs = np.linspace(0.0, loop.length, max(64, int(loop.length / 0.2)), endpoint=False)
    points = loop.tip.evaluate(loop.tip.at_arc_length(arcs))
    nearest = float(arcs[int(np.argmin(np.linalg.norm(points - place, axis=1)))])
    return loop.started_at((nearest + ahead_mm) % loop.length)


def _link(before: Motion, after: Motion) -> Motion:
    """A cubic from the end of one motion to the start of another, tangent to both."""
    start, end = before.ends()[2], after.ends()[0]
    handle = np.linalg.norm(end - start) / 3.0
    net = np.array([start, start + handle * before.tangent(at_end=True), end - handle * after.tangent(), end])
    return Motion(Curve(3, np.array([0.0] * 4 + [1.0] * 4), net), after.axis_at(after.tip.domain[0]))
