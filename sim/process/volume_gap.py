"""Where two fields on one grid differ: missing and excess volume in small boxes, read block by block."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.process.field import AIR, BLOCK, Blocks, Field

Array = NDArray[np.float64]
Index = NDArray[np.int64]

BOX_MM = 0.25  # edge of the boxes in which volumes are told, at least one cell
LEAST_CELLS = 1e-6  # a box that holds less is level
FIRST_BOXES = 1024


class Gaps(NamedTuple):
    """Boxes in which two fields differ.

    centre : (n, 3) float, mm   missing, excess : (n,) float, mm3
    """

    centre: Array
    missing: Array
    excess: Array


def volume_gaps(built: Field, wanted: Field, above_mm: float = -np.inf) -> Gaps:
    """Metal that `wanted` has and `built` has not (missing), and the other way round, above a height.

    Cells on a surface count by their filled fraction: half a cell's edge either way of the surface.
    Raises ValueError when the fields lie on different grids.
    """
    if built.shape != wanted.shape or built.cell_mm != wanted.cell_mm or not np.allclose(built.origin, wanted.origin, atol=1e-6):
        raise ValueError(
            f"fields of {built.shape} cells of {built.cell_mm:g} mm from {built.origin.tolist()} and of {wanted.shape} cells of"
            f" {wanted.cell_mm:g} mm from {wanted.origin.tolist()} lie on different grids: build both with the same cell and bounds"
        )
    first = 0 if np.isneginf(above_mm) else max(0, int(np.ceil((above_mm - built.origin[2]) / built.cell_mm + 0.5)))
    per = max(n for n in (1, 2, 4, BLOCK) if n == 1 or n * built.cell_mm <= BOX_MM)
    index, volume = gap_boxes(built.blocks, wanted.blocks, first, per)
    centre = built.origin + built.cell_mm * (index * per + 0.5 * (per - 1))
    return Gaps(centre, volume[:, 0] * built.cell_mm**3, volume[:, 1] * built.cell_mm**3)


@njit(cache=True, nogil=True)
def share_of(blocks: Blocks, block: int, i: int, j: int, k: int) -> float:
    """Filled share of a cell of a block, or of a uniform one."""
    if block < 0:
        return 0.0 if block == AIR else 1.0
    return float(min(1.0, max(0.0, 0.5 - blocks.value[block, i, j, k] / blocks.size[0])))


@njit(cache=True, nogil=True)
def gap_boxes(built: Blocks, wanted: Blocks, first: int, per: int) -> tuple[Index, Array]:
    """Boxes of per x per x per cells that differ: their index (n, 3), and missing and excess in cells (n, 2). first : lowest cell along z."""
    index, volume = np.empty((FIRST_BOXES, 3), np.int64), np.empty((FIRST_BOXES, 2))
    count = 0
    side = BLOCK // per
    gap = np.zeros((side, side, side, 2))
    bx, by, bz = built.directory.shape
    for c in range(first // BLOCK, bz):
        low = max(0, first - c * BLOCK)
        for a in range(bx):
            for b in range(by):
                has, wants = built.directory[a, b, c], wanted.directory[a, b, c]
                if has < 0 and has == wants:
                    continue
                if count + side**3 > index.shape[0]:
                    room = 2 * index.shape[0] + side**3
                    wider, more = np.empty((room, 3), np.int64), np.empty((room, 2))
                    wider[:count], more[:count] = index[:count], volume[:count]
                    index, volume = wider, more
                gap[:] = 0.0
                for i in range(BLOCK):
                    for j in range(BLOCK):
                        for k in range(low, BLOCK):
                            lack = share_of(wanted, wants, i, j, k) - share_of(built, has, i, j, k)
                            if lack > 0.0:
                                gap[i // per, j // per, k // per, 0] += lack
                            else:
                                gap[i // per, j // per, k // per, 1] -= lack
                for n in range(side**3):
                    i, j, k = n // (side * side), n // side % side, n % side
                    if gap[i, j, k, 0] + gap[i, j, k, 1] > LEAST_CELLS:
                        index[count, 0], index[count, 1], index[count, 2] = a * side + i, b * side + j, c * side + k
                        volume[count] = gap[i, j, k]
                        count += 1
    return index[:count].copy(), volume[:count].copy()
