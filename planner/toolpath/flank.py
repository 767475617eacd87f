"""How far the swept flank of an end mill is from the ruled wall that it finishes: what twist of the wall makes of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.collide.gouge import steps_of
from planner.plan import Pass, Wall
from planner.process import Settings
from planner.toolpath.left import Left

Floats = NDArray[np.float64]

_CHORD_MM = 2e-3  # between the finishing pass and the straight steps that it is looked at in
_ACROSS = 3  # points on each ruling
_UNDER_MM = 1e-3  # under the cutter's end: what lies in the end's plane is touched
_WORTH = 0.1  # of the tolerance: a deviation that is worth a word
_ROUND = 100  # rulings of a wall


def flank_deviation(wall: Wall, passes: Sequence[Pass], radius_mm: float) -> tuple[float, float]:
    """Deepest cut into a ruled wall and most metal left on it by the flank of a cutter on its passes, mm, each not less than 0.

    wall : bottom and top on one parameter   Inside corners, which no flank reaches, count as metal left; places under
    the cutter's end count for nothing.
    """
    u = np.linspace(0.0, 1.0, _ROUND, endpoint=False)
    low, high = wall.bottom.evaluate(u), wall.top.evaluate(u)
    share = np.linspace(0.0, 1.0, _ACROSS)[:, None, None]
    points = np.ascontiguousarray((low + share * (high - low)).reshape(-1, 3))
    away = _from_flank(points, np.vstack([steps_of(one, _CHORD_MM) for one in passes]))
    off = away[np.isfinite(away)] - radius_mm
    return float(max(-off.min(initial=0.0), 0.0)), float(max(off.max(initial=0.0), 0.0))


def flank_left(
    walls: Sequence[Wall], passes: Sequence[Pass], z_bottom: float, z_top: float, settings: Settings
) -> list[Left]:
    """How deep the flank cuts into ruled walls between two heights, mm, where that is worth a word."""
    deepest = max(flank_deviation(wall, passes, settings.cutter_radius_mm)[0] for wall in walls)
    worth = deepest > _WORTH * settings.recipe.tolerance_mm
    return [Left("flank", z_bottom, z_top, "", 0, deepest)] if worth else []


@njit(cache=True)
def _from_flank(points: Floats, steps: Floats) -> Floats:  # pragma: no cover
    """(n,) float, mm: least distance of points from the cutter's axis, above its end, on straight steps of it."""
    least = np.empty(len(points))
    for n in range(len(points)):
        best = np.inf
        for s in range(len(steps)):
            step = steps[s]
            t = _nearest_share(points[n], step)
            along, square = 0.0, 0.0
            for i in range(3):
                axis = (1.0 - t) * step[6 + i] + t * step[9 + i]
                off = points[n, i] - (1.0 - t) * step[i] - t * step[3 + i]
                along += off * axis
                square += off * off
            if along > -_UNDER_MM:
                best = min(best, square - along * along)
        least[n] = np.sqrt(max(best, 0.0))
    return least


@njit(cache=True)
def _nearest_share(point: Floats, step: Floats) -> float:  # pragma: no cover
    """Share of a step, 0 … 1, at which its axis, taken as that of its start, comes nearest to a point."""
    way_along, off_along = 0.0, 0.0
    for i in range(3):
        way_along += (step[3 + i] - step[i]) * step[6 + i]
        off_along += (point[i] - step[i]) * step[6 + i]
    up, down = 0.0, 0.0
    for i in range(3):
        across = step[3 + i] - step[i] - way_along * step[6 + i]
        up += across * (point[i] - step[i] - off_along * step[6 + i])
        down += across * across
    return float(min(max(up / down, 0.0), 1.0)) if down > 0.0 else 0.0
