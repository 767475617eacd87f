"""Blocks of 8 x 8 x 8 cells of a sparse signed distance, as kernels read and write them; a block without a surface is one word, air or metal."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

BLOCK = 8  # cells along an edge of a block
SHIFT, MASK = 3, 7  # of a cell's index: its block, its place in the block
AIR, METAL = -1, -2  # entries of the directory that are no block


class Blocks(NamedTuple):
    """The arrays of a Field, as kernels take them. Fetch them anew after `Field.reserve`.

    directory : (bx, by, bz) int32   Number of the block, AIR (all cells +band) or METAL (all cells -band).
    value : (n, 8, 8, 8) float32, mm   Signed distance, negative in metal, within +-band.
    mark : (n, 8, 8, 8) int16   What made the surface here: 0 clamped, > 0 bead of layer mark - 1, < 0 minus the number of the tool that cut.
    free : (n,) int32   Stack of blocks that were given back.
    count : (2,) int64   Length of that stack; blocks ever used.
    origin : (3,) float, mm   Centre of cell (0, 0, 0).
    size : (2,) float, mm   Edge of a cell, band.
    touched : (bx, by, bz) bool   Blocks that were written to since `Field.refresh`.
    """

    directory: NDArray[np.int32]
    value: NDArray[np.float32]
    mark: NDArray[np.int16]
    free: NDArray[np.int32]
    count: NDArray[np.int64]  # type: ignore[assignment]  # tuple.count is not wanted here
    origin: NDArray[np.float64]
    size: NDArray[np.float64]
    touched: NDArray[np.bool_]


@njit(cache=True, nogil=True)
def value_at(blocks: Blocks, i: int, j: int, k: int) -> float:
    """Signed distance at a cell's centre, mm; out of the grid: +band."""
    bx, by, bz = blocks.directory.shape
    if i < 0 or j < 0 or k < 0 or i >= bx * BLOCK or j >= by * BLOCK or k >= bz * BLOCK:
        return float(blocks.size[1])
    block = blocks.directory[i >> SHIFT, j >> SHIFT, k >> SHIFT]
    if block >= 0:
        return float(blocks.value[block, i & MASK, j & MASK, k & MASK])
    return float(blocks.size[1] if block == AIR else -blocks.size[1])


@njit(cache=True, nogil=True)
def mark_at(blocks: Blocks, i: int, j: int, k: int) -> int:
    """What made the surface at a cell; 0 far from any surface and out of the grid."""
    bx, by, bz = blocks.directory.shape
    if i < 0 or j < 0 or k < 0 or i >= bx * BLOCK or j >= by * BLOCK or k >= bz * BLOCK:
        return 0
    block = blocks.directory[i >> SHIFT, j >> SHIFT, k >> SHIFT]
    return int(blocks.mark[block, i & MASK, j & MASK, k & MASK]) if block >= 0 else 0


@njit(cache=True, nogil=True)
def open_block(blocks: Blocks, a: int, b: int, c: int) -> int:
    """Number of the block (a, b, c) of the directory; a uniform one gets cells of its own. Raises RuntimeError without room (`Field.reserve`)."""
    blocks.touched[a, b, c] = True
    block = blocks.directory[a, b, c]
    if block >= 0:
        return int(block)
    fill = blocks.size[1] if block == AIR else -blocks.size[1]
    if blocks.count[0] > 0:
        blocks.count[0] -= 1
        block = blocks.free[blocks.count[0]]
    elif blocks.count[1] < blocks.value.shape[0]:
        block = np.int32(blocks.count[1])
        blocks.count[1] += 1
    else:
        raise RuntimeError("no room for another block: reserve it first")
    blocks.value[block] = np.float32(fill)
    blocks.mark[block] = np.int16(0)
    blocks.directory[a, b, c] = block
    return int(block)


@njit(cache=True, nogil=True)
def drop_block(blocks: Blocks, a: int, b: int, c: int, becomes: int) -> None:
    """Make the block (a, b, c) uniform: AIR or METAL; its cells go back."""
    blocks.touched[a, b, c] = True
    block = blocks.directory[a, b, c]
    if block >= 0:
        blocks.free[blocks.count[0]] = block
        blocks.count[0] += 1
    blocks.directory[a, b, c] = becomes


@njit(cache=True, nogil=True)
def put(blocks: Blocks, i: int, j: int, k: int, value: float, mark: int) -> None:
    """Set a cell, clipped to the band; opens its block when needed. Out of the grid: nothing. Raises RuntimeError without room."""
    bx, by, bz = blocks.directory.shape
    if i < 0 or j < 0 or k < 0 or i >= bx * BLOCK or j >= by * BLOCK or k >= bz * BLOCK:
        return
    band = blocks.size[1]
    value = min(band, max(-band, value))
    block = blocks.directory[i >> SHIFT, j >> SHIFT, k >> SHIFT]
    if block < 0:
        if value == (band if block == AIR else -band):
            return
        block = open_block(blocks, i >> SHIFT, j >> SHIFT, k >> SHIFT)
    blocks.touched[i >> SHIFT, j >> SHIFT, k >> SHIFT] = True
    blocks.value[block, i & MASK, j & MASK, k & MASK] = np.float32(value)
    blocks.mark[block, i & MASK, j & MASK, k & MASK] = np.int16(mark)


@njit(cache=True, nogil=True)
def settle(blocks: Blocks, low: Index, high: Index) -> None:
    """Give back the blocks that became uniform. low, high : (3,) int, box of cells, high exclusive."""
    first, last = block_range(blocks, low, high)
    band = np.float32(blocks.size[1])
    for a in range(first[0], last[0]):
        for b in range(first[1], last[1]):
            for c in range(first[2], last[2]):
                block = blocks.directory[a, b, c]
                if block < 0:
                    continue
                cells = blocks.value[block].ravel()
                edge = cells[0]
                if edge != band and edge != -band:
                    continue
                uniform = True
                for n in range(cells.shape[0]):
                    if cells[n] != edge:
                        uniform = False
                        break
                if uniform:
                    drop_block(blocks, a, b, c, AIR if edge > 0.0 else METAL)


@njit(cache=True, nogil=True)
def block_range(blocks: Blocks, low: Index, high: Index) -> tuple[Index, Index]:
    """First and last (exclusive) entry of the directory, (3,) int each, that a box of cells touches; clipped to the grid."""
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for d in range(3):
        first[d] = min(max(0, low[d] >> SHIFT), blocks.directory.shape[d])
        last[d] = max(first[d], min(blocks.directory.shape[d], (high[d] + MASK) >> SHIFT))
    return first, last


@njit(cache=True, nogil=True)
def distance_at(blocks: Blocks, x: float, y: float, z: float) -> float:
    """Signed distance at a point by trilinear interpolation, mm; beyond the grid that of the nearest cell."""
    nx, ny, nz = blocks.directory.shape
    cell = blocks.size[0]
    u = min(max((x - blocks.origin[0]) / cell, 0.0), nx * BLOCK - 1.0)
    v = min(max((y - blocks.origin[1]) / cell, 0.0), ny * BLOCK - 1.0)
    w = min(max((z - blocks.origin[2]) / cell, 0.0), nz * BLOCK - 1.0)
    i, j, k = min(int(u), nx * BLOCK - 2), min(int(v), ny * BLOCK - 2), min(int(w), nz * BLOCK - 2)
    u, v, w = u - i, v - j, w - k
    low = (value_at(blocks, i, j, k) * (1.0 - u) + value_at(blocks, i + 1, j, k) * u) * (1.0 - v)
    low += (value_at(blocks, i, j + 1, k) * (1.0 - u) + value_at(blocks, i + 1, j + 1, k) * u) * v
    high = (value_at(blocks, i, j, k + 1) * (1.0 - u) + value_at(blocks, i + 1, j, k + 1) * u) * (1.0 - v)
    high += (value_at(blocks, i, j + 1, k + 1) * (1.0 - u) + value_at(blocks, i + 1, j + 1, k + 1) * u) * v
    return float(low * (1.0 - w) + high * w)


@njit(cache=True, nogil=True)
def gradient_at(blocks: Blocks, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Gradient at a point by differences over one cell."""
    h = 0.5 * blocks.size[0]
    gx = distance_at(blocks, x + h, y, z) - distance_at(blocks, x - h, y, z)
    gy = distance_at(blocks, x, y + h, z) - distance_at(blocks, x, y - h, z)
    gz = distance_at(blocks, x, y, z + h) - distance_at(blocks, x, y, z - h)
    return gx / (2.0 * h), gy / (2.0 * h), gz / (2.0 * h)
