"""Metal removed where a turning cutter sweeps: the stock minus the swept volume, block by block."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.process.field import AIR, BLOCK, METAL, SHIFT, Blocks, drop_block, open_block
from sim.process.sweep import Sweep, is_plain, pieces_of, sweep_bound, sweep_box, sweep_distance, sweep_of

Array = NDArray[np.float64]

HALF_DIAGONAL = 0.5 * np.sqrt(3.0) * (BLOCK - 1)  # cells, from the middle of a block to its farthest cell
TOUCH = 0.02  # of a cell: a cutter that takes less, or goes below the target by less, only rounds differently
ENGAGED, GOUGE, REMOVED = 0, 1, 2  # columns of what a piece did
ENGAGED_AT, GOUGE_AT = 3, 6  # first of three
TOLD = 9  # columns


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
    cell, band = blocks.size[0], blocks.size[1]
    middle, half = 0.5 * (BLOCK - 1) * cell, HALF_DIAGONAL * cell
    first, last = box_of(blocks, sweep)
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
def remove_cells(blocks: Blocks, guard: Blocks, sweep: Sweep, a: int, b: int, c: int, mark: int, told: Array) -> None:
    """Cut the cells of a block that the surface of the sweep comes near to."""
    cell, band = blocks.size[0], blocks.size[1]
    plain = is_plain(sweep)
    block = int(blocks.directory[a, b, c])
    is_guarded = guard.directory[a, b, c] != AIR
    cleared = False
    for i in range(BLOCK):
        x = blocks.origin[0] + (a * BLOCK + i) * cell
        for j in range(BLOCK):
            y = blocks.origin[1] + (b * BLOCK + j) * cell
            k = 0
            while k < BLOCK:
                value = -band if block < 0 else float(blocks.value[block, i, j, k])
                if value >= band:
                    k += 1
                    continue
                z = blocks.origin[2] + (c * BLOCK + k) * cell
                inside = -sweep_bound(sweep, x, y, z)
                if inside <= value:
                    k += 1 + int(max(0.0, -inside - band) / cell)  # as many cells further the distance is still beyond the band
                    continue
                if not plain:
                    inside = -sweep_distance(sweep, x, y, z)
                    if inside <= value:
                        k += 1
                        continue
                if block < 0:
                    block = open_block(blocks, a, b, c)
                told[REMOVED] += (filled(value, cell) - filled(inside, cell)) * cell**3
                if inside > 0.0 and value < 0.0:
                    tell(told, ENGAGED, ENGAGED_AT, min(inside, -value), x, y, z)
                if is_guarded:
                    tell(told, GOUGE, GOUGE_AT, gouge_of(guard, a, b, c, i, j, k, inside - value, inside), x, y, z)
                cleared |= inside >= band
                blocks.value[block, i, j, k] = np.float32(min(band, inside))
                blocks.mark[block, i, j, k] = np.int16(mark)
                k += 1
    if cleared and (blocks.value[block] >= np.float32(band)).all():
        drop_block(blocks, a, b, c, AIR)
