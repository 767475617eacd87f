"""Kernels of the motion planner: blocks in a ring, junction speeds, look-ahead, and the exact advance along trapezoids.

Source: junction deviation and the two-pass look-ahead as grbl 1.1 (planner.c); written anew on path length in the norm of all axes.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

AXES_MAX = 6
# columns of a block
LENGTH, PROGRAMMED, CAP, ACCELERATION, JUNCTION, ENTRY, IS_RAPID, LINE, SET_MASK, CLEAR_MASK = range(10)
UNIT = 10
TARGET = UNIT + AXES_MAX
BLOCK_COLUMNS = TARGET + AXES_MAX
# places of the state
HEAD, COUNT, DISTANCE, SPEED, OUTPUTS, IS_STARTED = range(6)
END = 6  # end of the last planned block
STATE_SIZE = END + AXES_MAX
# columns of a piece of motion
DURATION, PIECE_OUTPUTS, PIECE_LINE, PIECE_SPEED = range(4)
FROM = 4
TO = FROM + AXES_MAX
PIECE_PROGRAMMED, PIECE_CAP, PIECE_RAPID, PIECE_RPM = range(TO + AXES_MAX, TO + AXES_MAX + 4)  # path speeds; 1 for G0; spindle
PIECE_COLUMNS = PIECE_RPM + 1

LENGTH_MIN = 1e-6  # mm or deg; shorter moves are none
ROTARY_PIECE_DEG = 1.0  # a straight joint move bends the tip's path: 4 um at 100 mm radius per degree
TIME_EPS = 1e-12  # s
PLACE_EPS = 1e-9  # mm or deg: a place nearer to the end of a block is the end


@njit(cache=True)
def append(
    blocks: Floats,
    state: Floats,
    target: Floats,
    limits: Floats,
    deviation: float,
    kind: int,
    value: float,
    line: float,
    set_mask: float,
    clear_mask: float,
) -> bool:
    """Plan a move to `target` (n,); limits (n, 3): max velocity, max acceleration, 1 if rotary. False when it has no length."""  # fmt: skip
    n = limits.shape[0]
    slot = (int(state[HEAD]) + int(state[COUNT])) % blocks.shape[0]
    block = blocks[slot]
    length = linear = 0.0
    for i in range(n):
        delta = target[i] - state[END + i]
        block[UNIT + i] = delta
        block[TARGET + i] = target[i]
        length += delta * delta
        if limits[i, 2] == 0.0:
            linear += delta * delta
    length = np.sqrt(length)
    if length < LENGTH_MIN:
        return False
    cap = acceleration = np.inf
    for i in range(n):
        block[UNIT + i] /= length
        share = abs(block[UNIT + i])
        if share > 0.0:
            cap = min(cap, limits[i, 0] / share)
            acceleration = min(acceleration, limits[i, 1] / share)
        state[END + i] = target[i]
    programmed = cap
    if kind == 1:
        linear = np.sqrt(linear)
        programmed = value / 60.0 * length / (linear if linear > LENGTH_MIN else length)
    elif kind == 2:
        programmed = length / value
    block[LENGTH], block[PROGRAMMED], block[CAP], block[ACCELERATION] = length, programmed, cap, acceleration
    block[IS_RAPID], block[LINE], block[SET_MASK], block[CLEAR_MASK] = (
        1.0 if kind == 0 else 0.0,
        line,
        set_mask,
        clear_mask,
    )
    block[ENTRY] = block[JUNCTION] = 0.0
    if state[COUNT] > 0:
        block[JUNCTION] = junction_speed(blocks[(slot - 1) % blocks.shape[0]], block, limits, deviation)
    state[COUNT] += 1
    return True


@njit(cache=True)
def junction_speed(before: Floats, after: Floats, limits: Floats, deviation: float) -> float:
    """Greatest speed through the corner of two blocks for a given junction deviation (grbl 1.1 planner.c)."""
    n = limits.shape[0]
    cosine = 0.0
    turn = 0.0
    for i in range(n):
        cosine -= before[UNIT + i] * after[UNIT + i]
        turn += (after[UNIT + i] - before[UNIT + i]) ** 2
    if cosine < -0.999999:
        return float(np.inf)
    if cosine > 0.999999:
        return 0.0
    turn = np.sqrt(turn)
    acceleration = np.inf
    for i in range(n):
        share = abs(after[UNIT + i] - before[UNIT + i]) / turn
        if share > 0.0:
            acceleration = min(acceleration, limits[i, 1] / share)
    half_sine = np.sqrt(0.5 * (1.0 - cosine))
    return float(np.sqrt(acceleration * deviation * half_sine / (1.0 - half_sine)))


@njit(cache=True)
def nominal_speed(block: Floats, feed_override: float, rapid_override: float) -> float:
    """Speed that a block would have with endless room, in its own norm per second."""
    if block[IS_RAPID] == 1.0:
        return float(block[CAP] * rapid_override)
    return float(min(block[PROGRAMMED] * feed_override, block[CAP]))


@njit(cache=True)
def planned_s(blocks: Floats, state: Floats) -> float:
    """Time of the planned blocks at their programmed speeds, s, what is done of the first one taken off."""
    size = blocks.shape[0]
    head, total = int(state[HEAD]), 0.0
    for k in range(int(state[COUNT])):
        block = blocks[(head + k) % size]
        left = block[LENGTH] - (state[DISTANCE] if k == 0 else 0.0)
        total += left / nominal_speed(block, 1.0, 1.0)
    return total


@njit(cache=True)
def planned_before_s(blocks: Floats, state: Floats, line: float, feed_override: float, rapid_override: float) -> float:
    """Time of the planned blocks of lines before `line` without ramps and corners, s, what is done of the first one taken off."""
    size = blocks.shape[0]
    head, total = int(state[HEAD]), 0.0
    for k in range(int(state[COUNT])):
        block = blocks[(head + k) % size]
        if block[LINE] >= line:
            break
        left = block[LENGTH] - (state[DISTANCE] if k == 0 else 0.0)
        total += left / nominal_speed(block, feed_override, rapid_override)
    return total


@njit(cache=True)
def replan(blocks: Floats, state: Floats, feed_override: float, rapid_override: float) -> None:
    """Entry speeds of all blocks behind the executing one: last to first so that each can brake, first to last so that each can be reached."""
    size = blocks.shape[0]
    head, count = int(state[HEAD]), int(state[COUNT])
    exit_squared = 0.0
    for k in range(count - 1, 0, -1):
        block, before = blocks[(head + k) % size], blocks[(head + k - 1) % size]
        top = min(block[JUNCTION], nominal_speed(block, feed_override, rapid_override))
        top = min(top, nominal_speed(before, feed_override, rapid_override))
        exit_squared = min(top * top, exit_squared + 2.0 * block[ACCELERATION] * block[LENGTH])
        block[ENTRY] = np.sqrt(exit_squared)
    if count == 0:
        return
    first = blocks[head]
    reached = state[SPEED] ** 2 + 2.0 * first[ACCELERATION] * max(first[LENGTH] - state[DISTANCE], 0.0)
    for k in range(1, count):
        block = blocks[(head + k) % size]
        if block[ENTRY] ** 2 > reached:
            block[ENTRY] = np.sqrt(reached)
        reached = block[ENTRY] ** 2 + 2.0 * block[ACCELERATION] * block[LENGTH]


@njit(cache=True)
def next_phase(
    v: float, a: float, room: float, nominal: float, exit_speed: float, braking: bool
) -> tuple[float, float]:
    """Acceleration and duration of the next phase of constant acceleration; (0, 0) when standing still for good.

    v, a, nominal, exit_speed in path units/s(2), room in path units to the block's end. With `braking` the goal is standstill.
    """
    if braking:
        if v <= 0.0:
            return 0.0, 0.0
        if v * v <= 2.0 * a * room:
            return -a, v / a
        return -a, (v - np.sqrt(v * v - 2.0 * a * room)) / a
    if v > nominal * (1.0 + 1e-9):
        if v * v - nominal * nominal < 2.0 * a * room and v * v - exit_speed * exit_speed < 2.0 * a * room:
            return -a, (v - nominal) / a
        end = np.sqrt(max(v * v - 2.0 * a * room, 0.0))
        return -a, min((v - end) / a, 2.0 * room / (v + end))
    brake = (v * v - exit_speed * exit_speed) / (2.0 * a)
    if v > exit_speed and brake >= room - PLACE_EPS:
        end = max(np.sqrt(max(v * v - 2.0 * a * room, 0.0)), exit_speed)
        duration = 2.0 * room / (v + end)
        return (end - v) / duration, duration
    if v < nominal * (1.0 - 1e-9):
        peak = min(nominal, np.sqrt(0.5 * (v * v + exit_speed * exit_speed) + a * room))
        if peak > v * (1.0 + 1e-9):
            return a, (peak - v) / a
    return 0.0, (room - max(brake, 0.0)) / v


@njit(cache=True)
def write_pieces(out: Floats, row: int, block: Floats, state: Floats, rotary: Floats, a: float, duration: float) -> int:
    """Write one phase as pieces whose rotary axes turn at most ROTARY_PIECE_DEG, and move the state along. Returns the next row."""
    n = rotary.shape[0]
    v = state[SPEED]
    travelled = v * duration + 0.5 * a * duration * duration
    turned = 0.0
    for i in range(n):
        if rotary[i] > 0.0:
            turned = max(turned, abs(block[UNIT + i]) * travelled)
    if travelled > 0.0:  # parts of equal time: the longest has the greatest speed
        turned *= max(v, v + a * duration) * duration / travelled
    parts = max(1, min(int(np.ceil(turned / ROTARY_PIECE_DEG - 1e-9)), out.shape[0] - row))
    back = block[LENGTH] - state[DISTANCE]
    for k in range(parts):
        t0, t1 = duration * k / parts, duration * (k + 1) / parts
        s0, s1 = v * t0 + 0.5 * a * t0 * t0, v * t1 + 0.5 * a * t1 * t1
        piece = out[row + k]
        piece[DURATION], piece[PIECE_OUTPUTS], piece[PIECE_LINE] = t1 - t0, state[OUTPUTS], block[LINE]
        piece[PIECE_SPEED] = max(v + a * t1, 0.0)
        piece[PIECE_PROGRAMMED], piece[PIECE_CAP], piece[PIECE_RAPID] = block[PROGRAMMED], block[CAP], block[IS_RAPID]
        for i in range(n):
            piece[FROM + i] = block[TARGET + i] - block[UNIT + i] * (back - s0)
            piece[TO + i] = block[TARGET + i] - block[UNIT + i] * max(back - s1, 0.0)
    state[DISTANCE] += travelled
    state[SPEED] = max(v + a * duration, 0.0)
    return int(row + parts)


@njit(cache=True)
def advance(
    blocks: Floats,
    state: Floats,
    out: Floats,
    row: int,
    rotary: Floats,
    dt: float,
    braking: bool,
    feed_override: float,
    rapid_override: float,
    stop_count: int,
) -> tuple[int, float]:
    """Move along the planned blocks for at most dt (s), until none are left, standstill while braking, or only `stop_count` are left.

    Writes the pieces of motion to `out` from `row`. Returns the next row and the time used.
    """  # fmt: skip
    left = dt
    while left > TIME_EPS and state[COUNT] > 0 and row < out.shape[0] - 1:
        head = int(state[HEAD])
        block = blocks[head]
        if state[IS_STARTED] == 0.0:
            state[IS_STARTED] = 1.0
            state[OUTPUTS] = float((int(state[OUTPUTS]) | int(block[SET_MASK])) & ~int(block[CLEAR_MASK]))
        room = block[LENGTH] - state[DISTANCE]
        if room > PLACE_EPS:
            exit_speed = blocks[(head + 1) % blocks.shape[0]][ENTRY] if state[COUNT] > 1 else 0.0
            nominal = nominal_speed(block, feed_override, rapid_override)
            a, duration = next_phase(state[SPEED], block[ACCELERATION], room, nominal, exit_speed, braking)
            if duration <= 0.0:
                break
            taken = min(duration, left)
            row = write_pieces(out, row, block, state, rotary, a, taken)
            left -= taken
            if braking and taken == duration and a * duration + 1e-12 >= -state[SPEED] and state[SPEED] < 1e-9:
                state[SPEED] = 0.0
        if block[LENGTH] - state[DISTANCE] <= PLACE_EPS:
            state[HEAD] = float((head + 1) % blocks.shape[0])
            state[COUNT] -= 1
            state[DISTANCE] = state[IS_STARTED] = 0.0
            if state[COUNT] == 0:
                state[SPEED] = 0.0
            if state[COUNT] <= stop_count:
                break
    return row, dt - left
