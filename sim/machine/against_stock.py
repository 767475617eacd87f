"""Signed distance of a solid of the machine from the stock as it stands.

With s the solid's signed distance at a point and v the stock's, both negative inside, s + v is nowhere less than their gap and reaches
it along the shortest way between them; where s + v < 0 the two overlap, at least that deep. So the least s + v over the cells next to
the stock's surface is the gap (or minus the depth), to a small part of a cell. Far from the solid, whole groups of blocks and then
blocks are passed over by s at their centres.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.machine.bodies import Bodies, body_distance
from sim.process.field import AIR, BLOCK, METAL, Blocks

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.uint8]

GROUP = 4  # blocks along an edge of a group
FINE_MM = 3.0  # nearer than this the gap is found from cells, farther only from blocks (a lower bound)
DIAGONAL = float(np.sqrt(3.0))


@njit(cache=True, nogil=True)
def group_mask(blocks: Blocks, mask: Mask, low: Index, high: Index) -> None:
    """Note which groups of blocks hold more than air. mask : (gx, gy, gz)   low, high : (3,) groups, high exclusive"""
    nx, ny, nz = blocks.directory.shape
    for a in range(max(0, low[0]), min(mask.shape[0], high[0])):
        for b in range(max(0, low[1]), min(mask.shape[1], high[1])):
            for c in range(max(0, low[2]), min(mask.shape[2], high[2])):
                mask[a, b, c] = 0
                for i in range(a * GROUP, min(nx, (a + 1) * GROUP)):
                    for j in range(b * GROUP, min(ny, (b + 1) * GROUP)):
                        for k in range(c * GROUP, min(nz, (c + 1) * GROUP)):
                            if blocks.directory[i, j, k] != AIR:
                                mask[a, b, c] = 1


@njit(cache=True, nogil=True)
def _solid_at(bodies: Bodies, b: int, pose: Array, x: float, y: float, z: float) -> float:
    """The solid's signed distance at a point of the stock's frame. pose : (3, 4), that frame from the solid's."""
    x, y, z = x - pose[0, 3], y - pose[1, 3], z - pose[2, 3]
    return float(
        body_distance(
            bodies, b, pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z, pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z,
            pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z,
        )
    )  # fmt: skip


@njit(cache=True, nogil=True)
def stock_distance(bodies: Bodies, b: int, pose: Array, blocks: Blocks, mask: Mask, at: Array) -> float:
    """Signed distance of solid b from the stock, mm; beyond FINE_MM a lower bound of it that is not below FINE_MM.

    pose : (3, 4)   Frame of the stock from that of the solid.   mask : from `group_mask`
    at : (3,)   Gets the cell of the nearest or deepest place, frame of the stock; as it was where the gap is only bounded.
    """
    cell, band = blocks.size[0], blocks.size[1]
    origin = blocks.origin
    size = GROUP * BLOCK * cell
    reach = 0.5 * DIAGONAL * size + band
    half = 0.5 * (GROUP * BLOCK - 1) * cell
    best, bound = np.inf, np.inf
    for a in range(mask.shape[0]):
        for i in range(mask.shape[1]):
            for k in range(mask.shape[2]):
                if mask[a, i, k] == 0:
                    continue
                away = _solid_at(bodies, b, pose, origin[0] + a * size + half, origin[1] + i * size + half, origin[2] + k * size + half) - reach
                if away >= FINE_MM or away >= best:
                    bound = min(bound, max(FINE_MM, away))
                    continue
                best, low = _of_group(bodies, b, pose, blocks, a, i, k, best, at)
                bound = min(bound, low)
    return float(best if best < FINE_MM else max(FINE_MM, min(best, bound)))


@njit(cache=True, nogil=True)
def _of_group(
    bodies: Bodies, b: int, pose: Array, blocks: Blocks, ga: int, gb: int, gc: int, best: float, at: Array
) -> tuple[float, float]:
    """Least s + v of a group's cells, if less than `best`, and a lower bound of those that were passed over as farther than FINE_MM."""
    cell, band = blocks.size[0], blocks.size[1]
    origin = blocks.origin
    nx, ny, nz = blocks.directory.shape
    half = 0.5 * (BLOCK - 1) * cell
    reach = DIAGONAL * half + band
    bound = np.inf
    for i in range(ga * GROUP, min(nx, (ga + 1) * GROUP)):
        for j in range(gb * GROUP, min(ny, (gb + 1) * GROUP)):
            for k in range(gc * GROUP, min(nz, (gc + 1) * GROUP)):
                block = blocks.directory[i, j, k]
                if block == AIR:
                    continue
                x, y, z = origin[0] + i * BLOCK * cell, origin[1] + j * BLOCK * cell, origin[2] + k * BLOCK * cell
                middle = _solid_at(bodies, b, pose, x + half, y + half, z + half)
                if middle - reach >= FINE_MM:
                    bound = min(bound, middle - reach)
                elif middle - reach < best:
                    if block == METAL:
                        if middle - band < best:
                            best = middle - band
                            at[0], at[1], at[2] = x + half, y + half, z + half
                    else:
                        best = _of_block(bodies, b, pose, blocks, block, x, y, z, best, at)
    return best, bound


@njit(cache=True, nogil=True)
def _of_block(bodies: Bodies, b: int, pose: Array, blocks: Blocks, block: int, x: float, y: float, z: float, best: float, at: Array) -> float:
    """Least s + v of a block's cells, if less than `best`. x, y, z : centre of its first cell"""
    cell, band = blocks.size[0], blocks.size[1]
    for i in range(BLOCK):
        for j in range(BLOCK):
            for k in range(BLOCK):
                value = blocks.value[block, i, j, k]
                if value >= band:
                    continue
                px, py, pz = x + i * cell, y + j * cell, z + k * cell
                together = _solid_at(bodies, b, pose, px, py, pz) + value
                if together < best:
                    best = together
                    at[0], at[1], at[2] = px, py, pz
    return best
