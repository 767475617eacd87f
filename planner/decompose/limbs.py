"""What sticks out of a part: limbs found by sweeping planes (or fronts) from every free end inward until the section leaps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from planner.decompose.fronts import Fronts, fronts
from planner.decompose.occupancy import Occupancy

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_SLENDER = 0.8  # length over diameter of what counts as a limb: a cylinder as high as wide does, a flange does not
_LEAP = 1.5  # growth of the section's radius over its distance, at a root: steeper than a cone of 56 degrees
_LEAP_AREA = 1.3  # growth of its area at least
_EQUAL = 0.3  # of the section's area: what joins with more is no side limb, both end there
_SHARED = 0.2  # of a limb's volume: a limb that another has taken more of is looked for again in what is left
_CUT_SHARE = 1.0  # of its root's cubes: sides that face limbs taken before; more is what is left between them
_TIP_SHARE = 0.1  # of its tip's cubes: a tip that was cut is the rest of a limb taken before
_ROUNDS = 5  # limbs of limbs of limbs


@dataclass(frozen=True, eq=False)
class Limb:
    """cubes : (k,) int64, numbers in the occupancy   root : of them, those next to what it sticks out of

    beyond : (b,) int64   cubes of the larger section that it sticks out of   length_mm : from its root to its end
    area_mm2 : of its sections, in the middle   tip : cubes of its outer quarter
    """

    cubes: NDArray[np.int64]
    root: NDArray[np.int64]
    beyond: NDArray[np.int64]
    tip: NDArray[np.int64]
    length_mm: float
    area_mm2: float

    @property
    def slender(self) -> float:
        """Length over the diameter of a circle with its section's area."""
        return self.length_mm / (2.0 * float(np.sqrt(self.area_mm2 / np.pi)))


def limbs(body: Occupancy, axes: Floats) -> tuple[list[Limb], Flags]:
    """Limbs of a part, the most slender first, and what is left of it: (n,) bool.

    axes : (3, 3) float   unit directions of the grid: planes are swept along them, both ways
    """
    left = np.ones(len(body.centres), dtype=np.bool_)
    heights = [sign * (body.centres @ axis) for axis in axes for sign in (1.0, -1.0)]
    made: list[Limb] = []
    for _ in range(_ROUNDS):
        taken = _round(body, heights, left)
        if not taken:
            break
        made += taken
    return made, left


def _round(body: Occupancy, quantities: Sequence[Floats], left: Flags) -> list[Limb]:
    """Limbs of what is left; `left` loses them. One whose section leaps only because of a more slender one is none."""
    found = [limb for quantity in quantities for limb in _sweep(body, fronts(body, quantity, left, 1.0))]
    found.sort(key=lambda limb: (-round(limb.slender, 3), int(limb.cubes[0])))
    made = []
    for limb in found:
        free = left[limb.cubes]
        if free.mean() < 1.0 - _SHARED or left[limb.beyond].sum() < _LEAP_AREA * len(limb.root):
            continue
        if _cuts(body, limb.cubes, left) > _CUT_SHARE * len(limb.root):
            continue
        if _cuts(body, limb.tip, left) > _TIP_SHARE * len(limb.tip):
            continue
        made.append(replace(limb, cubes=limb.cubes[free], root=limb.root[left[limb.root]]))
        left[limb.cubes] = False
    return made


def _cuts(body: Occupancy, cubes: NDArray[np.int64], left: Flags) -> float:
    """Sides of the cubes that face what was taken before: a limb has none, what is left between limbs has many."""
    across = body.links[cubes]
    return float(((across >= 0) & ~left[across]).sum())


def _sweep(body: Occupancy, graph: Fronts) -> list[Limb]:
    """Limbs that one sweep finds: from every highest front downwards."""
    below, above = graph.neighbours()
    order = np.argsort(graph.part, kind="stable")
    starts = np.searchsorted(graph.part[order], np.arange(len(graph.band) + 1))
    made = []
    for tip in (piece for piece in range(len(graph.band)) if not above[piece]):
        levels = _descent(graph, tip, below, above)
        if levels is None:
            continue
        pieces = [piece for level in levels for piece in level]
        cubes = np.sort(np.concatenate([order[starts[piece] : starts[piece + 1]] for piece in pieces]))
        root = order[starts[levels[-1][0]] : starts[levels[-1][0] + 1]]
        beyond = {piece for member in levels[-1] for piece in below[member]}
        beyond = max((beyond, {piece for member in beyond for piece in below[member]}), key=lambda s: _area(graph, s))
        cubes_beyond = np.concatenate([order[starts[piece] : starts[piece + 1]] for piece in sorted(beyond)])
        areas = [_area(graph, level) for level in levels]
        outer = [piece for level in levels[: max(len(levels) // 4, 2)] for piece in level]
        top = np.concatenate([order[starts[piece] : starts[piece + 1]] for piece in outer])
        limb = Limb(cubes, root, cubes_beyond, top, len(levels) * graph.step_mm, float(np.median(areas)))
        if limb.slender >= _SLENDER:
            made.append(limb)
    return made


def _area(graph: Fronts, level: Iterable[int]) -> float:
    """Area of the fronts of one level, mm²."""
    return float(sum(graph.area_mm2[piece] for piece in level))


def _descent(graph: Fronts, tip: int, below: list[list[int]], above: list[list[int]]) -> list[list[int]] | None:
    """Fronts of a limb, level after level from its tip to its root; None where nothing tells a root.

    It ends where something as large joins, or at the first leap of a section that had settled; a leap at a rounded tip, whose
    section still grows, is none. A front that splits and closes again goes round a hole.
    """
    levels: list[list[int]] = [[tip]]
    radii: list[float] = []
    while True:
        here = levels[-1]
        following = sorted({piece for member in here for piece in below[member]})
        area = _area(graph, here)
        radii.append(float(np.sqrt(area / np.pi)))
        if not following:
            return None
        joining = sorted({piece for member in following for piece in above[member]} - set(here))
        if _area(graph, joining) > _EQUAL * area:
            return levels if len(here) == 1 and len(levels) > 1 else None
        settled = len(radii) > 3 and radii[-1] - radii[-4] < 1.5 * graph.step_mm
        if len(here) == 1 and settled and _leaps(graph, levels[-1], following, below):
            return levels if len(levels) * graph.step_mm >= _SLENDER * 2.0 * radii[-1] else None
        levels.append(following)


def _leaps(graph: Fronts, level: list[int], following: list[int], below: list[list[int]]) -> bool:
    """Whether the section grows by a leap over the next two levels."""
    area = _area(graph, level)
    beyond = {piece for member in following for piece in below[member]}
    for count, pieces in ((1, following), (2, sorted(beyond))):
        grown = _area(graph, pieces)
        gain = np.sqrt(grown / np.pi) - np.sqrt(area / np.pi)
        if grown > _LEAP_AREA * area and gain > _LEAP * count * graph.step_mm:
            return True
    return False
