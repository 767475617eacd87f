"""Solids put into a sparse field: boxes, anything with a signed distance, and closed triangle meshes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.process.field import AIR, BLOCK, MASK, METAL, SHIFT, Blocks, Field, block_range, drop_block, open_block, settle
from sim.process.target import Target

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


def mesh_field(target: Target, like: Field) -> Field:
    """A closed mesh as a field on the grid of another one: exact within the band, slab by slab, memory in proportion to its surface."""
    field = Field(like.origin, like.cell_mm, like.band_mm, like.shape)
    nx, ny, nz = field.shape
    corners = np.ascontiguousarray(target.corners)
    low, high = corners[:, :, 0].min(axis=1), corners[:, :, 0].max(axis=1)
    for first in range(0, nx, BLOCK):
        origin = field.origin + np.array([first * field.cell_mm, 0.0, 0.0])
        end = origin[0] + (BLOCK - 1) * field.cell_mm
        near = np.flatnonzero((low <= end + field.band_mm) & (high >= origin[0] - field.band_mm))
        inside = target.inside_grid(origin, field.cell_mm, (BLOCK, ny, nz))
        gap = np.full((BLOCK, ny, nz), field.band_mm**2, dtype=np.float32)
        _squared_gaps(corners[near], origin, field.cell_mm, field.band_mm, gap)
        values = np.where(inside, -np.sqrt(gap), np.sqrt(gap))
        low_cell = np.array([first, 0, 0], dtype=np.int64)
        field.reserve_blocks(_slab_blocks(field.blocks, first >> SHIFT, values, False))
        _slab_blocks(field.blocks, first >> SHIFT, values, True)
        settle(field.blocks, low_cell, np.array([first + BLOCK, ny, nz], dtype=np.int64))
    return field


@njit(cache=True, nogil=True)
def _slab_blocks(blocks: Blocks, a: int, values: NDArray[np.float32], write: bool) -> int:
    """Set a slab of blocks from dense values, (8, ny, nz) mm; without `write` only count those that need cells."""
    band = np.float32(blocks.size[1])
    count = 0
    for b in range(blocks.directory.shape[1]):
        for c in range(blocks.directory.shape[2]):
            cells = values[:, b * BLOCK : (b + 1) * BLOCK, c * BLOCK : (c + 1) * BLOCK]
            least, most = cells.min(), cells.max()
            if least >= band:
                continue
            if most <= -band:
                if write:
                    drop_block(blocks, a, b, c, METAL)
                continue
            count += 1
            if write:
                blocks.value[open_block(blocks, a, b, c)] = cells
    return count


@njit(cache=True, nogil=True)
def _squared_gaps(corners: Array, origin: Array, cell: float, band: float, gap: NDArray[np.float32]) -> None:
    """Squared distance, mm2, of the cells of a slab to the nearest of some triangles, where less than what `gap` holds. corners : (m, 3, 3) mm."""
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for f in range(corners.shape[0]):
        for d in range(3):
            least = min(corners[f, 0, d], corners[f, 1, d], corners[f, 2, d]) - band
            most = max(corners[f, 0, d], corners[f, 1, d], corners[f, 2, d]) + band
            low[d] = max(0, int(np.ceil((least - origin[d]) / cell)))
            high[d] = min(gap.shape[d] - 1, int(np.floor((most - origin[d]) / cell)))
        reach = (band + HALF_DIAGONAL * cell) ** 2
        for j0 in range(low[1] & ~MASK, high[1] + 1, BLOCK):
            for k0 in range(low[2] & ~MASK, high[2] + 1, BLOCK):
                middle = origin + cell * (np.array([0.0, j0, k0]) + 0.5 * (BLOCK - 1))
                if triangle_distance2(middle[0], middle[1], middle[2], corners[f]) > reach:
                    continue
                for i in range(low[0], high[0] + 1):
                    for j in range(max(low[1], j0), min(high[1], j0 + MASK) + 1):
                        for k in range(max(low[2], k0), min(high[2], k0 + MASK) + 1):
                            away = triangle_distance2(origin[0] + i * cell, origin[1] + j * cell, origin[2] + k * cell, corners[f])
                            if away < gap[i, j, k]:
                                gap[i, j, k] = np.float32(away)


@njit(cache=True, nogil=True)
def triangle_distance2(x: float, y: float, z: float, corners: Array) -> float:
    """Squared distance of a point to a triangle, mm2 (Ericson, Real-Time Collision Detection, 5.1.5). corners : (3, 3) float, mm."""
    abx, aby, abz = corners[1, 0] - corners[0, 0], corners[1, 1] - corners[0, 1], corners[1, 2] - corners[0, 2]
    acx, acy, acz = corners[2, 0] - corners[0, 0], corners[2, 1] - corners[0, 1], corners[2, 2] - corners[0, 2]
    px, py, pz = x - corners[0, 0], y - corners[0, 1], z - corners[0, 2]
    d1, d2 = abx * px + aby * py + abz * pz, acx * px + acy * py + acz * pz
    bb, cc, bc = abx * abx + aby * aby + abz * abz, acx * acx + acy * acy + acz * acz, abx * acx + aby * acy + abz * acz
    d3, d4, d5, d6 = d1 - bb, d2 - bc, d1 - bc, d2 - cc
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        v, w = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        v, w = 1.0, 0.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v, w = d1 / (d1 - d3), 0.0
    elif d6 >= 0.0 and d5 <= d6:
        v, w = 0.0, 1.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        v, w = 0.0, d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1.0 - w
    else:
        total = va + vb + vc
        v, w = (vb / total, vc / total) if total > 0.0 else (0.0, 0.0)
    rx, ry, rz = px - v * abx - w * acx, py - v * aby - w * acy, pz - v * abz - w * acz
    return float(rx * rx + ry * ry + rz * rz)
