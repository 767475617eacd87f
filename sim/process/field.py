"""Sparse signed distance: cells in blocks of 8 x 8 x 8, kept only near a surface; the rest is one word per block, air or metal."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.process.blocks import (
    AIR,
    BLOCK,
    MASK,
    METAL,
    SHIFT,
    Blocks,
    block_range,
    distance_at,
    drop_block,
    gradient_at,
    mark_at,
    open_block,
    put,
    settle,
    value_at,
)
from sim.process.redistance import redistance

__all__ = [
    "AIR",
    "BLOCK",
    "MASK",
    "METAL",
    "SHIFT",
    "Blocks",
    "Field",
    "block_range",
    "distance_at",
    "drop_block",
    "gradient_at",
    "mark_at",
    "open_block",
    "put",
    "settle",
    "value_at",
]

Array = NDArray[np.float64]
Index = NDArray[np.int64]

FIRST_BLOCKS = 64
DUE_SHARE, DUE_BLOCKS = 0.5, 1024  # so many of the blocks in use, and more, may be written to before what metal buried is given back
GROWTH = 1.5  # of the room for blocks; pages that no block has used yet take no memory


@njit(cache=True, nogil=True)
def _distances(blocks: Blocks, points: Array) -> Array:
    out = np.empty(points.shape[0])
    for n in range(points.shape[0]):
        out[n] = distance_at(blocks, points[n, 0], points[n, 1], points[n, 2])
    return out


@njit(cache=True, nogil=True)
def _gradients(blocks: Blocks, points: Array) -> Array:
    out = np.empty((points.shape[0], 3))
    for n in range(points.shape[0]):
        out[n, 0], out[n, 1], out[n, 2] = gradient_at(blocks, points[n, 0], points[n, 1], points[n, 2])
    return out


@njit(cache=True, nogil=True)
def _marks(blocks: Blocks, points: Array) -> NDArray[np.int16]:
    """Mark of the cell nearest to the surface round each point, which first goes to the surface along the gradient."""
    out = np.zeros(points.shape[0], np.int16)
    cell = blocks.size[0]
    for n in range(points.shape[0]):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        gx, gy, gz = gradient_at(blocks, x, y, z)
        steep = gx * gx + gy * gy + gz * gz
        if steep > 0.0:
            step = distance_at(blocks, x, y, z) / max(steep, 0.25)
            x, y, z = x - step * gx, y - step * gy, z - step * gz
        i = int(np.floor((x - blocks.origin[0]) / cell))
        j = int(np.floor((y - blocks.origin[1]) / cell))
        k = int(np.floor((z - blocks.origin[2]) / cell))
        least = np.inf
        for a in range(2):
            for b in range(2):
                for c in range(2):
                    value = abs(value_at(blocks, i + a, j + b, k + c))
                    if value < least:
                        least = value
                        out[n] = np.int16(mark_at(blocks, i + a, j + b, k + c))
    return out


@njit(cache=True, nogil=True)
def _fill_window(blocks: Blocks, low: Index, window: NDArray[np.float32]) -> None:
    first, last = block_range(blocks, low, low + np.array(window.shape))
    for a in range(first[0], last[0]):
        for b in range(first[1], last[1]):
            for c in range(first[2], last[2]):
                block = blocks.directory[a, b, c]
                if block == AIR:
                    continue
                for i in range(max(a * BLOCK, low[0]), min((a + 1) * BLOCK, low[0] + window.shape[0])):
                    for j in range(max(b * BLOCK, low[1]), min((b + 1) * BLOCK, low[1] + window.shape[1])):
                        for k in range(max(c * BLOCK, low[2]), min((c + 1) * BLOCK, low[2] + window.shape[2])):
                            value = -blocks.size[1] if block == METAL else blocks.value[block, i & MASK, j & MASK, k & MASK]
                            window[i - low[0], j - low[1], k - low[2]] = value


class Field:
    """A narrow-band signed distance on a grid whose far cells cost nothing.

    origin : (3,) float, mm   Centre of cell (0, 0, 0).
    cell_mm : edge of a cell; band_mm : values end here, on both sides of the surface
    cells : (3,) int   Wanted extent; `shape` is rounded up to whole blocks.
    """

    def __init__(self, origin: Array, cell_mm: float, band_mm: float, cells: tuple[int, ...] | Index) -> None:
        self.origin: Array = np.array(origin, dtype=np.float64)
        self.cell_mm = float(cell_mm)
        self.band_mm = float(np.float32(band_mm))  # cells hold it exactly
        entries = tuple(max(1, -(-int(n) // BLOCK)) for n in cells)
        self.shape: tuple[int, int, int] = (entries[0] * BLOCK, entries[1] * BLOCK, entries[2] * BLOCK)
        self._take(np.full(entries, AIR, dtype=np.int32), FIRST_BLOCKS, np.zeros(2, dtype=np.int64), np.zeros(entries, np.bool_))

    def _take(self, directory: NDArray[np.int32], room: int, count: Index, touched: NDArray[np.bool_]) -> None:
        shape = (room, BLOCK, BLOCK, BLOCK)
        self._blocks = Blocks(
            directory, np.empty(shape, np.float32), np.empty(shape, np.int16), np.empty(room, np.int32), count, self.origin,
            np.array([self.cell_mm, self.band_mm]), touched,
        )  # fmt: skip

    @property
    def blocks(self) -> Blocks:
        """The arrays for kernels; `reserve` may replace them."""
        return self._blocks

    def reserve(self, low: Index, high: Index) -> None:
        """Make room so that every block of a box of cells can be opened. low, high : (3,) int, high exclusive."""
        first, last = block_range(self._blocks, np.asarray(low, dtype=np.int64), np.asarray(high, dtype=np.int64))
        window = self._blocks.directory[first[0] : last[0], first[1] : last[1], first[2] : last[2]]
        self.reserve_blocks(int(np.count_nonzero(window < 0)))

    def reserve_blocks(self, more: int) -> None:
        """Make room for so many more blocks."""
        old = self._blocks
        used = int(old.count[1])
        room = len(old.value)
        if int(old.count[0]) + room - used >= more:
            return
        self._take(old.directory, max(used + more, int(GROWTH * room)), old.count, old.touched)
        self._blocks.value[:used], self._blocks.mark[:used] = old.value[:used], old.mark[:used]
        self._blocks.free[: old.count[0]] = old.free[: old.count[0]]

    def refresh(self) -> None:
        """Bring the cells near what was changed back to distances (`redistance`) and give uniform blocks back; measures do it by themselves."""
        if self._blocks.touched.any():
            redistance(self._blocks)
            self._blocks.touched[:] = False

    def refresh_if_due(self) -> None:
        """`refresh` when much was written to since the last time: memory stays in proportion to the surface, the cost to what is written."""
        if np.count_nonzero(self._blocks.touched) > DUE_SHARE * (self._blocks.count[1] - self._blocks.count[0]) + DUE_BLOCKS:
            self.refresh()

    def dense(self, low: Index | tuple[int, ...], high: Index | tuple[int, ...]) -> NDArray[np.float32]:
        """Values of a window of cells, mm; beyond the grid +band. low, high : (3,) int, high exclusive."""
        first, last = np.asarray(low, dtype=np.int64), np.asarray(high, dtype=np.int64)
        window = np.full(tuple(np.maximum(last - first, 0)), self.band_mm, dtype=np.float32)
        _fill_window(self._blocks, first, window)
        return window

    def metal_box(self) -> Index:
        """(2, 3) int   Box of cells, high exclusive, of the blocks that are not all air, grown by one cell of air; may reach beyond the grid."""
        entries = np.argwhere(self._blocks.directory != AIR)
        if not len(entries):
            return np.zeros((2, 3), dtype=np.int64)
        return np.array([entries.min(axis=0) * BLOCK - 1, (entries.max(axis=0) + 1) * BLOCK + 1], dtype=np.int64)

    def slabs(self, thickness: int, overlap: int = 1) -> Iterator[tuple[int, NDArray[np.float32]]]:
        """Layers of cells of `metal_box` from the bottom up: index along z of the first one, and the values, mm.

        thickness : cells that a slab adds   overlap : cells that it repeats of the slab below (1: marching cubes meet)
        """
        self.refresh()
        low, high = self.metal_box()
        for k in range(int(low[2]), int(high[2]), thickness):
            first = max(int(low[2]), k - overlap)
            yield first, self.dense((low[0], low[1], first), (high[0], high[1], min(k + thickness, int(high[2]))))

    def distance(self, points: Array) -> Array:
        """Signed distance by trilinear interpolation, mm; beyond the grid that of the nearest cell. points : (n, 3) float, mm -> (n,) float"""
        self.refresh()
        out: Array = _distances(self._blocks, np.ascontiguousarray(points, dtype=np.float64))
        return out

    def gradient(self, points: Array) -> Array:
        """Gradient by differences over one cell; at a surface nearly its unit normal out of the metal. points : (n, 3) float, mm -> (n, 3) float"""
        self.refresh()
        out: Array = _gradients(self._blocks, np.ascontiguousarray(points, dtype=np.float64))
        return out

    def marks(self, points: Array) -> NDArray[np.int16]:
        """What made the surface next to each point (`Blocks.mark`). points : (n, 3) float, mm, within the band -> (n,) int16"""
        self.refresh()
        out: NDArray[np.int16] = _marks(self._blocks, np.ascontiguousarray(points, dtype=np.float64))
        return out

    def occupied(self) -> Index:
        """(m, 3) int   Entries of the directory with cells of their own: all blocks that hold a surface, and those within the band of one."""
        return np.asarray(np.argwhere(self._blocks.directory >= 0), dtype=np.int64)

    @property
    def memory_bytes(self) -> int:
        """Of the blocks ever used at the same time, and the directory."""
        cells = BLOCK**3 * (self._blocks.value.itemsize + self._blocks.mark.itemsize)
        return int(self._blocks.count[1]) * (cells + self._blocks.free.itemsize) + self._blocks.directory.nbytes

    def snapshot(self) -> dict[str, NDArray[np.generic]]:
        """The state: directory with blocks numbered in its own order, and their cells. Equal fields give equal snapshots."""
        directory = self._blocks.directory.copy()
        kept = directory >= 0
        numbers = directory[kept]
        directory[kept] = np.arange(len(numbers), dtype=np.int32)
        cells: dict[str, NDArray[np.generic]] = {"value": self._blocks.value[numbers], "mark": self._blocks.mark[numbers]}
        return {"directory": directory, **cells, "touched": self._blocks.touched.copy()}

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Go back to a snapshot. Raises ValueError when it is of another grid."""
        directory = np.array(state["directory"], dtype=np.int32)
        if directory.shape != self._blocks.directory.shape:
            raise ValueError(f"snapshot of a field of {directory.shape} blocks, this one has {self._blocks.directory.shape}")
        used = len(state["value"])
        touched = np.array(state.get("touched", directory >= 0), dtype=np.bool_)
        self._take(directory, max(used, FIRST_BLOCKS), np.array([0, used], dtype=np.int64), touched)
        self._blocks.value[:used], self._blocks.mark[:used] = state["value"], state["mark"]
