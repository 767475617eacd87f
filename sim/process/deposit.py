"""Beads on a stock: pieces of bead laid down in order of time, with the stock's books kept; and one straight track by itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.process.bead import (
    AXIS,
    DOWN,
    END,
    PIECE_COLUMNS,
    POOL_SPEED,
    POWDER,
    POWER,
    SECONDS,
    START,
    PoolLaw,
    lay_pieces,
)
from sim.process.heat import cold_state
from sim.process.stock import Stock

Array = NDArray[np.float64]

DOWNWARD = (0.0, 0.0, -1.0)


def deposit_pieces(stock: Stock, law: PoolLaw, pieces: Array, mark_of_line: NDArray[np.int16], state: Array) -> Array:
    """Add metal along pieces in order of time; returns what was laid, (n, bead.LAID_COLUMNS).

    pieces : (n, bead.PIECE_COLUMNS) float   mark_of_line : (m,) int16, mark by N-word; lines beyond it are marked 1
    state : (2,) float, temperature K and mass g of `heat`, changed in place
    """
    laid, caught, stuck = lay_pieces(stock.field, law, pieces, mark_of_line, state)
    stock.deposited_mm3 += stuck
    stock.lost_powder_mm3 += max(0.0, caught - stuck)
    return laid


def deposit(
    stock: Stock, law: PoolLaw, start: Array, end: Array, axis: Array, power_w: float, powder_g_min: float, seconds: float,
    *, down: tuple[float, float, float] | Array = DOWNWARD, mark: int = 1, state: Array | None = None,
) -> float:  # fmt: skip
    """Add metal along one straight piece of the focus's path at steady speed; returns the volume that stuck, mm3.

    start, end : (3,) float, mm, build frame   axis : (3,) float, unit vector from the focus into the head   seconds : for the whole piece
    down : (3,) float, unit vector of gravity   mark : of the cells   state : of `heat`; None: the part is cold
    Any length: it is laid down in pieces of one cell's length, as the pool moves on.
    """
    length = float(np.linalg.norm(end - start))
    count = max(1, int(np.ceil(length / stock.cell_mm - 1e-9)))
    points = start + np.arange(count + 1)[:, None] / count * (end - start)
    pieces = np.zeros((count, PIECE_COLUMNS))
    pieces[:, START : START + 3], pieces[:, END : END + 3] = points[:-1], points[1:]
    pieces[:, AXIS : AXIS + 3], pieces[:, DOWN : DOWN + 3] = axis, down
    pieces[:, POWER], pieces[:, POWDER], pieces[:, SECONDS] = power_w, powder_g_min, seconds / count
    pieces[:, POOL_SPEED] = length / seconds
    before = stock.deposited_mm3
    deposit_pieces(stock, law, pieces, np.full(1, mark, dtype=np.int16), cold_state(law.heat) if state is None else state)
    return stock.deposited_mm3 - before
