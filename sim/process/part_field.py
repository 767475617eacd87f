"""The part as a sparse field on a stock's grid: boxes of blocks that no surface comes near are settled by one distance each."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.process.facet_tree import DEEPEST, FEW_FACETS, FacetTree, facets_within, nearest, nearest_of
from sim.process.field import AIR, BLOCK, METAL, Field

Array = NDArray[np.float64]
Index = NDArray[np.int64]

PART = 4  # cells along an edge of the eighth of a block for which facets are gathered
SURE_CELLS = 1.5  # a cell so far from the surface has no surface, and no zero, between itself and the next
ROUNDING = 1e-6  # of a cell


def part_field(tree: FacetTree, origin: Array, cell_mm: float, band_mm: float, cells: tuple[int, ...] | Index) -> Field:
    """Signed distance of a closed mesh within +-band on a grid: exact at every cell's centre, mm. Time and memory go with the surface.

    origin : (3,) float, mm, centre of cell (0, 0, 0)   cells : (3,) int, rounded up to whole blocks
    """
    field = Field(origin, cell_mm, band_mm, cells)
    directory = field.blocks.directory.copy()
    near = mixed_blocks(tree, field.origin, field.cell_mm, field.band_mm, directory)
    value = np.empty((len(near), BLOCK, BLOCK, BLOCK), dtype=np.float32)
    fill_blocks(tree, field.origin, field.cell_mm, field.band_mm, near, value)
    low, high = value.min(axis=(1, 2, 3)), value.max(axis=(1, 2, 3))
    kept = (low < field.band_mm) & (high > -field.band_mm)
    number = np.where(kept, np.cumsum(kept) - 1, np.where(low > 0.0, AIR, METAL))
    directory[tuple(near.T)] = number
    field.restore({"directory": directory, "value": value[kept], "mark": np.zeros((int(kept.sum()), BLOCK, BLOCK, BLOCK), np.int16)})
    return field


@njit(cache=True, nogil=True)
def mixed_blocks(tree: FacetTree, origin: Array, cell: float, band: float, directory: NDArray[np.int32]) -> Index:
    """Write AIR or METAL for the blocks that lie beyond the band; the entries of the others, (m, 3) int.

    Boxes of blocks are halved as long as the surface may come nearer to one of their cells than the band.
    """
    found = np.empty((64, 3), np.int64)
    count = 0
    boxes = np.empty((8 * DEEPEST, 6), np.int64)
    stack = np.empty((DEEPEST, 2))
    facet = 0
    for d in range(3):
        boxes[0, d], boxes[0, 3 + d] = 0, directory.shape[d]
    height = 1
    while height > 0:
        height -= 1
        a, b, c, u, v, w = boxes[height]
        half = 0.5 * cell * np.sqrt(((u - a) * BLOCK - 1.0) ** 2 + ((v - b) * BLOCK - 1.0) ** 2 + ((w - c) * BLOCK - 1.0) ** 2)
        x = origin[0] + cell * (0.5 * (a + u) * BLOCK - 0.5)
        y = origin[1] + cell * (0.5 * (b + v) * BLOCK - 0.5)
        z = origin[2] + cell * (0.5 * (c + w) * BLOCK - 0.5)
        distance, facet = nearest(tree, stack, x, y, z, facet)
        if abs(distance) >= half + band + ROUNDING * cell:
            directory[a:u, b:v, c:w] = AIR if distance > 0.0 else METAL
        elif max(u - a, v - b, w - c) == 1:
            if count == found.shape[0]:
                larger = np.empty((2 * count, 3), np.int64)
                larger[:count] = found
                found = larger
            found[count, 0], found[count, 1], found[count, 2] = a, b, c
            count += 1
        else:
            axis = int(np.argmax(boxes[height, 3:] - boxes[height, :3]))
            middle = (boxes[height, axis] + boxes[height, 3 + axis]) // 2
            boxes[height + 1] = boxes[height]
            boxes[height, 3 + axis], boxes[height + 1, axis] = middle, middle
            height += 2
    return found[:count].copy()


@njit(cache=True, nogil=True)
def fill_blocks(tree: FacetTree, origin: Array, cell: float, band: float, near: Index, value: NDArray[np.float32]) -> None:
    """Signed distance at the cells of blocks, clipped to the band. near : (m, 3) int, entries   value : (m, 8, 8, 8), mm, written"""
    stack, few, boxes = np.empty((DEEPEST, 2)), np.empty(FEW_FACETS, np.int64), np.empty((FEW_FACETS, 6))
    half = 0.5 * cell * np.sqrt(3.0) * (PART - 1.0)
    middle = 0.5 * cell * (PART - 1.0)
    facet = 0
    for n in range(near.shape[0]):
        for part in range((BLOCK // PART) ** 3):
            i, j, k = PART * (part & 1), PART * (part >> 1 & 1), PART * (part >> 2)
            x = origin[0] + cell * (BLOCK * near[n, 0] + i)
            y = origin[1] + cell * (BLOCK * near[n, 1] + j)
            z = origin[2] + cell * (BLOCK * near[n, 2] + k)
            centre, facet = nearest(tree, stack, x + middle, y + middle, z + middle, facet)
            cells = value[n, i : i + PART, j : j + PART, k : k + PART]
            if abs(centre) >= half + band + ROUNDING * cell:
                cells[:] = np.float32(band if centre > 0.0 else -band)
                continue
            reach = min(abs(centre) + 2.0 * half, max(band, SURE_CELLS * cell) + half) + ROUNDING * cell
            count = facets_within(tree, stack, x + middle, y + middle, z + middle, reach, few, boxes)
            facet = fill_part(tree, stack, few, boxes, count, facet, x, y, z, cell, band, cells)


@njit(cache=True, nogil=True)
def fill_part(
    tree: FacetTree, stack: Array, few: Index, boxes: Array, count: int, facet: int, x: float, y: float, z: float, cell: float, band: float,
    cells: NDArray[np.float32],
) -> int:  # fmt: skip
    """Signed distance at PART x PART x PART cells, the first one at (x, y, z), from the `count` facets within reach, or by search.

    A cell with no surface within the band, or SURE_CELLS, is on the side of the cell before. Returns a facet to begin the next search with.
    """
    sure = max(band, SURE_CELLS * cell)
    for i in range(PART):
        for j in range(PART):
            for k in range(PART):
                px, py, pz = x + cell * i, y + cell * j, z + cell * k
                if count <= FEW_FACETS:
                    distance = nearest_of(tree, few, boxes, count, px, py, pz, sure)
                    if distance >= sure and i + j + k > 0:
                        before = cells[i, j, k - 1] if k > 0 else (cells[i, j - 1, k] if j > 0 else cells[i - 1, j, k])
                        distance = band if before > 0.0 else -band
                    elif distance >= sure:
                        distance, facet = nearest(tree, stack, px, py, pz, facet)
                else:
                    distance, facet = nearest(tree, stack, px, py, pz, facet)
                cells[i, j, k] = np.float32(min(band, max(-band, distance)))
    return facet
