"""Kernels of the watch: piece by piece what laser, powder and tip do against what they should, as episodes that end in events."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from sim.cnc.lookahead import (
    DURATION,
    FROM,
    PIECE_CAP,
    PIECE_LINE,
    PIECE_PROGRAMMED,
    PIECE_RAPID,
    PIECE_RPM,
    TO,
)
from sim.job import PROCESS_LINE

Floats = NDArray[np.float64]

STANDSTILL, STRAY, PARKED, STARVED, WASTE, SLOW, SPEED = range(7)
EPISODES = 7
# columns of an episode (state) and of an event
SECONDS, LENGTH, WORST, LINE, X, Y, Z, POWER, AXIS, KIND = range(10)
# places of the limits
LOW_W, MELTS_W, MOVING_MM_S, STANDSTILL_S, STRAY_S, STARVED_SHARE, DRY_G_MIN, SLOW_SHARE, SLOW_MM, CLAMP_SHARE, WASTE_MM = range(11)
LIMITS = 11
# columns of what is known of a piece besides the motion
TIP_SPEED, TIP_PROGRAMMED = range(2)
MOVED_MM = 1e-6


@njit(cache=True)
def close(episode: Floats, kind: int, limits: Floats, events: Floats, count: int) -> int:
    """End an episode; one that went beyond its limit becomes an event. Returns the number of events."""
    if episode[SECONDS] <= 0.0:
        return count
    tells = True
    if kind == STANDSTILL:
        tells = episode[SECONDS] > limits[STANDSTILL_S]
    elif kind == STRAY:
        tells = episode[SECONDS] > limits[STRAY_S]
    elif kind == WASTE:
        tells = episode[LENGTH] > limits[WASTE_MM]
    elif kind == SLOW:
        tells = episode[LENGTH] > limits[SLOW_MM]
    if tells and count < events.shape[0]:
        events[count, :KIND] = episode
        events[count, KIND] = kind
        count += 1
    episode[:] = 0.0
    return count


@njit(cache=True)
def extend(episode: Floats, seconds: float, length: float, badness: float, line: float, tip: Floats, power: float, axis: float) -> None:
    """Lengthen an episode by a piece; its worst piece gives line, place and slowest axis."""
    if episode[SECONDS] == 0.0 or badness > episode[WORST]:
        episode[WORST], episode[LINE], episode[AXIS] = badness, line, axis
        episode[X], episode[Y], episode[Z] = tip[0], tip[1], tip[2]
    episode[SECONDS] += seconds
    episode[LENGTH] += length
    episode[POWER] = max(episode[POWER], power)


@njit(cache=True)
def judge(
    piece: Floats, step: float, speed: float, ratio: float, emission: float, powder: float, on_process: bool, is_deployed: bool,
    limits: Floats, power_setpoint: float, powder_setpoint: float, bad: Floats,
) -> None:  # fmt: skip
    """How bad one piece is in each way, 0: not at all. step : way of the tip, mm   speed : mm/s   ratio : of the speed that the limits allow"""
    bad[:] = 0.0
    lit, melts, moves = emission > limits[LOW_W], emission >= limits[MELTS_W], step > MOVED_MM
    if lit and speed < limits[MOVING_MM_S]:
        bad[STANDSTILL] = emission
    if moves and lit and not on_process and emission > 0.1 * power_setpoint:
        bad[STRAY] = emission
    if lit and not is_deployed:
        bad[PARKED] = emission
    if melts and powder < limits[STARVED_SHARE] * powder_setpoint:
        bad[STARVED] = 1.0 - powder / powder_setpoint
    elif melts and on_process and powder_setpoint <= limits[DRY_G_MIN] and powder <= limits[DRY_G_MIN]:
        bad[STARVED] = 1.0
    if not (moves and on_process):
        return
    if powder > limits[DRY_G_MIN] and not melts:
        bad[WASTE] = powder
    heat = emission / power_setpoint if power_setpoint > 0.0 else 0.0
    if melts and heat > 0.0 and ratio / heat < limits[SLOW_SHARE]:
        bad[SLOW] = heat / ratio
    if piece[PIECE_RAPID] == 0.0 and piece[PIECE_CAP] < limits[CLAMP_SHARE] * piece[PIECE_PROGRAMMED]:
        bad[SPEED] = piece[PIECE_PROGRAMMED] / piece[PIECE_CAP]


@njit(cache=True)
def scan(
    pieces: Floats, tip0: Floats, tip1: Floats, emission: Floats, powder: Floats, kinds: NDArray[np.uint8], limits: Floats, fastest: Floats,
    power_setpoint: float, powder_setpoint: float, is_deployed: bool, episodes: Floats, lines: Floats, speeds: Floats, events: Floats,
) -> tuple[int, float]:
    """Look at the pieces of one step. Returns the number of events and the length that was travelled with light, mm.

    kinds : kind by line (kinds[0]: none)   fastest : (axes,) greatest speed of each   episodes : (EPISODES, KIND) carried on
    lines : (n + 1, 2), by line: rapid, greatest rpm   speeds : (k, 2) out, tip speed and programmed tip speed, mm/s   events : (m, KIND + 1) out
    """  # fmt: skip
    count = 0
    lit_mm = 0.0
    bad = np.zeros(EPISODES)
    for k in range(pieces.shape[0]):
        piece = pieces[k]
        dt = piece[DURATION]
        line = int(piece[PIECE_LINE])
        step = np.sqrt((tip1[k, 0] - tip0[k, 0]) ** 2 + (tip1[k, 1] - tip0[k, 1]) ** 2 + (tip1[k, 2] - tip0[k, 2]) ** 2)
        speed = step / dt if dt > 0.0 else 0.0
        if 0 < line < lines.shape[0]:
            lines[line, 0] = piece[PIECE_RAPID]
            lines[line, 1] = max(lines[line, 1], abs(piece[PIECE_RPM]))
        way = slowest = 0.0
        axis = -1
        for i in range(fastest.shape[0]):
            part = abs(piece[TO + i] - piece[FROM + i])
            way += part * part
            if part / fastest[i] > slowest:
                slowest, axis = part / fastest[i], i
        way = np.sqrt(way)
        programmed = min(piece[PIECE_PROGRAMMED], piece[PIECE_CAP])
        ratio = way / (programmed * dt) if programmed * dt > 0.0 else 1.0  # of the speed that the limits allow
        speeds[k, TIP_SPEED] = speed
        speeds[k, TIP_PROGRAMMED] = step * piece[PIECE_PROGRAMMED] / way if way > 0.0 else 0.0
        if emission[k] > limits[LOW_W]:
            lit_mm += step
        on_process = 0 <= line < kinds.shape[0] and kinds[line] == PROCESS_LINE
        judge(piece, step, speed, ratio, emission[k], powder[k], on_process, is_deployed, limits, power_setpoint, powder_setpoint, bad)
        for kind in range(EPISODES):
            if bad[kind] > 0.0:
                extend(episodes[kind], dt, step, bad[kind], piece[PIECE_LINE], tip1[k], emission[k], float(axis))
            elif episodes[kind, SECONDS] > 0.0 and dt > 0.0:
                count = close(episodes[kind], kind, limits, events, count)
    return count, lit_mm


@njit(cache=True)
def close_all(episodes: Floats, limits: Floats, events: Floats) -> int:
    """End every episode. Returns the number of events."""
    count = 0
    for kind in range(EPISODES):
        count = close(episodes[kind], kind, limits, events, count)
    return count


@njit(cache=True)
def thin_path(
    pieces: Floats, tip1: Floats, emission: Floats, low_w: float, kinds: NDArray[np.uint8], layers: NDArray[np.int64], spacing: float,
    last: Floats, out: Floats,
) -> int:
    """Ends of process pieces at least `spacing` apart: (m, 5) x, y, z, layer, 1 where the laser was on. Returns how many; last : (4,) carried on."""
    count = 0
    for k in range(pieces.shape[0]):
        line = int(pieces[k, PIECE_LINE])
        if not (0 < line < kinds.shape[0]) or kinds[line] != PROCESS_LINE:
            continue
        gap = (tip1[k, 0] - last[0]) ** 2 + (tip1[k, 1] - last[1]) ** 2 + (tip1[k, 2] - last[2]) ** 2
        if gap < spacing * spacing and last[3] == layers[line]:
            continue
        out[count, 0], out[count, 1], out[count, 2] = tip1[k, 0], tip1[k, 1], tip1[k, 2]
        out[count, 3], out[count, 4] = layers[line], 1.0 if emission[k] > low_w else 0.0
        last[0], last[1], last[2], last[3] = tip1[k, 0], tip1[k, 1], tip1[k, 2], layers[line]
        count += 1
    return count
