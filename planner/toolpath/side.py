"""Side milling with the flank of an end mill: closed passes round a wall, climb direction, led in and out by arcs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from planner.nurbs.offset import outset
from planner.nurbs.rings import curves_from_region
from planner.plan import Pass
from planner.process import Settings
from planner.toolpath.contour import PATH_TOLERANCE_MM
from planner.toolpath.motion import Motion, joined, lifted, process_pass, quarter_arc, straight

Floats = NDArray[np.float64]

_FINISH_SHARE = 0.2  # of the radial depth: what roughing leaves for the finishing pass
DRAWN_IN_MM = 0.02  # by which what a cutter leaves is drawn in from the walls: rounding of offsets
PAST_START_MM = 1.0  # how far a closed pass runs past its start, so that no witness mark stands
_LEAST_CORNER_MM2 = 0.02  # metal left in an inside corner that is worth a word
_STRETCH_MM = 0.2  # between places at which a cut all round is asked whether it is free
_STRAIGHT_MM = 0.001  # off a straight line: less is none
_TOUCH_MM = 0.02  # how far an arc on or off the wall may dip into what must stand: rounding of offsets


def wall_offsets(excess_mm: float, radial_depth_mm: float) -> list[float]:
    """Distances from the wall, mm, of the passes that remove metal standing out by excess_mm, outside in.

    One pass where a single cut takes it; else cuts of at most the radial depth and a finishing pass of a fifth of it.
    """
    if excess_mm <= radial_depth_mm:
        return [0.0]
    finish = _FINISH_SHARE * radial_depth_mm
    cuts = int(np.ceil((excess_mm - finish) / radial_depth_mm - 1e-9))
    return [finish + (excess_mm - finish) * (cuts - k - 1) / cuts for k in range(cuts)] + [0.0]


@dataclass(frozen=True)
class Unreached:
    """What an end mill leaves outside a region's walls.

    closed : holes and slots that it does not enter, mm   corners : metal left in inside corners, mm
    """

    closed: MultiPolygon
    corners: MultiPolygon


def unreached(region: MultiPolygon, radius_mm: float) -> Unreached:
    """Where a cutter of this radius cannot touch the outline of a region from outside."""
    free = outset(region, radius_mm, 0.005)
    left = shapely.difference(shapely.buffer(free, -radius_mm, quad_segs=64), shapely.buffer(region, DRAWN_IN_MM))
    closed: list[Polygon] = []
    corners: list[Polygon] = []
    for piece in shapely.get_parts(left):
        if piece.geom_type != "Polygon" or piece.area < _LEAST_CORNER_MM2:
            continue
        (closed if piece.area > radius_mm**2 else corners).append(piece)
    return Unreached(MultiPolygon(closed), MultiPolygon(corners))


def upright_passes(region: MultiPolygon, z: float, excess_mm: float, settings: Settings) -> list[Pass]:
    """Passes round walls that run along the build direction, the tip at height z.

    region : what is to stand, mm   excess_mm : metal outside it.
    """
    passes = []
    for leave in wall_offsets(excess_mm, settings.material.milling.radial_depth_mm):
        centre = outset(region, settings.cutter_radius_mm + leave)
        for ring in curves_from_region(centre, PATH_TOLERANCE_MM):
            loop = begun_on_flat(lifted(ring.curve.reversed(), z))
            passes.append(side_pass(loop, centre, excess_mm, settings))
    return passes


def stretch_passes(
    region: MultiPolygon, where: MultiPolygon, z: float, excess_mm: float, settings: Settings
) -> list[Pass]:
    """Upright passes round a region, only where the cutter's centre lies in a region that is not cut all round, mm.

    The rest as for `upright_passes`. Without arcs: they begin and end in air, or where a larger cutter has been.
    """
    row = [0.0, settings.mill_feed_mm_s, 0.0, 0.0, 0.0]
    passes = []
    for leave in wall_offsets(excess_mm, settings.material.milling.radial_depth_mm):
        centre = outset(region, settings.cutter_radius_mm + leave)
        for ring in curves_from_region(centre, PATH_TOLERANCE_MM):
            loop = lifted(ring.curve.reversed(), z)
            passes += [process_pass(motion, row) for motion in stretches_within(loop, where)]
    return passes


def stretches_within(loop: Motion, reach: MultiPolygon) -> list[Motion]:
    """The stretches of a closed motion at constant height that lie in a region, as polylines; the loop if all of it does."""
    points = _dense(loop.tip.evaluate(loop.tip.sample(0.01)))
    shapely.prepare(reach)
    inside = shapely.contains_xy(reach, points[:, 0], points[:, 1])
    if inside.all():
        return [loop]
    if not inside.any():
        return []
    first = int(np.flatnonzero(~inside)[0])
    order = (np.arange(len(points) - 1) + first) % (len(points) - 1)
    found: list[Motion] = []
    run: list[int] = []
    for k in [*order, order[0]]:
        if inside[k]:
            run.append(int(k))
        elif run:
            chain = points[run]
            run = []
            if len(chain) >= 2:
                found.append(straight(_without_straight(chain)))
    return found


def _dense(points: Floats) -> Floats:
    """(m, 3) float   A polyline with points on its straight stretches too, at most a step apart, mm."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    counts = np.maximum(np.ceil(steps / _STRETCH_MM).astype(np.int64), 1)
    at = np.repeat(np.arange(len(counts)), counts)
    share = (np.arange(len(at)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[at]
    return np.vstack([points[at] + share[:, None] * (points[at + 1] - points[at]), points[-1:]])


def _without_straight(points: Floats) -> Floats:
    """(k, 3) float   A polyline at constant height without the points that lie on straight stretches."""
    line = shapely.simplify(shapely.LineString(points[:, :2]), _STRAIGHT_MM)
    kept = shapely.get_coordinates(line)
    return np.column_stack([kept, np.full(len(kept), points[0, 2])])


def side_pass(loop: Motion, keep_out: MultiPolygon, excess_mm: float, settings: Settings) -> Pass:
    """A closed cut with arcs on and off the wall.

    loop : the part on its right (climb milling, spindle clockwise)   keep_out : where the cutter's centre must not go.
    The arcs shrink until they stay outside keep_out; in a narrow hole they vanish and the cutter comes down at the wall.
    """
    row = [0.0, settings.mill_feed_mm_s, 0.0, 0.0, 0.0]
    tail = loop.from_arc(min(PAST_START_MM, 0.2 * loop.length))[0]
    start, _, _, _ = loop.ends()
    _, _, end, _ = tail.ends()
    axis, end_axis = loop.raw_axis_at(loop.tip.domain[0]), tail.raw_axis_at(tail.tip.domain[1])
    ahead_in, ahead_out = loop.tangent(), tail.tangent(at_end=True)
    away_in, away_out = _left_of(ahead_in, axis), _left_of(ahead_out, end_axis)
    for radius in (excess_mm + 1.5, 0.6 * excess_mm + 0.8, 0.5, 0.2):
        corner_in, corner_out = start - radius * ahead_in, end + radius * ahead_out
        arc_in = quarter_arc(corner_in + radius * away_in, corner_in, start, axis)
        arc_out = quarter_arc(end, corner_out, corner_out + radius * away_out, end_axis)
        if _is_clear(arc_in, keep_out) and _is_clear(arc_out, keep_out):
            return process_pass(joined([arc_in, loop, tail, arc_out]), row)
    return process_pass(joined([loop, tail]), row)


def _left_of(tangent: Floats, axis: Floats) -> Floats:
    """The unit vector to the left of the motion, at right angles to the tool axis."""
    left = np.cross(axis, tangent)
    return np.asarray(left / np.linalg.norm(left))


def _is_clear(motion: Motion, keep_out: MultiPolygon) -> bool:
    """Whether the tip of a short motion stays outside a region, seen along the build direction."""
    points = motion.tip.evaluate(np.linspace(*motion.tip.domain, 9))[:, :2]
    inside = shapely.contains_xy(keep_out, points[:, 0], points[:, 1])
    deep = shapely.distance(shapely.points(points[inside]), keep_out.boundary)
    return bool(np.all(deep <= _TOUCH_MM))


def begun_on_flat(loop: Motion) -> Motion:
    """The loop begun in the middle of its longest piece, where arcs on and off have room."""
    reached = loop.tip.arc_length(loop.tip.breaks)
    longest = int(np.argmax(np.diff(reached)))
    return loop.started_at(float(0.5 * (reached[longest] + reached[longest + 1])))


def swept_by(passes: list[Pass], radius_mm: float) -> shapely.Geometry:
    """What the cutter's end covers on its passes, seen along the build direction, mm."""
    lines = [shapely.LineString(p.tip.evaluate(p.tip.sample(0.01))[:, :2]) for p in passes]
    return shapely.union_all(shapely.buffer(lines, radius_mm, quad_segs=32))


def places(region: MultiPolygon) -> str:
    """Where the pieces of a region lie, at most three, in words."""
    points = [shapely.point_on_surface(piece) for piece in list(region.geoms)[:3]]
    return ", ".join(f"({point.x:.1f}, {point.y:.1f})" for point in points)
