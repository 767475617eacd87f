"""Point milling by a ball: row by row down a wall that no flank follows, the axis leaned off the wall where it hangs over."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from planner.collide.cutting_end import CuttingEnd
from planner.collide.gouge import gouge
from planner.errors import FitError
from planner.plan import Pass
from planner.process import Settings
from planner.toolpath.axis import closed_motion
from planner.toolpath.beside import polygons
from planner.toolpath.motion import UP, Motion, process_pass, turning
from planner.toolpath.scallop import Row, Surface
from planner.toolpath.side import begun_on_flat, side_pass, wall_offsets

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

Cut = Callable[[Motion], list[Pass]]
"""Makes passes of a closed motion beside what else stands."""

FLUTES = 3.0  # of the diameter: length of an ordinary ball mill's flutes
_OFF_RAD = np.radians(5.0)  # between axis and wall at least: the flank stays off it
_MOST_RAD = np.radians(65.0)  # of the axis from the build direction
_ROUNDS = 6  # in which a ball that cuts in is pushed out
_TOUCH_MM = 5e-3  # how far the ball may cut in at a pose: rounding of chords
_APART_MM = 1e-3  # poses nearer than this are one
_FEWEST = 8  # poses that still make a path round a wall
_ALLOWED = 0.25  # of the tolerance: how deep a pass may cut anywhere
_PUSHED = 0.25  # of the tolerance: a ball farther off its contact than this leaves metal
_HELD = 0.02  # of a row's poses: if the floor keeps more off the wall, the row is milled otherwise as well


@dataclass(frozen=True)
class Milled:
    """Passes of a ball on a surface.

    missed : heights of rows, mm, from which the floor, or what it would cut, keeps it   pushed_mm : the farthest that inside corners
        keep the ball off the wall, where it does reach   place : (3,) float, mm, of that
    """

    passes: list[Pass]
    missed: list[float]
    pushed_mm: float = 0.0
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)


def ball_passes(surface: Surface, floor_z: float, excess_of: Callable[[Row], float], settings: Settings, cut: Cut | None) -> Milled:
    """The passes on all rows of a surface, from the top, each proved not to cut into what stands.

    floor_z : the ball stays above it, mm   excess_of : metal outside a row's wall, mm, square to it; more than the
    radial depth is cut in several passes   settings : of the ball cutter   cut : where something else stands.
    """
    passes: list[Pass] = []
    missed: list[float] = []
    pushed, place = 0.0, (0.0, 0.0, 0.0)
    for row in surface.rows:
        for leave in wall_offsets(excess_of(row), settings.material.milling.radial_depth_mm):
            found = _row_passes(row, leave, surface, floor_z, settings, cut)
            passes += found.passes
            if leave == 0.0:
                missed += found.missed
                if found.pushed_mm > pushed:
                    pushed, place = found.pushed_mm, found.place
    return Milled(passes, missed, pushed, place)


def _row_passes(row: Row, leave: float, surface: Surface, floor_z: float, settings: Settings, cut: Cut | None) -> Milled:
    """One row at a distance from the wall: with the axis as it leans best, else upright, else not at all."""
    radius = settings.cutter_radius_mm
    centres, free, off = _centres(row, radius, leave, surface, floor_z)
    held = off > _PUSHED * settings.recipe.tolerance_mm
    held &= row.points[:, 2] + (radius + leave) * row.normals[:, 2] < floor_z + radius
    missed = [row.z] if held.sum() > _HELD * len(held) else []
    at = int(np.argmax(np.where(free, off, -1.0)))
    place = (float(row.points[at, 0]), float(row.points[at, 1]), float(row.points[at, 2]))
    if free.sum() < _FEWEST:
        return Milled([], [row.z])
    for axes in _axes(row.normals):
        tips = (centres - radius * axes)[free][::-1]
        for loop in _loops(tips, np.ascontiguousarray(axes[free][::-1])):
            passes = _proved(loop, row, surface, settings, cut)
            if passes:
                return Milled(passes, missed, float(off[at]) if free[at] else 0.0, place)
    return Milled([], [row.z])


def _loops(tips: Floats, axes: Floats) -> Iterator[Motion]:
    """The closed motion through poses, as a smooth curve, then as straight steps, which swing out nowhere."""
    with suppress(FitError):
        yield closed_motion(tips, axes)
    kept = np.linalg.norm(np.roll(tips, -1, axis=0) - tips, axis=1) > _APART_MM
    if kept.sum() >= _FEWEST:
        yield turning(np.vstack([tips[kept], tips[kept][:1]]), np.vstack([axes[kept], axes[kept][:1]]))


def _proved(loop: Motion, row: Row, surface: Surface, settings: Settings, cut: Cut | None) -> list[Pass]:
    """The passes of a closed row with arcs on and off, without them if these cut in; none if the row itself does."""
    end = CuttingEnd(settings.cutter_radius_mm, settings.cutter_radius_mm, FLUTES * settings.cutter_diameter_mm)
    allowed = -_ALLOWED * settings.recipe.tolerance_mm
    plain = [process_pass(loop, [0.0, settings.mill_feed_mm_s, 0.0, 0.0, 0.0])]
    tries = [cut(loop)] if cut is not None else [_led(loop, row, settings), plain]
    for passes in tries:
        if passes and gouge(passes, end, surface.standing, look_mm=allowed).least_mm.min() >= allowed:
            return passes
    return []


def _led(loop: Motion, row: Row, settings: Settings) -> list[Pass]:
    """A closed row with arcs on and off."""
    return [side_pass(begun_on_flat(loop), _beside(row, settings.cutter_radius_mm), 0.0, settings)]


def _beside(row: Row, radius: float) -> MultiPolygon:
    """Where arcs on and off a row do not go, seen along the build direction: the wall's side, and half a radius before it."""
    outline = shapely.make_valid(Polygon(row.points[:, :2]))
    if shapely.LinearRing(row.points[:, :2]).is_ccw:
        return polygons(shapely.buffer(outline, 0.5 * radius))
    return polygons(shapely.buffer(outline, 4.0 * radius) - shapely.buffer(outline, -0.5 * radius))


def outside_row(region: MultiPolygon, row: Row) -> float:
    """How far a region's outline stands out of a row's wall at most, mm, square to the wall."""
    inside = shapely.contains_xy(region, row.points[:, 0], row.points[:, 1])
    away = shapely.distance(shapely.points(row.points[inside, :2]), region.boundary)
    return float((away * np.hypot(row.normals[inside, 0], row.normals[inside, 1])).max(initial=0.0))


def _centres(row: Row, radius: float, leave: float, surface: Surface, floor_z: float) -> tuple[Floats, Flags, Floats]:
    """Ball centres (n, 3) mm that cut into nothing, which of them are free, and how far off its contact each ball stays, mm."""
    reach = radius + leave
    start = row.points + reach * row.normals
    centres = start.copy()
    centres[:, 2] = np.maximum(centres[:, 2], floor_z + radius)
    tree = surface.standing.tree
    for _ in range(_ROUNDS):
        away, facet, foot = tree.nearest(centres)
        near = away < reach - 1e-4
        if not near.any():
            break
        out = (centres[near] - foot[near]) / np.maximum(away[near], 1e-9)[:, None]
        centres[near] = foot[near] + reach * out
        centres[:, 2] = np.maximum(centres[:, 2], floor_z + radius)
    away, facet, foot = tree.nearest(centres)
    place = np.empty(len(tree.order), dtype=np.int64)
    place[tree.order] = np.arange(len(tree.order))
    corners = tree.corners[place[facet]]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outside = ((centres - foot) * outward).sum(axis=1) > 0.0
    off = np.linalg.norm(centres - row.points, axis=1) - reach
    return centres, outside & (away >= reach - _TOUCH_MM) & _goes_on(centres, row.points), np.abs(off)


def _goes_on(centres: Floats, points: Floats) -> Flags:
    """(n,) bool   Which centres go the same way as the contact points: in an inside corner they would turn back."""
    ahead = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    way = np.roll(centres, -1, axis=0) - np.roll(centres, 1, axis=0)
    return np.asarray((ahead * way).sum(axis=1) > -1e-12)


def _axes(normals: Floats) -> Iterator[Floats]:
    """Unit axes (n, 3) to try: upright where the wall leans inward, else leaned off it so that the flank stays clear; leaned
    everywhere as far as it must be somewhere; upright."""
    level = np.hypot(normals[:, 0], normals[:, 1])
    rise = np.arctan2(normals[:, 2], level)
    lean = np.clip(_OFF_RAD - rise, 0.0, _MOST_RAD)
    out = normals[:, :2] / np.maximum(level, 1e-9)[:, None]
    if (most := float(lean.max())) > 0.0:
        for angle in (lean, np.full(len(lean), most)):
            yield np.column_stack([np.sin(angle)[:, None] * out, np.cos(angle)])
    yield np.tile(UP, (len(normals), 1))
