"""Metal removed by a cutter whose axis stands upright: one look tells about a whole column of cells, and about a whole layer."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.process.field import AIR, BLOCK, Blocks, open_block
from sim.process.removal import LOOKED, cut_cell, drop_air, place_of, remove_block
from sim.process.sweep import Sweep, cutter_distance

Array = NDArray[np.float64]
Index = NDArray[np.int64]

ROUNDING = 1e-6  # of a cell, of what is kept in 32 bits


@njit(cache=True, nogil=True)
def sides_of(blocks: Blocks, s: Sweep, a: int, b: int, sides: Array) -> tuple[float, float]:
    """Depth in an upright sweep, as seen from its side, of the columns of cells of a pile of blocks, (8, 8) mm; the least and the greatest."""
    cell = blocks.size[0]
    x0, y0, _ = place_of(blocks, a, b, 0, 0, 0, 0)
    low, high = np.inf, -np.inf
    for i in range(BLOCK):
        dx = x0 + i * cell - s.x
        for j in range(BLOCK):
            dy = y0 + j * cell - s.y
            ahead = dx * s.vx + dy * s.vy
            past = ahead - min(s.length, max(0.0, ahead))
            side = s.radius - np.sqrt(max(0.0, dx * dx + dy * dy - ahead * ahead + past * past))
            sides[i, j] = side
            low, high = min(low, side), max(high, side)
    return low, high


@njit(cache=True, nogil=True)
def remove_upright(blocks: Blocks, guard: Blocks, s: Sweep, first: Index, last: Index, mark: int, told: Array) -> None:
    """Cut one sweep whose axis stands upright and that is known in closed form, pile of blocks by pile of blocks. first, last : of `cut.box_of`"""
    cell, band = blocks.size[0], blocks.size[1]
    foot, flute = s.z + min(0.0, s.lift), s.flute + abs(s.lift)
    sides = np.empty((BLOCK, BLOCK))
    for a in range(first[0], last[0]):
        for b in range(first[1], last[1]):
            least, most = sides_of(blocks, s, a, b, sides)
            if most <= -band:
                continue
            for c in range(first[2], last[2]):
                if blocks.directory[a, b, c] == AIR:
                    continue
                z0 = blocks.origin[2] + c * BLOCK * cell
                top = z0 + (BLOCK - 1) * cell
                if least >= band + s.corner and z0 - foot >= band + s.corner and foot + flute - top >= band:
                    remove_block(blocks, guard, a, b, c, told)
                elif top - foot > -band and foot + flute - z0 > -band:
                    remove_columns(blocks, guard, s, sides, a, b, c, mark, told)


@njit(cache=True, nogil=True)
def remove_columns(blocks: Blocks, guard: Blocks, s: Sweep, sides: Array, a: int, b: int, c: int, mark: int, told: Array) -> None:
    """Cut a block below an upright axis. sides : of `sides_of`

    No depth in the sweep is greater than that from its side, one and the same for a column of cells, or from its ends, for a layer of them.
    """
    cell, band = blocks.size[0], blocks.size[1]
    z0 = blocks.origin[2] + c * BLOCK * cell
    foot, flute, sure = s.z + min(0.0, s.lift), s.flute + abs(s.lift), ROUNDING * cell
    deepest = np.empty(BLOCK)
    most = -np.inf
    for k in range(BLOCK):
        deepest[k] = min(band, z0 + k * cell - foot, foot + flute - z0 - k * cell) - sure
        most = max(most, deepest[k])
    block = int(blocks.directory[a, b, c])
    cleared = False
    for i in range(BLOCK):
        for j in range(BLOCK):
            side = sides[i, j] - sure
            if side <= -band or (block >= 0 and least_of(blocks.value[block, i, j]) >= min(side, most)):
                continue
            for k in range(BLOCK):
                value = -band if block < 0 else float(blocks.value[block, i, j, k])
                if value >= min(side, deepest[k]):
                    continue
                told[LOOKED] += 1
                inside = -cutter_distance(s.radius - sides[i, j], z0 + k * cell - foot, s.radius, s.corner, flute)
                if inside <= value + sure:
                    continue
                if block < 0:
                    block = open_block(blocks, a, b, c)
                cut_cell(blocks, guard, a, b, c, i, j, k, value, inside, mark, told)
                blocks.touched[a, b, c] = True
                cleared |= inside >= band
    if cleared:
        drop_air(blocks, a, b, c)


@njit(cache=True, nogil=True)
def least_of(column: NDArray[np.float32]) -> float:
    """Least of the values of a column of eight cells."""
    low, high = min(column[0], column[1]), min(column[2], column[3])
    other, last = min(column[4], column[5]), min(column[6], column[7])
    return float(min(min(low, high), min(other, last)))
