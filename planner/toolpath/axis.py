"""The tool axis along leaning walls: the flank of the cutter on the rulings between two contours."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import shapely
from numba import njit
from numpy.typing import NDArray
from shapely import MultiPolygon

from planner.nurbs.curve import Curve
from planner.nurbs.fit import interpolate
from planner.plan import Wall
from planner.process import Settings
from planner.slicing.regions import LayerRegion
from planner.toolpath.motion import Motion
from planner.toolpath.side import wall_offsets

Floats = NDArray[np.float64]

DepthAt = Callable[[Floats, Floats, Floats, float], Floats]
"""Tips at the bottom's height (n, 3) mm, unit axes and unit normals of the wall (n, 3), distance of the cutter's axis from
the wall, mm: depths (n,), mm."""

STEEPEST_AXIS = 0.35
"""Least z of a ruling that the flank follows: beyond 70 degrees from the build direction a wall is a ledge."""
_STEP_MM = 0.5  # between points round a wall; the curve through them is within 1e-4 mm at radii above 1 mm
_GOUGE_MM = 5e-3  # how far the flank may cut into the wall elsewhere: points of the path that do are left out
_FOLLOWS_MM = 0.02  # how far rulings drawn on may cut into the wall below: a fifth of the usual tolerance
_FEWEST = 8  # poses that still make a path round a wall
_JUMP_RAD = np.radians(20.0)  # between neighbouring poses: more is no ruling that changes, but another wall
_CORNER = np.cos(np.radians(1.0))  # directions of a wall that turn more at one place make a corner
_STANDS_MM = 1e-3  # a tip that comes no farther from its middle stands still: the bore is as wide as the cutter
_TURN = np.cos(np.radians(25.0))  # tip paths that turn more from point to point have a corner there


def ruled_motions(
    wall: Wall,
    excess_mm: float,
    below_mm: float,
    floor_z: float | None,
    settings: Settings,
    others: Sequence[Wall] = (),
    *,
    depth_at: DepthAt | None = None,
) -> list[Motion]:
    """Closed tip curves with their axes along one ruled wall, outside in, the part on the right (climb milling).

    wall : bottom and top with the part on their left   below_mm : how far the flank reaches under the bottom
    floor_z : the cutter's end stays above it; None: free below   others : walls that it must not cut either
    depth_at : how far each pose may reach under the bottom, in place of below_mm.
    Tip = bottom point + (radius + what is left) x normal, axis = ruling: the flank touches the whole ruling. Points at
    which it would cut into the wall elsewhere (inside corners) are left out. Empty if nothing is left, if the tip would
    stand still (a bore as wide as the cutter), if the axis would have to jump, or if the way past what is left out
    would cut a wall.
    """
    count = max(24, int(np.ceil(max(wall.bottom.length, wall.top.length) / _STEP_MM)))
    u, along = _places(wall, count)
    low, high = wall.bottom.evaluate(u), wall.top.evaluate(u)
    axis = (high - low) / np.linalg.norm(high - low, axis=1)[:, None]
    normal = np.cross(along, axis)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    low, axis, normal = _with_corner_turns(low, axis, normal)
    radius = settings.cutter_radius_mm
    stands = np.vstack([low, high, *(_ends_of(other) for other in others)])
    motions = []
    for leave in wall_offsets(excess_mm, settings.material.milling.radial_depth_mm):
        under = (
            below_mm if depth_at is None else depth_at(low + (radius + leave) * normal, axis, normal, radius + leave)
        )
        tip = low + (radius + leave) * normal - (under / axis[:, 2])[:, None] * axis
        if floor_z is not None:
            dip = radius * np.hypot(axis[:, 0], axis[:, 1])
            tip = tip + (np.maximum(floor_z - (tip[:, 2] - dip), 0.0) / axis[:, 2])[:, None] * axis
        free = _is_free(tip, axis, stands, radius + leave)
        if free.sum() < _FEWEST or not _bridges_free(tip, axis, free, stands, radius):
            continue
        moves = free & (np.linalg.norm(tip - tip[free].mean(axis=0), axis=1) > _STANDS_MM)
        if moves.sum() >= _FEWEST and _largest_turn(axis[free]) <= _JUMP_RAD:
            motions.append(closed_motion(tip[free][::-1], axis[free][::-1]))
    return motions


def steepest_lean(wall: Wall) -> float:
    """Largest tangent of the angle between the wall's rulings and the build direction."""
    u = np.linspace(0.0, 1.0, 200)
    ruling = wall.top.evaluate(u) - wall.bottom.evaluate(u)
    return float((np.hypot(ruling[:, 0], ruling[:, 1]) / ruling[:, 2]).max())


def leans_inward(wall: Wall) -> bool:
    """Whether the wall comes nearer to the part's inside towards its top: metal laid above it can run down on it."""
    u = np.linspace(0.0, 1.0, 50)
    low, along, high = wall.bottom.evaluate(u), wall.bottom.derivatives(u, 1)[1], wall.top.evaluate(u)
    outward = np.column_stack([along[:, 1], -along[:, 0]])
    return bool(((high - low)[:, :2] * outward).sum() < 0.0)


def goes_on_below(wall: Wall, depth_mm: float, below: Sequence[LayerRegion]) -> bool:
    """Whether the rulings, drawn on under the wall's bottom, stay out of all layers that lie within a depth.

    depth_mm : how far, along the build direction   below : all layers under the wall, from the lowest.
    The sections of every layer down to the depth are looked at; half a layer tells for less.
    """
    u = np.linspace(0.0, 1.0, max(50, int(wall.bottom.length / _STEP_MM)))
    low = wall.bottom.evaluate(u)
    slope = (wall.top.evaluate(u) - low)[:, :2] / (wall.top.evaluate(u) - low)[:, 2:]
    start = below[-1].z_top
    for layer in reversed(below):
        for height, section in ((0.5 * (layer.z_bottom + layer.z_top), 1), (layer.z_bottom, 0)):
            down = start - height
            if section == 0 and down > depth_mm + 1e-9:
                continue
            points = low[:, :2] - down * slope
            if _deepest(points, layer.areas[section]) * max(1.0, min(depth_mm, layer.height_mm) / down) > _FOLLOWS_MM:
                return False
        if start - layer.z_bottom >= depth_mm:
            break
    return True


def _deepest(points: Floats, area: MultiPolygon) -> float:
    """How deep points lie inside a region at most, mm.  points : (n, 2) float, mm"""
    inside = shapely.contains_xy(area, points[:, 0], points[:, 1])
    if not inside.any():
        return 0.0
    return float(shapely.distance(shapely.points(points[inside]), area.boundary).max())


def ends_clear(motions: list[Motion], depth_mm: float, below: Sequence[LayerRegion], radius_mm: float) -> bool:
    """Whether the cutter's end, let down by a depth under a wall that leans inward, meets no other part of the layers there."""
    start = below[-1].z_top
    heights = [(layer.z_top, layer.areas[2]) for layer in below] + [(layer.z_bottom, layer.areas[0]) for layer in below]
    near = [area for height, area in heights if height >= start - depth_mm]
    for motion in motions:
        u = motion.tip.sample(0.01)
        flattest = min(float(motion.axis_at(value)[2]) for value in u[:: max(1, len(u) // 50)])
        line = shapely.LineString(motion.tip.evaluate(u)[:, :2])
        reached = radius_mm * flattest - _FOLLOWS_MM
        if any(shapely.dwithin(line, area, reached) for area in near):
            return False
    return True


def _places(wall: Wall, count: int) -> tuple[Floats, Floats]:
    """Parameters round a wall, (n,), and the bottom's direction there, (n, 3): a corner twice, as it is met and as it is left.

    Places at which the bottom stands still, because a speck of the top faces one point of it, are left out.
    """
    breaks = wall.bottom.breaks
    u = np.unique(np.concatenate([np.linspace(0.0, 1.0, count + 1), breaks]))[:-1]
    ahead = wall.bottom.derivatives(u, 1)[1]
    moves = np.linalg.norm(ahead, axis=1) > 0.0
    u, ahead = u[moves], ahead[moves]
    met = np.append(breaks[1:-1], 1.0)
    left = np.append(breaks[1:-1], 0.0)
    before = wall.bottom.derivatives(met, 1, "left")[1]
    after = wall.bottom.derivatives(left, 1)[1]
    speeds = np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)
    is_corner = (speeds > 0.0) & ((before * after).sum(axis=1) < _CORNER * speeds)
    at = np.searchsorted(u, left[is_corner])
    return np.insert(u, at, left[is_corner]), np.insert(ahead, at, before[is_corner], axis=0)


def _largest_turn(axis: Floats) -> float:
    """Largest angle between neighbouring axes of a closed path, rad.  axis : (n, 3) float, unit."""
    step = np.linalg.norm(np.roll(axis, -1, axis=0) - axis, axis=1)
    return float(2.0 * np.arcsin(np.minimum(0.5 * step.max(), 1.0)))


def _with_corner_turns(low: Floats, axis: Floats, normal: Floats) -> tuple[Floats, Floats, Floats]:
    """Where the wall's normal jumps (an outside corner), the cutter rolls round it: points at 8 degrees are added."""
    following = np.roll(normal, -1, axis=0)
    gap = np.degrees(np.arccos(np.clip((normal * following).sum(axis=1), -1.0, 1.0)))
    extra = np.where(gap > 16.0, np.ceil(gap / 8.0).astype(int) - 1, 0)
    owner = np.repeat(np.arange(len(low)), extra + 1)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(extra + 1) - extra - 1, extra + 1)
    share = (place / (extra[owner] + 1.0))[:, None]
    after = (owner + 1) % len(low)

    def between(values: Floats) -> Floats:
        return np.asarray((1.0 - share) * values[owner] + share * values[after])

    turned, ruled = between(normal), between(axis)
    turned -= (turned * ruled).sum(axis=1)[:, None] * ruled / (ruled**2).sum(axis=1)[:, None]
    return (
        between(low),
        ruled / np.linalg.norm(ruled, axis=1)[:, None],
        turned / np.linalg.norm(turned, axis=1)[:, None],
    )


def _is_free(tip: Floats, axis: Floats, wall: Floats, radius_mm: float) -> NDArray[np.bool_]:
    """At which poses all wall points keep the radius from the cutter's axis: (n,) bool.

    wall : (m, 3) float, mm, points of the wall's bottom and top.
    """
    reach_mm = float(np.ptp(wall[:, 2]) + 3.0 * radius_mm)  # of the cutter
    tips, axes, points = (np.ascontiguousarray(array) for array in (tip, axis, wall))
    return np.asarray(_keeps_clear(tips, axes, points, radius_mm - _GOUGE_MM, reach_mm))


@njit(cache=True)
def _keeps_clear(
    tip: Floats, axis: Floats, wall: Floats, radius_mm: float, reach_mm: float
) -> NDArray[np.bool_]:  # pragma: no cover
    """Which poses have no wall point within the radius of the axis above the tip, and within the reach of it: (n,) bool."""
    free = np.ones(tip.shape[0], np.bool_)
    for k in range(tip.shape[0]):
        for w in range(wall.shape[0]):
            along, away2 = 0.0, 0.0
            for i in range(3):
                away = wall[w, i] - tip[k, i]
                along += away * axis[k, i]
                away2 += away * away
            if away2 <= reach_mm * reach_mm and along > -_GOUGE_MM and away2 - along * along < radius_mm * radius_mm:
                free[k] = False
                break
    return free


def _ends_of(wall: Wall) -> Floats:
    """(n, 3) float, mm   Points of a wall's bottom and top."""
    u = np.linspace(0.0, 1.0, max(24, int(np.ceil(wall.bottom.length / _STEP_MM))), endpoint=False)
    return np.vstack([wall.bottom.evaluate(u), wall.top.evaluate(u)])


def _bridges_free(tip: Floats, axis: Floats, free: NDArray[np.bool_], wall: Floats, radius_mm: float) -> bool:
    """Whether the cutter cuts no wall on the straight ways between poses that are left where others are left out."""
    kept = np.flatnonzero(free)
    following = np.roll(kept, -1)
    gaps = (following - kept) % len(tip) > 1
    share = np.linspace(0.1, 0.9, 9)[:, None, None]
    first, last = kept[gaps], following[gaps]
    tips = (tip[first] + share * (tip[last] - tip[first])).reshape(-1, 3)
    axes = (axis[first] + share * (axis[last] - axis[first])).reshape(-1, 3)
    if not len(tips):
        return True
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    return bool(_is_free(tips, axes, wall, radius_mm - _FOLLOWS_MM).all())


def closed_motion(tips: Floats, axes: Floats) -> Motion:
    """A closed motion through tips with their axes, (n, 3) float each."""
    kept = np.linalg.norm(np.roll(tips, -1, axis=0) - tips, axis=1) > 1e-4
    tips, axes = tips[kept], axes[kept]
    chords = np.roll(tips, -1, axis=0) - tips
    chords /= np.linalg.norm(chords, axis=1)[:, None]
    corner = (chords * np.roll(chords, 1, axis=0)).sum(axis=1) < _TURN
    tip = interpolate(tips, closed=True, corners=corner)
    knots = np.concatenate([tip.breaks[:1], tip.breaks, tip.breaks[-1:]])
    return Motion(tip, Curve(1, knots, np.vstack([axes, axes[:1]])))
