"""What one cell and one block lose to a cutter: their new distance, and how deep the cutter met metal and the part behind it."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.process.field import AIR, BLOCK, METAL, Blocks, drop_block

Array = NDArray[np.float64]

TOUCH = 0.02  # of a cell: a cutter that takes less, or goes below the target by less, only rounds differently
ENGAGED, GOUGE, REMOVED = 0, 1, 2  # columns of what a piece did
ENGAGED_AT, GOUGE_AT = 3, 6  # first of three
LOOKED = 9  # column: cells whose distance to the sweep was worked out
TOLD = 10  # columns


@njit(cache=True, nogil=True)
def tell(told: Array, column: int, at: int, depth: float, x: float, y: float, z: float) -> None:
    """Keep the greatest depth and its place."""
    if depth > told[column]:
        told[column] = depth
        told[at], told[at + 1], told[at + 2] = x, y, z


@njit(cache=True, nogil=True)
def filled(value: float, cell: float) -> float:
    """Share of a cell that is metal."""
    return float(min(1.0, max(0.0, 0.5 - value / cell)))


@njit(cache=True, nogil=True)
def gouge_of(guard: Blocks, a: int, b: int, c: int, i: int, j: int, k: int, taken: float, inside: float) -> float:
    """Depth of a cut below the target's surface, as one cell next to both sees it, mm; negative: the cut keeps off.

    taken : depth of the metal that went here, mm   inside : depth in the cutter, mm
    A ball round the cell with radius `inside` is cut, one with radius -target is part: what they overlap by lies below the target's surface.
    """
    part = guard.directory[a, b, c]
    if part == AIR:
        return float(-guard.size[1])
    target = -guard.size[1] if part == METAL else float(guard.value[part, i, j, k])
    if target >= guard.size[1]:
        return float(-guard.size[1])
    return float(min(inside - target, guard.size[1]) if taken > TOUCH * guard.size[0] else -guard.size[1])


@njit(cache=True, nogil=True)
def place_of(blocks: Blocks, a: int, b: int, c: int, i: int, j: int, k: int) -> tuple[float, float, float]:
    """Centre of a cell of a block, mm."""
    cell, origin = blocks.size[0], blocks.origin
    return origin[0] + (a * BLOCK + i) * cell, origin[1] + (b * BLOCK + j) * cell, origin[2] + (c * BLOCK + k) * cell


@njit(cache=True, nogil=True)
def remove_block(blocks: Blocks, guard: Blocks, a: int, b: int, c: int, told: Array) -> None:
    """Make a block that lies deep inside the sweep air."""
    cell, band = blocks.size[0], blocks.size[1]
    block = blocks.directory[a, b, c]
    is_guarded = guard.directory[a, b, c] != AIR
    if block == METAL and not is_guarded:
        i, j, k = (a * BLOCK + 3) * cell, (b * BLOCK + 3) * cell, (c * BLOCK + 3) * cell
        tell(told, ENGAGED, ENGAGED_AT, band, blocks.origin[0] + i, blocks.origin[1] + j, blocks.origin[2] + k)
        told[REMOVED] += BLOCK**3 * cell**3
    else:
        for i in range(BLOCK):
            x = blocks.origin[0] + (a * BLOCK + i) * cell
            for j in range(BLOCK):
                y = blocks.origin[1] + (b * BLOCK + j) * cell
                for k in range(BLOCK):
                    z = blocks.origin[2] + (c * BLOCK + k) * cell
                    value = -band if block == METAL else float(blocks.value[block, i, j, k])
                    if value >= band:
                        continue
                    told[REMOVED] += filled(value, cell) * cell**3
                    tell(told, ENGAGED, ENGAGED_AT, -value, x, y, z)
                    if is_guarded and value < 0.0:
                        tell(told, GOUGE, GOUGE_AT, gouge_of(guard, a, b, c, i, j, k, band - value, band), x, y, z)
    drop_block(blocks, a, b, c, AIR)


@njit(cache=True, nogil=True)
def cut_cell(
    blocks: Blocks, guard: Blocks, a: int, b: int, c: int, i: int, j: int, k: int, value: float, inside: float, mark: int, told: Array
) -> None:  # fmt: skip
    """Give a cell of an open block its new distance `inside`, the depth in the sweep, which is greater than the old `value`, mm."""
    cell, band = blocks.size[0], blocks.size[1]
    block = blocks.directory[a, b, c]
    told[REMOVED] += (filled(value, cell) - filled(inside, cell)) * cell**3
    if value < 0.0 and min(inside - value, band) > told[ENGAGED]:
        x, y, z = place_of(blocks, a, b, c, i, j, k)
        tell(told, ENGAGED, ENGAGED_AT, min(inside - value, band), x, y, z)
    if guard.directory[a, b, c] != AIR:
        gouge = gouge_of(guard, a, b, c, i, j, k, inside - value, inside)
        if gouge > told[GOUGE]:
            x, y, z = place_of(blocks, a, b, c, i, j, k)
            tell(told, GOUGE, GOUGE_AT, gouge, x, y, z)
    blocks.value[block, i, j, k] = np.float32(min(band, inside))
    blocks.mark[block, i, j, k] = np.int16(mark)


@njit(cache=True, nogil=True)
def drop_air(blocks: Blocks, a: int, b: int, c: int) -> None:
    """Give a block back that is air beyond the band."""
    band = np.float32(blocks.size[1])
    cells = blocks.value[blocks.directory[a, b, c]].ravel()
    for n in range(cells.shape[0]):
        if cells[n] < band:
            return
    drop_block(blocks, a, b, c, AIR)
