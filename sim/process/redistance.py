"""Distances mended near what was cut or added: the surface stays where it is, cells whose surface has gone get the distance to what is left.

A cut takes the greater of two distances, a joint the lesser. Both place the surface exactly, but a cell beside it may keep the distance to
a surface that is no longer there: too near. Such a cell is known by this: nothing of the other kind is left that near. Its new distance
is that to the nearest place where a line of the grid crosses the surface, or to the nearest ball that a cell of the other kind knows to
be wholly of that kind (depth = its own distance). Both are never nearer than the surface.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.process.blocks import AIR, BLOCK, METAL, Blocks, value_at

Array = NDArray[np.float64]
Values = NDArray[np.float32]

REACH = 4  # cells: what is farther from a cell is not looked at
SURE = 0.45  # of a cell: so much farther what is left has to be before a cell is changed
SHEET = 1e-3  # of a cell: metal that is nowhere thicker is what rounding left of a cut along a surface
BEYOND = 0.5  # of a cell: how far beyond the surface the first look goes
SIDE = BLOCK + 2 * REACH


def _offsets() -> NDArray[np.int64]:
    """(n, 3) int   Ways to the cells within REACH, nearest first."""
    ways = np.stack(np.meshgrid(*(np.arange(-REACH, REACH + 1),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    far = (ways**2).sum(axis=1)
    ways = ways[(far > 0) & (far <= REACH * REACH)]
    out: NDArray[np.int64] = ways[np.argsort((ways**2).sum(axis=1), kind="stable")].astype(np.int64)
    return out


OFFSETS = _offsets()
LENGTHS: Array = np.sqrt((OFFSETS**2).sum(axis=1).astype(np.float64))


@njit(cache=True, nogil=True)
def redistance(blocks: Blocks) -> None:
    """Mend the touched blocks and those next to them; uniform ones become air or metal."""
    bx, by, bz = blocks.directory.shape
    window = np.empty((SIDE, SIDE, SIDE), np.float32)
    for a in range(bx):
        for b in range(by):
            for c in range(bz):
                if blocks.touched[a, b, c] and blocks.directory[a, b, c] >= 0:
                    drop_sheets(blocks, a, b, c)
    for a in range(bx):
        for b in range(by):
            for c in range(bz):
                block = blocks.directory[a, b, c]
                if block < 0 or not near_touched(blocks.touched, a, b, c):
                    continue
                take_window(blocks, a, b, c, window)
                kind = mend(window, blocks.value[block], blocks.size[0], blocks.size[1])
                if kind < 0:
                    blocks.free[blocks.count[0]] = block
                    blocks.count[0] += 1
                    blocks.directory[a, b, c] = kind


@njit(cache=True, nogil=True)
def drop_sheets(blocks: Blocks, a: int, b: int, c: int) -> None:
    """Make cells of metal that no metal carries, next to them, air with the surface on it."""
    least = -SHEET * blocks.size[0]
    cells = blocks.value[blocks.directory[a, b, c]]
    for i in range(BLOCK):
        for j in range(BLOCK):
            for k in range(BLOCK):
                if not least < cells[i, j, k] < 0.0:
                    continue
                x, y, z = a * BLOCK + i, b * BLOCK + j, c * BLOCK + k
                near = min(value_at(blocks, x - 1, y, z), value_at(blocks, x + 1, y, z))
                near = min(near, value_at(blocks, x, y - 1, z), value_at(blocks, x, y + 1, z))
                if min(near, value_at(blocks, x, y, z - 1), value_at(blocks, x, y, z + 1)) > least:
                    cells[i, j, k] = np.float32(0.0)


@njit(cache=True, nogil=True)
def near_touched(touched: NDArray[np.bool_], a: int, b: int, c: int) -> bool:
    """Whether a block or one next to it was written to."""
    for i in range(max(0, a - 1), min(touched.shape[0], a + 2)):
        for j in range(max(0, b - 1), min(touched.shape[1], b + 2)):
            for k in range(max(0, c - 1), min(touched.shape[2], c + 2)):
                if touched[i, j, k]:
                    return True
    return False


@njit(cache=True, nogil=True)
def take_window(blocks: Blocks, a: int, b: int, c: int, window: Values) -> None:
    """Values of a block and of REACH cells round it, mm; beyond the grid those of its outermost cells."""
    bx, by, bz = blocks.directory.shape
    band = np.float32(blocks.size[1])
    for i in range(SIDE):
        x = min(max(a * BLOCK + i - REACH, 0), bx * BLOCK - 1)
        for j in range(SIDE):
            y = min(max(b * BLOCK + j - REACH, 0), by * BLOCK - 1)
            for k in range(SIDE):
                z = min(max(c * BLOCK + k - REACH, 0), bz * BLOCK - 1)
                block = blocks.directory[x // BLOCK, y // BLOCK, z // BLOCK]
                if block >= 0:
                    window[i, j, k] = blocks.value[block, x % BLOCK, y % BLOCK, z % BLOCK]
                else:
                    window[i, j, k] = band if block == AIR else -band


@njit(cache=True, nogil=True)
def mend(window: Values, cells: Values, cell: float, band: float) -> int:
    """Mend the cells of one block, in place; METAL or AIR when all became it, else 0. window : of `take_window`; cells : (8, 8, 8) mm"""
    air = metal = True
    for i in range(BLOCK):
        for j in range(BLOCK):
            for k in range(BLOCK):
                value = float(cells[i, j, k])
                if abs(value) < band and not is_held(window, i + REACH, j + REACH, k + REACH, cell):
                    far = nearest_left(window, i + REACH, j + REACH, k + REACH, cell, abs(value) + SURE * cell)
                    if far > abs(value) + SURE * cell:
                        value = min(far, band) if value >= 0.0 else -min(far, band)
                        cells[i, j, k] = np.float32(value)
                air &= value >= band
                metal &= value <= -band
    if air:
        return AIR
    return METAL if metal else 0


@njit(cache=True, nogil=True)
def is_held(window: Values, i: int, j: int, k: int, cell: float) -> bool:
    """Whether the surface of a cell is there: among the 26 cells round it, so that it stays between them as it is, or down its gradient."""
    at = window[i, j, k]
    is_air = at >= 0.0
    for x in range(i - 1, i + 2):
        for y in range(j - 1, j + 2):
            for z in range(k - 1, k + 2):
                if (window[x, y, z] >= 0.0) != is_air:
                    return True
    lx, hx, ly, hy, lz, hz = (
        window[i - 1, j, k], window[i + 1, j, k], window[i, j - 1, k], window[i, j + 1, k], window[i, j, k - 1], window[i, j, k + 1],
    )  # fmt: skip
    gx, gy, gz = hx - lx, hy - ly, hz - lz
    steep = np.sqrt(gx * gx + gy * gy + gz * gz)
    if steep == 0.0:
        return False
    step = (at / cell + (BEYOND if is_air else -BEYOND)) / steep
    x, y, z = int(np.rint(i - step * gx)), int(np.rint(j - step * gy)), int(np.rint(k - step * gz))
    if max(abs(x - i), abs(y - j), abs(z - k)) > REACH:
        return False
    far = np.sqrt(float((x - i) ** 2 + (y - j) ** 2 + (z - k) ** 2)) * cell
    there = window[x, y, z]
    return bool((there >= 0.0) != is_air and far - abs(there) <= abs(at) + SURE * cell)


@njit(cache=True, nogil=True)
def nearest_left(window: Values, i: int, j: int, k: int, cell: float, enough: float) -> float:
    """Distance to the nearest of what is of the other kind than a cell, mm; inf: none within reach. Anything up to `enough` ends the search."""
    is_air = window[i, j, k] >= 0.0
    least = np.inf
    for n in range(OFFSETS.shape[0]):
        far = LENGTHS[n] * cell
        x, y, z = i + OFFSETS[n, 0], j + OFFSETS[n, 1], k + OFFSETS[n, 2]
        there = abs(float(window[x, y, z]))
        if (window[x, y, z] >= 0.0) == is_air:
            continue
        least = min(least, far - there)
        for d in range(3):  # the crossing towards the cell, along each line of the grid
            way = OFFSETS[n, d]
            if way == 0:
                continue
            on = -1 if way > 0 else 1
            next_to = window[x + (on if d == 0 else 0), y + (on if d == 1 else 0), z + (on if d == 2 else 0)]
            if (next_to >= 0.0) == is_air:
                share = there / max(there + abs(float(next_to)), 1e-12)
                along = way + on * share
                least = min(least, cell * np.sqrt(max(0.0, LENGTHS[n] ** 2 - way * way + along * along)))
        if least <= enough:
            break
    return float(least)
