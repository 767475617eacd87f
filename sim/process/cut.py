"""Metal removed where a turning cutter sweeps: the stock minus the swept volume, block by block.

The distance to the sweep changes by no more than the way between two points: one look at the middle of a block, and of each of its
eighths, tells which cells cannot change. An upright axis has a shorter way (`upright`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.process.field import AIR, BLOCK, METAL, SHIFT, Blocks, open_block
from sim.process.removal import ENGAGED, ENGAGED_AT, GOUGE, GOUGE_AT, LOOKED, cut_cell, drop_air, place_of, remove_block
from sim.process.sweep import Sweep, is_plain, pieces_of, sweep_bound, sweep_box, sweep_distance, sweep_of
from sim.process.upright import remove_upright

__all__ = ["ENGAGED", "ENGAGED_AT", "GOUGE", "GOUGE_AT", "Cut", "remove_pieces", "room_of"]

Array = NDArray[np.float64]

HALF_DIAGONAL = 0.5 * np.sqrt(3.0) * (BLOCK - 1)  # cells, from the middle of a block to its farthest cell
PART = 4  # cells along an edge of the eighth of a block
PART_DIAGONAL = 0.5 * np.sqrt(3.0) * (PART - 1)
UPRIGHT = 1.0 - 1e-12  # z of an axis from which no cell is off by more than 1e-6 of its way


class Cut(NamedTuple):
    """What one piece of a cutter's path did to the metal.

    engaged_mm : greatest depth at which the cutter met metal, at most the band (0: cut air)
    gouge_mm : greatest depth of the cut below the target's surface, at most the band (0: none, or no target is known)
    removed_mm3 : metal taken away
    at : (3,) float, mm, build frame   Where the gouge is deepest, else where the cutter was engaged deepest.
    """

    engaged_mm: float
    gouge_mm: float
    removed_mm3: float
    at: Array


@njit(cache=True, nogil=True)
def remove_pieces(blocks: Blocks, guard: Blocks, path: Array, cutter: Array, mark: int, first: int, told: Array) -> int:
    """Cut along pieces of path in order, from piece `first` on, until done or out of room; returns the first piece that is not done.

    guard : the target on the same grid; all air: there is none
    path : (n, 12) float   start, end (mm, cutter's end), axis at start and at end (unit vectors from the end to the spindle)
    cutter : (3,) float, mm   radius, corner radius, length of the flutes   mark : left on the cells of the new surface
    told : (n, TOLD) float   Filled with what each piece did.
    """
    for n in range(first, path.shape[0]):
        start, end, axis0, axis1 = path[n, 0:3], path[n, 3:6], path[n, 6:9], path[n, 9:12]
        parts = pieces_of(start, end, axis0, axis1, cutter[0], cutter[2], blocks.size[0])
        for part in range(parts):
            sweep = sweep_of(start, end, axis0, axis1, part / parts, (part + 1) / parts, cutter, blocks.size[0])
            if not has_room(blocks, sweep):
                return n  # what is cut already of this piece is cut again: no harm
            remove_sweep(blocks, guard, sweep, mark, told[n])
    return int(path.shape[0])


@njit(cache=True, nogil=True)
def box_of(blocks: Blocks, sweep: Sweep) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last (exclusive) entries of the directory, (3,) each, that a sweep can change."""
    low, high = sweep_box(sweep, blocks.size[1])
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for d in range(3):
        entries = blocks.directory.shape[d]
        first[d] = min(max(0, int(np.floor((low[d] - blocks.origin[d]) / blocks.size[0])) >> SHIFT), entries)
        last[d] = max(first[d], min(entries, (int(np.ceil((high[d] - blocks.origin[d]) / blocks.size[0])) >> SHIFT) + 1))
    return first, last


@njit(cache=True, nogil=True)
def room_wanted(blocks: Blocks, sweep: Sweep) -> int:
    """How many blocks a sweep may open at most: those of full metal that it comes near."""
    first, last = box_of(blocks, sweep)
    return int((blocks.directory[first[0] : last[0], first[1] : last[1], first[2] : last[2]] == METAL).sum())


@njit(cache=True, nogil=True)
def room_of(blocks: Blocks, piece: Array, cutter: Array) -> int:
    """How many blocks a piece of path, (12,), may open at most."""
    start, end, axis0, axis1 = piece[0:3], piece[3:6], piece[6:9], piece[9:12]
    parts = pieces_of(start, end, axis0, axis1, cutter[0], cutter[2], blocks.size[0])
    room = 0
    for part in range(parts):
        room += room_wanted(blocks, sweep_of(start, end, axis0, axis1, part / parts, (part + 1) / parts, cutter, blocks.size[0]))
    return room


@njit(cache=True, nogil=True)
def has_room(blocks: Blocks, sweep: Sweep) -> bool:
    """Whether all blocks that a sweep may open fit in."""
    room = blocks.count[0] + blocks.value.shape[0] - blocks.count[1]
    first, last = box_of(blocks, sweep)
    box = (last[0] - first[0]) * (last[1] - first[1]) * (last[2] - first[2])
    return bool(room >= box or room >= room_wanted(blocks, sweep))


@njit(cache=True, nogil=True)
def remove_sweep(blocks: Blocks, guard: Blocks, sweep: Sweep, mark: int, told: Array) -> None:
    """Cut one sweep. Blocks of air are passed over, blocks inside the sweep become air; only the rest is looked at cell by cell."""
    first, last = box_of(blocks, sweep)
    if is_plain(sweep) and sweep.uz >= UPRIGHT:
        remove_upright(blocks, guard, sweep, first, last, mark, told)
        return
    cell, band = blocks.size[0], blocks.size[1]
    middle, half = 0.5 * (BLOCK - 1) * cell, HALF_DIAGONAL * cell
    for a in range(first[0], last[0]):
        x = blocks.origin[0] + a * BLOCK * cell + middle
        for b in range(first[1], last[1]):
            y = blocks.origin[1] + b * BLOCK * cell + middle
            for c in range(first[2], last[2]):
                if blocks.directory[a, b, c] == AIR:
                    continue
                z = blocks.origin[2] + c * BLOCK * cell + middle
                if sweep_bound(sweep, x, y, z) - half >= band:
                    continue
                near = sweep_distance(sweep, x, y, z)
                if near - half >= band:
                    continue
                if near + half <= -band:
                    remove_block(blocks, guard, a, b, c, told)
                else:
                    remove_cells(blocks, guard, sweep, a, b, c, mark, told)


@njit(cache=True, nogil=True)
def remove_cells(blocks: Blocks, guard: Blocks, sweep: Sweep, a: int, b: int, c: int, mark: int, told: Array) -> None:
    """Cut the eighths of a block in which the sweep goes deeper than some cell's distance."""
    cell, band = blocks.size[0], blocks.size[1]
    half, middle = PART_DIAGONAL * cell, 0.5 * (PART - 1) * cell
    cleared = False
    for i in range(0, BLOCK, PART):
        for j in range(0, BLOCK, PART):
            for k in range(0, BLOCK, PART):
                block = int(blocks.directory[a, b, c])
                least = np.float32(-band)
                if block >= 0:
                    part = blocks.value[block, i : i + PART, j : j + PART, k : k + PART]
                    least = part.min()
                if least >= np.float32(band):
                    continue
                x, y, z = place_of(blocks, a, b, c, i, j, k)
                if half - sweep_bound(sweep, x + middle, y + middle, z + middle) <= least:
                    continue
                if half - sweep_distance(sweep, x + middle, y + middle, z + middle) <= least:
                    continue
                cleared |= remove_part(blocks, guard, sweep, a, b, c, i, j, k, mark, told)
    if cleared:
        drop_air(blocks, a, b, c)


@njit(cache=True, nogil=True)
def remove_part(
    blocks: Blocks, guard: Blocks, sweep: Sweep, a: int, b: int, c: int, i0: int, j0: int, k0: int, mark: int, told: Array
) -> bool:  # fmt: skip
    """Cut one eighth of a block cell by cell; whether cells became air beyond the band."""
    band, plain = blocks.size[1], is_plain(sweep)
    block = int(blocks.directory[a, b, c])
    cleared = False
    for i in range(i0, i0 + PART):
        for j in range(j0, j0 + PART):
            for k in range(k0, k0 + PART):
                value = -band if block < 0 else float(blocks.value[block, i, j, k])
                if value >= band:
                    continue
                told[LOOKED] += 1
                x, y, z = place_of(blocks, a, b, c, i, j, k)
                inside = -sweep_bound(sweep, x, y, z)
                if inside <= value:
                    continue
                if not plain:
                    inside = -sweep_distance(sweep, x, y, z)
                    if inside <= value:
                        continue
                if block < 0:
                    block = open_block(blocks, a, b, c)
                cut_cell(blocks, guard, a, b, c, i, j, k, value, inside, mark, told)
                blocks.touched[a, b, c] = True
                cleared |= inside >= band
    return cleared
