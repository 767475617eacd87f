"""Side walls as ruled surfaces: which loop of one section belongs to which of another, and whether lines join them."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.mesh.mesh import Mesh
from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate
from planner.nurbs.knots import multiplicity
from planner.plan import Wall
from planner.slicing.contours import section_curves
from planner.slicing.section import Section

Floats = NDArray[np.float64]

_STEP_MM = 0.5  # between the points that walls are matched at


def ruled_walls(bottom: Section, top: Section, mesh: Mesh) -> tuple[Wall, ...]:
    """Walls between two sections whose loops correspond one to one; empty where they do not.

    Loops belong together by sense and nearness; on them, corners where there are equally many, else equal shares of
    the length from the nearest points on. Source: paper Eq. 19.
    """
    if not bottom.loops or len(bottom.loops) != len(top.loops):
        return ()
    lower = [curve for curve, _ in section_curves(bottom, mesh)]
    upper = [curve for curve, _ in section_curves(top, mesh)]
    partner = _partners(bottom, top)
    if len(set(partner)) != len(partner):
        return ()
    return tuple(matched_wall(curve, upper[other]) for curve, other in zip(lower, partner, strict=True))


def _partners(bottom: Section, top: Section) -> list[int]:
    """For each loop of the bottom the nearest loop of the same sense of the top."""
    rings = [shapely.LinearRing(loop.xy) for loop in top.loops]
    partner = []
    for loop in bottom.loops:
        ring = shapely.LinearRing(loop.xy)
        same = [k for k, other in enumerate(top.loops) if other.is_hole == loop.is_hole]
        if not same:
            return [0, 0]
        partner.append(min(same, key=lambda k: float(shapely.hausdorff_distance(ring, rings[k]))))
    return partner


def matched_wall(lower: Curve, upper: Curve) -> Wall:
    """The wall between two closed curves in space, both led through points that belong together."""
    marks_low, marks_high = _corner_arcs(lower), _corner_arcs(upper)
    if len(marks_low) and len(marks_low) == len(marks_high):
        first, second = lower.evaluate(lower.at_arc_length(marks_low)), upper.evaluate(upper.at_arc_length(marks_high))
        shift = min(
            range(len(marks_low)), key=lambda k: float(np.linalg.norm(first - np.roll(second, -k, axis=0), axis=1).sum())
        )
        marks_high = np.roll(marks_high, -shift)
        has_corners = True
    else:
        has_corners = False
        marks_low = np.zeros(1)
        arcs = np.linspace(0.0, upper.length, 2000, endpoint=False)
        away = upper.evaluate(upper.at_arc_length(arcs))[:, :2] - lower.evaluate([0.0])[0, :2]
        marks_high = arcs[[int(np.argmin((away**2).sum(axis=1)))]]
    arcs_low, arcs_high, corner = _common_arcs(marks_low, lower.length, marks_high, upper.length, has_corners)
    points_low = lower.evaluate(lower.at_arc_length(arcs_low))
    points_high = upper.evaluate(upper.at_arc_length(arcs_high))
    return Wall(
        interpolate(points_low, closed=True, corners=corner), interpolate(points_high, closed=True, corners=corner)
    )


def _corner_arcs(curve: Curve) -> Floats:
    """Arc lengths of the curve's corners, increasing."""
    inner = [u for u in curve.breaks[:-1] if u == 0.0 or multiplicity(curve.knots, float(u)) >= curve.degree]
    arcs = []
    for u in inner:
        before = curve.derivatives([curve.domain[1] if u == 0.0 else u], 1, "left")[1][0]
        after = curve.derivatives([u], 1)[1][0]
        cosine = float(before @ after / max(np.linalg.norm(before) * np.linalg.norm(after), 1e-300))
        if cosine < np.cos(np.radians(5.0)):
            arcs.append(float(curve.arc_length([u])[0]))
    return np.array(arcs)


def _common_arcs(
    marks_low: Floats, length_low: float, marks_high: Floats, length_high: float, has_corners: bool
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Arc lengths on both curves of points that belong together, and which of them are corners: (n,) each."""
    pieces_low = np.append(marks_low, marks_low[0] + length_low)
    pieces_high = marks_high.copy()
    pieces_high[pieces_high < pieces_high[0]] += length_high
    pieces_high = np.append(pieces_high, pieces_high[0] + length_high)
    low, high, corner = [], [], []
    for k in range(len(marks_low)):
        span = pieces_low[k + 1] - pieces_low[k]
        count = max(int(np.ceil(span / _STEP_MM)), 2 if has_corners else 24)
        share = np.arange(count) / count
        low.append(pieces_low[k] + share * span)
        high.append(pieces_high[k] + share * (pieces_high[k + 1] - pieces_high[k]))
        corner.append((share == 0.0) & has_corners)
    return np.concatenate(low) % length_low, np.concatenate(high) % length_high, np.concatenate(corner)


def wall_error(walls: tuple[Wall, ...], area: MultiPolygon, share: float) -> float:
    """Largest distance, mm, of the walls from a section between their ends, in its plane.

    share : of the height at which the section lies.
    """
    worst = 0.0
    outline = area.boundary
    shapely.prepare(outline)
    for wall in walls:
        u = np.linspace(0.0, 1.0, max(50, int(wall.bottom.length / _STEP_MM)))
        points = (1.0 - share) * wall.bottom.evaluate(u) + share * wall.top.evaluate(u)
        worst = max(worst, float(shapely.distance(outline, shapely.points(points[:, :2])).max()))
    return worst
