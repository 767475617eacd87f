"""Solids put into a sparse field: boxes, other fields, and anything with a signed distance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.process.field import AIR, BLOCK, METAL, Blocks, Field, block_range, drop_block, open_block, settle

Array = NDArray[np.float64]
Index = NDArray[np.int64]

HALF_DIAGONAL = 0.5 * np.sqrt(3.0) * (BLOCK - 1)  # cells, from the middle of a block to its farthest cell
BATCH = 256  # blocks whose cells are looked at at once


def cells_of(field: Field, box_mm: Array | None) -> tuple[Index, Index]:
    """Box of cells, (3,) int each, high exclusive, that a solid in a box changes. box_mm : (2, 3) float, mm; None: the whole grid."""
    if box_mm is None:
        return np.zeros(3, dtype=np.int64), np.array(field.shape, dtype=np.int64)
    reach = field.band_mm + field.cell_mm
    low = np.floor((box_mm[0] - reach - field.origin) / field.cell_mm)
    high = np.ceil((box_mm[1] + reach - field.origin) / field.cell_mm) + 1
    return np.clip(low, 0, field.shape).astype(np.int64), np.clip(high, 0, field.shape).astype(np.int64)


def unite(field: Field, distance_of: Callable[[Array], Array], box_mm: Array | None = None) -> None:
    """Unite with a solid that is given by its signed distance.

    distance_of : points (n, 3) float, mm -> (n,) float, mm, negative inside; must not change by more than the way between two points
    box_mm : (2, 3) float, mm   Corners of a box that holds the solid; None: the whole grid.
    """
    low, high = cells_of(field, box_mm)
    first, last = block_range(field.blocks, low, high)
    entries = np.stack(np.meshgrid(*(np.arange(a, b) for a, b in zip(first, last, strict=True)), indexing="ij"), axis=-1).reshape(-1, 3)
    entries = entries[field.blocks.directory[tuple(entries.T)] != METAL]
    if not len(entries):
        return
    middle = distance_of(field.origin + (entries * BLOCK + 0.5 * (BLOCK - 1)) * field.cell_mm)
    half = HALF_DIAGONAL * field.cell_mm
    for a, b, c in entries[middle + half <= -field.band_mm]:
        drop_block(field.blocks, a, b, c, METAL)
    near = entries[np.abs(middle) - half < field.band_mm]
    field.reserve_blocks(len(near))
    inner = np.stack(np.meshgrid(*(np.arange(BLOCK),) * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    for n in range(0, len(near), BATCH):
        batch = near[n : n + BATCH]
        points = field.origin + (batch[:, None] * BLOCK + inner).reshape(-1, 3) * field.cell_mm
        _unite_values(field.blocks, batch, distance_of(points).reshape(len(batch), BLOCK, BLOCK, BLOCK))
    settle(field.blocks, low, high)


def unite_box(field: Field, box_mm: Array, frame: Array) -> None:
    """Unite with a box. box_mm : (2, 3) float, mm, corners in its own frame; frame : (4, 4) float, from the field's frame to the box's."""
    corners = np.array([[box_mm[i, 0], box_mm[j, 1], box_mm[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    placed = (corners - frame[:3, 3]) @ np.linalg.inv(frame[:3, :3]).T
    low, high = cells_of(field, np.array([placed.min(axis=0), placed.max(axis=0)]))
    first, last = block_range(field.blocks, low, high)
    frame = np.ascontiguousarray(frame, dtype=np.float64)
    box = np.ascontiguousarray(box_mm, dtype=np.float64)
    field.reserve_blocks(_box_blocks(field.blocks, box, frame, first, last, False))
    _box_blocks(field.blocks, box, frame, first, last, True)
    settle(field.blocks, low, high)


def unite_field(field: Field, other: Field) -> None:
    """Unite with another field on the same grid. Raises ValueError on another grid."""
    if other.shape != field.shape or not np.allclose(other.origin, field.origin) or other.cell_mm != field.cell_mm:
        raise ValueError(f"fields of {field.shape} and {other.shape} cells do not lie on the same grid")
    for a, b, c in np.argwhere(other.blocks.directory == METAL):
        drop_block(field.blocks, a, b, c, METAL)
    entries = other.occupied()
    entries = entries[field.blocks.directory[tuple(entries.T)] != METAL]
    field.reserve_blocks(len(entries))
    for n in range(0, len(entries), BATCH):
        batch = entries[n : n + BATCH]
        values = other.blocks.value[other.blocks.directory[tuple(batch.T)]]
        _unite_values(field.blocks, batch, values.astype(np.float64))
    settle(field.blocks, np.zeros(3, dtype=np.int64), np.array(field.shape, dtype=np.int64))


@njit(cache=True, nogil=True)
def _unite_values(blocks: Blocks, entries: Index, values: Array) -> None:
    """Least of the cells of some blocks and new values, (n, 8, 8, 8) mm."""
    band = blocks.size[1]
    for n in range(entries.shape[0]):
        block = open_block(blocks, entries[n, 0], entries[n, 1], entries[n, 2])
        for i in range(BLOCK):
            for j in range(BLOCK):
                for k in range(BLOCK):
                    value = np.float32(min(band, max(-band, values[n, i, j, k])))
                    if value < blocks.value[block, i, j, k]:
                        blocks.value[block, i, j, k] = value
                        blocks.mark[block, i, j, k] = np.int16(0)


@njit(cache=True, nogil=True)
def _box_distance(box: Array, frame: Array, x: float, y: float, z: float) -> float:
    """Distance to the nearest face of a box, mm, negative inside; beyond an edge that of the farther face."""
    most = -np.inf
    for d in range(3):
        at = frame[d, 0] * x + frame[d, 1] * y + frame[d, 2] * z + frame[d, 3]
        most = max(most, box[0, d] - at, at - box[1, d])
    return float(most)


@njit(cache=True, nogil=True)
def _box_blocks(blocks: Blocks, box: Array, frame: Array, first: Index, last: Index, write: bool) -> int:
    """Unite some blocks of the directory with a box; without `write` only count those that need cells."""
    cell, band = blocks.size[0], blocks.size[1]
    half = HALF_DIAGONAL * cell
    count = 0
    for a in range(first[0], last[0]):
        x = blocks.origin[0] + (a * BLOCK + 0.5 * (BLOCK - 1)) * cell
        for b in range(first[1], last[1]):
            y = blocks.origin[1] + (b * BLOCK + 0.5 * (BLOCK - 1)) * cell
            for c in range(first[2], last[2]):
                z = blocks.origin[2] + (c * BLOCK + 0.5 * (BLOCK - 1)) * cell
                middle = _box_distance(box, frame, x, y, z)
                if blocks.directory[a, b, c] == METAL or middle - half >= band:
                    continue
                if middle + half > -band:
                    count += blocks.directory[a, b, c] == AIR
                    if write:
                        _box_cells(blocks, box, frame, a, b, c)
                elif write:
                    drop_block(blocks, a, b, c, METAL)
    return count


@njit(cache=True, nogil=True)
def _box_cells(blocks: Blocks, box: Array, frame: Array, a: int, b: int, c: int) -> None:
    cell, band = blocks.size[0], blocks.size[1]
    block = open_block(blocks, a, b, c)
    for i in range(BLOCK):
        x = blocks.origin[0] + (a * BLOCK + i) * cell
        for j in range(BLOCK):
            y = blocks.origin[1] + (b * BLOCK + j) * cell
            for k in range(BLOCK):
                value = max(-band, _box_distance(box, frame, x, y, blocks.origin[2] + (c * BLOCK + k) * cell))
                if value < blocks.value[block, i, j, k]:
                    blocks.value[block, i, j, k] = np.float32(value)
                    blocks.mark[block, i, j, k] = np.int16(0)
