"""Motion cut into pieces for the metal: one cell's length of bead, straight runs of cutting. One pass over the arrays of a trace.

The pool follows the tip's speed with a delay: it forgets over the way of one radius of the spot. With v the speed of the pool,
dv/dt = (tip's speed - v) v / radius; at standstill v = radius / time: the pool swells as long as the light dwells, down to STILL_MM_S,
where heat leaves it as fast as it comes (choice). Light that has just come on finds no pool: it begins at FIRST_MM_S.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.process.bead import (
    AXIS,
    BASE_K,
    DOWN,
    END,
    LAID_COLUMNS,
    LINE,
    MOVE,
    PIECE_COLUMNS,
    POOL_SPEED,
    POWDER,
    POWER,
    SECONDS,
    START,
)  # fmt: skip

Array = NDArray[np.float64]

AXIS_TURN_COS = math.cos(math.radians(0.5))  # a piece ends where the tool axis has turned this far
CHORD_COS = math.cos(math.radians(0.6))  # a cut ends where the path has turned this far: 0.005 mm of chord on a piece of 0.5 mm
JOINED_MM = 1e-6
ROUNDING = 1e-6  # of a cell: what is left of a piece by rounding
STILL_MM_S = 1.0
FIRST_MM_S = 60.0
STILL_PIECE_S = 0.05  # longest piece: what a standing pool gathers in it is a few percent of a bead
DARK_W = 1.0
# the open piece of bead: a row as in `bead` with the sums of power and powder over time, and then
IS_OPEN, PATH, POOL, DARK_S, DARK_J = PIECE_COLUMNS, PIECE_COLUMNS + 1, PIECE_COLUMNS + 2, PIECE_COLUMNS + 3, PIECE_COLUMNS + 4
OPEN_BEAD_SIZE = PIECE_COLUMNS + 5
# columns of a cut; the open one has the same and IS_OPEN_CUT
CUT_START, CUT_END, CUT_AXIS0, CUT_AXIS1, CUT_LINE, CUT_TOOL = 0, 3, 6, 9, 12, 13
CUT_COLUMNS = 14
IS_OPEN_CUT = CUT_COLUMNS
OPEN_CUT_SIZE = CUT_COLUMNS + 1


@njit(cache=True, nogil=True)
def pool_speed(speed: float, before: float, radius_mm: float, seconds: float) -> float:
    """Speed of the pool (mm/s) after a time at the tip's speed: the exact solution of the law above."""
    goal = max(speed, STILL_MM_S)
    return goal / (1.0 + (goal / before - 1.0) * math.exp(-goal * seconds / radius_mm))


@njit(cache=True, nogil=True)
def in_build(rotation: Array, shift: Array, vectors: Array, row: int, out: Array, first: int) -> None:
    """A row of vectors (n, 3) of the table frame into out[first : first + 3], build frame."""
    for d in range(3):
        out[first + d] = rotation[d, 0] * vectors[row, 0] + rotation[d, 1] * vectors[row, 1] + rotation[d, 2] * vectors[row, 2] + shift[d]


@njit(cache=True, nogil=True)
def end_dark(state: Array, out: Array, count: int) -> int:
    """Write the time without a pool that has gone by; returns the next row."""
    if state[DARK_S] > 0.0:
        out[count] = 0.0
        out[count, SECONDS], out[count, POWER], out[count, MOVE] = state[DARK_S], state[DARK_J] / state[DARK_S], state[MOVE]
        state[DARK_S] = state[DARK_J] = 0.0
        count += 1
    return count


@njit(cache=True, nogil=True)
def end_bead(state: Array, out: Array, count: int, radius_mm: float) -> int:
    """Write the open piece of bead, if there is one; returns the next row."""
    if state[IS_OPEN] == 0.0:
        return count
    state[IS_OPEN] = 0.0
    seconds = state[SECONDS]
    if seconds <= 0.0:
        return count
    state[POOL] = pool_speed(state[PATH] / seconds, state[POOL], radius_mm, seconds)
    out[count] = state[:PIECE_COLUMNS]
    out[count, POWER], out[count, POWDER], out[count, POOL_SPEED] = state[POWER] / seconds, state[POWDER] / seconds, state[POOL]
    return count + 1


@njit(cache=True, nogil=True)
def most_pieces(length_mm: float, seconds: float, count: int, cell: float) -> int:
    """How many rows `bead_pieces` may need."""
    return int(length_mm / cell + seconds / STILL_PIECE_S) + 3 * count + 4


@njit(cache=True, nogil=True)
def bead_pieces(
    tip0: Array, tip1: Array, axes: Array, downs: Array, emission_w: Array, powder_g_min: Array, dt: Array, lines: NDArray[np.int64],
    rotation: Array, shift: Array, cell: float, min_power_w: float, radius_mm: float, state: Array, out: Array,
) -> int:  # fmt: skip
    """Cut the motion of a deposition head into pieces of one cell's length; standing time goes into them.

    tip0 .. lines : as in `Trace`   rotation (3, 3), shift (3,) mm : build from table   radius_mm : of the spot
    state : (OPEN_BEAD_SIZE,) float, what is still growing   out : (n, PIECE_COLUMNS) float, rows of `bead.lay`; returns how many
    """
    count = 0
    state[MOVE] = -1.0
    zero = np.zeros(3)
    a, b, axis, down = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(dt.shape[0]):
        if emission_w[i] < max(min_power_w, DARK_W):
            count = end_bead(state, out, count, radius_mm)
            state[POOL] = FIRST_MM_S
            state[DARK_S] += dt[i]
            state[DARK_J] += dt[i] * emission_w[i]
            continue
        count = end_dark(state, out, count)
        in_build(rotation, shift, tip0, i, a, 0)
        in_build(rotation, shift, tip1, i, b, 0)
        in_build(rotation, zero, axes, i, axis, 0)
        in_build(rotation, zero, downs, i, down, 0)
        if state[IS_OPEN] == 1.0 and not goes_on(state[END : END + 3], state[AXIS : AXIS + 3], a, axis):
            count = end_bead(state, out, count, radius_mm)
        state[MOVE] = float(i)
        length = math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
        done = 0.0
        while done < 1.0 - 1e-9:
            if state[IS_OPEN] == 0.0:
                state[IS_OPEN] = 1.0
                state[START : START + 3] = a + done * (b - a)
                state[AXIS : AXIS + 3], state[DOWN : DOWN + 3] = axis, down
                state[PATH] = state[SECONDS] = state[POWER] = state[POWDER] = 0.0
                state[LINE] = lines[i]
            take = 1.0 - done
            if length > 0.0:
                take = min(take, (cell - state[PATH]) / length)
            if dt[i] > 0.0:
                take = min(take, (STILL_PIECE_S - state[SECONDS]) / dt[i])
            take = max(take, 0.0)
            done += take
            if length * (1.0 - done) < ROUNDING * cell and dt[i] * (1.0 - done) < ROUNDING * STILL_PIECE_S:
                take, done = take + 1.0 - done, 1.0
            state[END : END + 3] = a + done * (b - a)
            state[PATH] += take * length
            state[SECONDS] += take * dt[i]
            state[POWER] += take * dt[i] * emission_w[i]
            state[POWDER] += take * dt[i] * powder_g_min[i]
            if state[PATH] >= cell * (1.0 - ROUNDING) or state[SECONDS] >= STILL_PIECE_S * (1.0 - ROUNDING):
                count = end_bead(state, out, count, radius_mm)
    return end_dark(state, out, count)


@njit(cache=True, nogil=True)
def by_move(rows: Array, laid: Array, emission_w: Array, least_w: float, last: Array, base_k: float) -> Array:
    """(k, LAID_COLUMNS) what was laid by piece of the trace: of the last piece of bead that ended in it or before; NaN without light.

    rows, laid : (n, ...) pieces of bead and what they laid   last : (LAID_COLUMNS,) float, the last one before; changed in place
    """
    count = emission_w.shape[0]
    out = np.full((count, LAID_COLUMNS), np.nan)
    n = 0
    for i in range(count):
        while n < rows.shape[0] and rows[n, MOVE] <= i:
            if rows[n, POOL_SPEED] > 0.0:
                last[:] = laid[n]
            n += 1
        if emission_w[i] >= least_w:
            out[i] = last
            out[i, BASE_K] = last[BASE_K]
        else:
            out[i, BASE_K] = base_k
    return out


@njit(cache=True, nogil=True)
def goes_on(end: Array, axis0: Array, start: Array, axis: Array) -> bool:
    """Whether motion from `start` joins a piece that ends at `end` without a turn of the axis."""
    gap = max(abs(start[0] - end[0]), abs(start[1] - end[1]), abs(start[2] - end[2]))
    return bool(gap < JOINED_MM and axis[0] * axis0[0] + axis[1] * axis0[1] + axis[2] * axis0[2] > AXIS_TURN_COS)


@njit(cache=True, nogil=True)
def end_cut(state: Array, out: Array, count: int) -> int:
    """Write the open cut, if there is one; returns the next row."""
    if state[IS_OPEN_CUT] == 0.0:
        return count
    out[count] = state[:CUT_COLUMNS]
    state[IS_OPEN_CUT] = 0.0
    return count + 1


@njit(cache=True, nogil=True)
def cut_pieces(
    tip0: Array, tip1: Array, axes0: Array, axes1: Array, lines: NDArray[np.int64], rotation: Array, shift: Array, tool: int,
    longest_mm: float, state: Array, out: Array,
) -> int:  # fmt: skip
    """Join the motion of a cutter into straight runs of one line, about `longest_mm` long at most.

    tip0 .. lines : as in `Trace`   rotation (3, 3), shift (3,) mm : build from table
    state : (OPEN_CUT_SIZE,) float, what is still growing   out : (n, CUT_COLUMNS) float, filled; returns how many
    """
    count = 0
    zero = np.zeros(3)
    a, b, axis0, axis1 = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(lines.shape[0]):
        in_build(rotation, shift, tip0, i, a, 0)
        in_build(rotation, shift, tip1, i, b, 0)
        step = b - a
        length = math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
        if length <= JOINED_MM:
            continue
        in_build(rotation, zero, axes0, i, axis0, 0)
        in_build(rotation, zero, axes1, i, axis1, 0)
        if state[IS_OPEN_CUT] == 1.0:
            chord = state[CUT_END : CUT_END + 3] - state[CUT_START : CUT_START + 3]
            extent = math.sqrt(chord[0] ** 2 + chord[1] ** 2 + chord[2] ** 2)
            straight = chord[0] * step[0] + chord[1] * step[1] + chord[2] * step[2] > CHORD_COS * extent * length
            same = state[CUT_LINE] == lines[i] and state[CUT_TOOL] == tool
            if not (same and straight and goes_on(state[CUT_END : CUT_END + 3], state[CUT_AXIS0 : CUT_AXIS0 + 3], a, axis1)):
                count = end_cut(state, out, count)
        if state[IS_OPEN_CUT] == 0.0:
            state[IS_OPEN_CUT] = 1.0
            state[CUT_START : CUT_START + 3], state[CUT_AXIS0 : CUT_AXIS0 + 3] = a, axis0
            state[CUT_LINE], state[CUT_TOOL] = lines[i], tool
        state[CUT_END : CUT_END + 3], state[CUT_AXIS1 : CUT_AXIS1 + 3] = b, axis1
        chord = state[CUT_END : CUT_END + 3] - state[CUT_START : CUT_START + 3]
        if math.sqrt(chord[0] ** 2 + chord[1] ** 2 + chord[2] ** 2) >= longest_mm:
            count = end_cut(state, out, count)
    return count
