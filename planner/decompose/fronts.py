"""Fronts that run through a part's cubes: shortest ways inside the part, and the connected pieces of each front as a graph."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.decompose.occupancy import Links, Occupancy

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FRONT_CUBES = 2.0
"""Thickness of a front in cubes: above √3, so that an oblique plane of cubes hangs together over their sides, and whole, so
that fronts along the grid hold the same number of layers."""


_OFF_LATTICE = 0.125  # of a front: layers of the grid fall between the levels, not on them


@dataclass(frozen=True, eq=False)
class Fronts:
    """Connected pieces of the level sets of one quantity (Reeb graph).

    part : (n,) int64   piece of each cube, -1 where left out   band : (p,) int64   level of each piece
    centre : (p, 3) float, mm   area_mm2 : (p,) float, volume over thickness   edges : (m, 2) int64   pieces that touch, lower
    level first   step_mm : thickness   body : the cubes
    """

    part: Ints
    band: Ints
    centre: Floats
    area_mm2: Floats
    edges: Ints
    step_mm: float
    body: Occupancy

    def width_mm(self, piece: int) -> float:
        """Diameter of the disc that spreads as far as the piece does along its longest direction."""
        away = self.body.centres[self.part == piece] - self.centre[piece]
        return float(4.0 * np.sqrt(max(np.linalg.eigvalsh(away.T @ away / len(away))[-1], 0.0)))

    def neighbours(self) -> tuple[list[list[int]], list[list[int]]]:
        """Pieces one level below and above each piece, ascending."""
        below: list[list[int]] = [[] for _ in range(len(self.band))]
        above: list[list[int]] = [[] for _ in range(len(self.band))]
        for low, high in self.edges.tolist():
            above[low].append(high)
            below[high].append(low)
        return below, above


def fronts(
    body: Occupancy, quantity_mm: Floats, keep: NDArray[np.bool_] | None = None, cubes: float = FRONT_CUBES
) -> Fronts:
    """Fronts of a quantity that changes by one mm per mm at most.

    quantity_mm : (n,) float, one per cube   keep : (n,) bool, cubes that count; None: all
    cubes : thickness of a front; 1 is enough for planes along the grid
    """
    step = cubes * body.cube_mm
    kept = np.isfinite(quantity_mm) if keep is None else keep & np.isfinite(quantity_mm)
    lowest = float(quantity_mm[kept].min()) if kept.any() else 0.0
    level = np.full(len(quantity_mm), -1, dtype=np.int64)
    level[kept] = np.floor((quantity_mm[kept] - lowest) / step + _OFF_LATTICE).astype(np.int64)
    part, count, pairs = _flood(level, body.links)
    inside = np.flatnonzero(part >= 0)
    number = part[inside]
    size = np.bincount(number, minlength=count).astype(np.float64)
    centre = np.column_stack([np.bincount(number, body.centres[inside, k], count) for k in range(3)]) / size[:, None]
    band = np.zeros(count, dtype=np.int64)
    band[number] = level[inside]
    edges = np.unique(pairs, axis=0).reshape(-1, 2)
    return Fronts(part, band, centre, size * body.cube_mm**3 / step, edges, step, body)


def ways_inside(body: Occupancy, sources: NDArray[np.bool_]) -> Floats:
    """(n,) float, mm: length of the shortest way inside the part from the sources to each cube; inf where there is none.

    Fast marching, first order (Sethian, A fast marching level set method, PNAS 93 (1996) 1591).
    """
    return np.asarray(_march(body.links, sources) * body.cube_mm)


@njit(cache=True)
def _flood(level: Ints, links: Links) -> tuple[Ints, int, Ints]:  # pragma: no cover
    """Number of the connected piece of equal level of each cube, in the order of its first cube; -1 for level -1.

    Also how many pieces there are, and (m, 2) int64 pairs of pieces that touch, lower level first; some more than once.
    """
    part = np.full(level.shape[0], -1, np.int64)
    stack = np.empty(level.shape[0], np.int64)
    count = 0
    for first in range(level.shape[0]):
        if level[first] < 0 or part[first] >= 0:
            continue
        part[first] = count
        stack[0], top = first, 1
        while top > 0:
            top -= 1
            here = stack[top]
            for k in range(6):
                other = links[here, k]
                if other >= 0 and part[other] < 0 and level[other] == level[first]:
                    part[other] = count
                    stack[top] = other
                    top += 1
        count += 1
    latest = np.full(count, -1, np.int64)
    pairs, found = np.empty((6 * level.shape[0], 2), np.int64), 0
    for here in range(level.shape[0]):
        for k in range(6):
            other = links[here, k]
            if part[here] < 0 or other < 0 or part[other] < 0 or level[here] >= level[other]:
                continue
            if latest[part[here]] != part[other]:
                latest[part[here]] = part[other]
                pairs[found, 0], pairs[found, 1] = part[here], part[other]
                found += 1
    return part, count, pairs[:found].copy()


@njit(cache=True)
def _solved(links: Links, ways: Floats, cube: int) -> float:  # pragma: no cover
    """Way to a cube from the nearer neighbour along each axis: root of Σ (w - w_k)² = 1 over those below it."""
    least = np.empty(3)
    for axis in range(3):
        low, high = links[cube, 2 * axis], links[cube, 2 * axis + 1]
        least[axis] = min(ways[low] if low >= 0 else np.inf, ways[high] if high >= 0 else np.inf)
    least.sort()
    result = least[0] + 1.0
    total, squares = least[0], least[0] * least[0]
    for k in range(1, 3):
        if least[k] >= result:
            break
        total += least[k]
        squares += least[k] * least[k]
        inner = total * total - (k + 1) * (squares - 1.0)
        if inner >= 0.0:
            result = (total + np.sqrt(inner)) / (k + 1)
    return float(result)


@njit(cache=True)
def _march(links: Links, sources: NDArray[np.bool_]) -> Floats:  # pragma: no cover
    """Ways in cubes; a binary heap of (way, cube), out-dated entries are skipped."""
    count = links.shape[0]
    ways = np.full(count, np.inf)
    is_done = np.zeros(count, np.bool_)
    keys, cubes = np.empty(7 * count + 1), np.empty(7 * count + 1, np.int64)
    top = 0
    for cube in range(count):
        if sources[cube]:
            ways[cube] = 0.0
            keys[top], cubes[top] = 0.0, cube
            top += 1
    while top > 0:
        here = cubes[0]
        top -= 1
        key, moved = keys[top], cubes[top]
        i = 0
        while True:
            child = 2 * i + 1
            if child >= top:
                break
            if child + 1 < top and keys[child + 1] < keys[child]:
                child += 1
            if keys[child] >= key:
                break
            keys[i], cubes[i] = keys[child], cubes[child]
            i = child
        keys[i], cubes[i] = key, moved
        if is_done[here]:
            continue
        is_done[here] = True
        for k in range(6):
            other = links[here, k]
            if other < 0 or is_done[other]:
                continue
            way = _solved(links, ways, other)
            if way < ways[other]:
                ways[other] = way
                i = top
                top += 1
                while i > 0 and keys[(i - 1) // 2] > way:
                    keys[i], cubes[i] = keys[(i - 1) // 2], cubes[(i - 1) // 2]
                    i = (i - 1) // 2
                keys[i], cubes[i] = way, other
    return ways
