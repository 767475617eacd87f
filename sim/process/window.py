"""A dense window of the stock, turned so that its columns run along the direction of the grid nearest to the tool axis, up towards the head.

Kernels that work column by column take cells out of the sparse field once for many pieces of bead, and give back what they changed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.process.field import AIR, BLOCK, MASK, SHIFT, Blocks, put, settle, value_at

Array = NDArray[np.float64]


class Frame(NamedTuple):
    """main : direction of the grid along which columns run   flipped : they run against it   length : cells along it
    x0 .. z0 : mm, centre of cell (0, 0, 0)."""

    main: int
    flipped: bool
    length: int
    x0: float
    y0: float
    z0: float


class Window(NamedTuple):
    """value : (nx, ny, nz) float32, mm   first : (3,) int, cell of the turned frame   low, high : (nx, ny) int32, cells of each column changed
    from low to high, low > high: none   x0.. : mm, centre of its first cell."""

    value: NDArray[np.float32]
    first: NDArray[np.int64]
    low: NDArray[np.int32]
    high: NDArray[np.int32]
    x0: float
    y0: float
    z0: float


@njit(cache=True, nogil=True)
def frame_of(blocks: Blocks, ax: float, ay: float, az: float) -> Frame:
    """The turned frame for a tool axis (unit vector)."""
    main = 2
    if abs(ax) > max(abs(ay), abs(az)):
        main = 0
    elif abs(ay) > abs(az):
        main = 1
    along = az if main == 2 else (ax if main == 0 else ay)
    length = blocks.directory.shape[main] * BLOCK
    z0 = blocks.origin[main]
    if along < 0.0:
        z0 = -(z0 + blocks.size[0] * (length - 1))
    return Frame(main, along < 0.0, length, blocks.origin[(main + 1) % 3], blocks.origin[(main + 2) % 3], z0)


@njit(cache=True, nogil=True)
def turned(frame: Frame, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector or a point of the build frame in the turned one."""
    if frame.main == 0:
        x, y, z = y, z, x
    elif frame.main == 1:
        x, y, z = z, x, y
    return x, y, -z if frame.flipped else z


@njit(cache=True, nogil=True)
def cell_of(frame: Frame, a: int, b: int, c: int) -> tuple[int, int, int]:
    """Index in the grid of a cell of the turned frame."""
    if frame.flipped:
        c = frame.length - 1 - c
    if frame.main == 2:
        return a, b, c
    if frame.main == 0:
        return c, a, b
    return b, c, a


@njit(cache=True, nogil=True)
def open_window(blocks: Blocks, frame: Frame, low: NDArray[np.int64], high: NDArray[np.int64]) -> Window:
    """Take out the cells of a box of the turned frame. low, high : (3,) int, high exclusive."""
    nx, ny, nz = max(0, high[0] - low[0]), max(0, high[1] - low[1]), max(0, high[2] - low[2])
    value = np.empty((nx, ny, nz), np.float32)
    bx, by, bz = blocks.directory.shape
    band = np.float32(blocks.size[1])
    plain = frame.main == 2 and not frame.flipped and low[0] >= 0 and low[1] >= 0 and low[2] >= 0
    plain = plain and high[0] <= bx * BLOCK and high[1] <= by * BLOCK and high[2] <= bz * BLOCK
    for i in range(nx):
        a = low[0] + i
        for j in range(ny):
            b = low[1] + j
            column = value[i, j]
            if plain:
                k = 0
                while k < nz:
                    c = low[2] + k
                    stop = min(nz, k + BLOCK - (c & MASK))
                    block = blocks.directory[a >> SHIFT, b >> SHIFT, c >> SHIFT]
                    if block >= 0:
                        cells = blocks.value[block, a & MASK, b & MASK]
                        for n in range(k, stop):
                            column[n] = cells[(low[2] + n) & MASK]
                    else:
                        column[k:stop] = band if block == AIR else -band
                    k = stop
            else:
                for k in range(nz):
                    x, y, z = cell_of(frame, a, b, low[2] + k)
                    column[k] = value_at(blocks, x, y, z)
    cell = blocks.size[0]
    return Window(
        value, low.copy(), np.full((nx, ny), 2**30, np.int32), np.full((nx, ny), -1, np.int32),
        frame.x0 + low[0] * cell, frame.y0 + low[1] * cell, frame.z0 + low[2] * cell,
    )  # fmt: skip


@njit(cache=True, nogil=True)
def close_window(blocks: Blocks, frame: Frame, window: Window, mark: int) -> None:
    """Give the changed cells back, with a mark; blocks that are all metal now go back. The field has to have room for their blocks."""
    nx, ny = window.low.shape
    low, high = np.full(3, np.iinfo(np.int64).max), np.full(3, -1)
    for i in range(nx):
        for j in range(ny):
            for k in range(window.low[i, j], window.high[i, j] + 1):
                x, y, z = cell_of(frame, window.first[0] + i, window.first[1] + j, window.first[2] + k)
                value = window.value[i, j, k]
                if value != np.float32(value_at(blocks, x, y, z)):
                    put(blocks, x, y, z, value, mark)
                    low[0], low[1], low[2] = min(low[0], x), min(low[1], y), min(low[2], z)
                    high[0], high[1], high[2] = max(high[0], x + 1), max(high[1], y + 1), max(high[2], z + 1)
            window.low[i, j], window.high[i, j] = 2**30, -1
    if high[0] > 0:
        settle(blocks, low, high)
