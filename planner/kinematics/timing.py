"""How long blocks take: nominal times that no axis' speed exceeds, and a look-ahead that knows acceleration and corners."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kinematics.chain import Floats

JUNCTION_DEVIATION = 0.01
"""mm (or deg where rotary joints move): grblHAL's default of $11, how far a corner may be cut."""


def axis_limited_times(moves: Floats, times: Floats, max_velocity: Floats) -> Floats:
    """(n,) float, s: the given times, lengthened where an axis would exceed its velocity.

    moves : (n, 5) float, mm or deg   times : (n,) float, s   max_velocity : (5,) float, mm/s or deg/s
    """
    return np.asarray(np.maximum(times, np.max(np.abs(moves) / max_velocity, axis=1, initial=0.0)))


def predicted_times(
    moves: Floats,
    times: Floats,
    stops: NDArray[np.bool_],
    max_acceleration: Floats,
    deviation: float = JUNCTION_DEVIATION,
    bulge: Floats | None = None,
    plane: tuple[int, int] = (0, 1),
    arc_tolerance_mm: float = 0.002,
) -> Floats:
    """(n,) float, s: time of each block when the machine accelerates, brakes and looks ahead.

    moves : (n, 5) float, mm or deg, zero for lines without motion   times : (n,) float, s, nominal (for lines without motion: their own)
    stops : (n,) bool, the machine stands before this line   max_acceleration : (5,) float, mm/s2 or deg/s2
    bulge : (n,) float, tan(sweep / 4) of arcs in the `plane` (two columns), 0: straight; the control cuts them into chords
    deviation : mm (or deg), how far a corner may be cut   arc_tolerance_mm : how far those chords leave the arc
    Path speed is taken in joint space, mm and degrees alike, as the firmware does; corners by junction deviation.
    Source: grbl 1.1 planner.c (junction deviation, S. Jeon 2011), trapezoids by the kinematic equations.
    """
    if bulge is not None and np.any(bulge != 0.0):
        pieces, line = arc_pieces(moves, bulge, plane, arc_tolerance_mm)
        count = np.bincount(line, minlength=len(moves))
        first = np.append(True, np.diff(line) != 0)
        each = predicted_times(pieces, (times / count)[line], stops[line] & first, max_acceleration, deviation)
        return np.asarray(np.bincount(line, each, len(moves)), dtype=np.float64)
    length = np.sqrt(np.einsum("ij,ij->i", moves, moves))
    is_motion = length > 0.0
    at = np.flatnonzero(is_motion)
    result = np.array(times, dtype=np.float64)
    if at.size == 0:
        return result
    unit = moves[at] / length[at, None]
    cruise = length[at] / np.maximum(times[at], 1e-9)
    with np.errstate(divide="ignore"):
        acceleration = np.min(np.where(unit == 0.0, np.inf, max_acceleration / np.abs(unit)), axis=1)
    stood = np.cumsum(stops)
    stands = np.append(True, stood[at[1:]] > stood[at[:-1]])
    corner = _corner_speeds2(unit, max_acceleration, deviation)
    corner[stands] = 0.0
    entry = _entry_speeds(length[at], cruise, acceleration, corner)
    result[at] = _durations(length[at], cruise, acceleration, entry)
    return result


def arc_pieces(
    moves: Floats, bulge: Floats, plane: tuple[int, int], tolerance_mm: float
) -> tuple[Floats, NDArray[np.int64]]:
    """(k, 5) moves with every arc cut into equal chords within the tolerance, and the line of each (k,).

    moves : (n, 5) float, from start to end   bulge : (n,) float, counter-clockwise > 0 from the first to the second column of the plane
    Source: grbl 1.1 motion_control.c.
    """
    sweep = 4.0 * np.arctan(bulge)
    chord = np.hypot(moves[:, plane[0]], moves[:, plane[1]])
    is_arc = (bulge != 0.0) & (chord > 0.0)
    half = np.where(is_arc, np.abs(np.sin(0.5 * sweep)), 1.0)
    radius = np.where(is_arc, 0.5 * chord / half, 1.0)
    step = 2.0 * np.arccos(np.clip(1.0 - tolerance_mm / radius, 0.0, 1.0))
    count = np.where(is_arc, np.maximum(np.ceil(np.abs(sweep) / np.maximum(step, 1e-9)), 1), 1).astype(np.int64)
    line = np.repeat(np.arange(len(moves)), count)
    within = np.arange(len(line)) - np.repeat(np.cumsum(count) - count, count)
    pieces = moves[line] / count[line][:, None]
    of_arc = is_arc[line]
    at = line[of_arc]
    turn = sweep[at] / count[at]
    heading = np.arctan2(moves[at, plane[1]], moves[at, plane[0]]) - 0.5 * sweep[at] + (within[of_arc] + 0.5) * turn
    piece = 2.0 * radius[at] * np.abs(np.sin(0.5 * turn))
    pieces[of_arc, plane[0]], pieces[of_arc, plane[1]] = piece * np.cos(heading), piece * np.sin(heading)
    return pieces, line


def _corner_speeds2(unit: Floats, max_acceleration: Floats, deviation: float) -> Floats:
    """(n,) float: greatest squared speed at the start of each block."""
    speeds = np.zeros(len(unit))
    if len(unit) < 2:
        return speeds
    cosine = -np.einsum("ij,ij->i", unit[:-1], unit[1:])  # of the angle between the two legs of the corner
    change = unit[1:] - unit[:-1]
    size = np.linalg.norm(change, axis=1)
    way = np.abs(change) / np.maximum(size, 1e-300)[:, None]
    with np.errstate(divide="ignore"):
        acceleration = np.min(np.where(way == 0.0, np.inf, max_acceleration / np.maximum(way, 1e-300)), axis=1)
    half_sine = np.sqrt(np.clip(0.5 * (1.0 - cosine), 0.0, 1.0))
    straight = (1.0 - half_sine < 1e-12) | (size < 1e-9)
    allowed = acceleration * deviation * half_sine / np.where(straight, 1.0, 1.0 - half_sine)
    speeds[1:] = np.where(straight, 1e12, np.where(cosine > 0.999999, 0.0, allowed))
    return speeds


@njit(cache=True)
def _entry_speeds(length: Floats, cruise: Floats, acceleration: Floats, corner: Floats) -> Floats:
    """Squared entry speeds after a backward and a forward pass; the machine stands at the end."""
    n = len(length)
    entry = np.empty(n + 1)
    entry[n] = 0.0
    for i in range(n - 1, -1, -1):
        cap = min(corner[i], cruise[i] ** 2)
        if i > 0:
            cap = min(cap, cruise[i - 1] ** 2)
        entry[i] = min(cap, entry[i + 1] + 2.0 * acceleration[i] * length[i])
    for i in range(n):
        entry[i + 1] = min(entry[i + 1], entry[i] + 2.0 * acceleration[i] * length[i])
    return np.sqrt(entry)


@njit(cache=True)
def _durations(length: Floats, cruise: Floats, acceleration: Floats, entry: Floats) -> Floats:
    """Time of the trapezoid (or triangle) of each block between its entry and the next one's."""
    times = np.empty(len(length))
    for i in range(len(length)):
        a, v0, v1, v = acceleration[i], entry[i], entry[i + 1], cruise[i]
        peak = min(v, np.sqrt(a * length[i] + 0.5 * (v0 * v0 + v1 * v1)))
        peak = max(peak, v0, v1)
        ramps = (2.0 * peak * peak - v0 * v0 - v1 * v1) / (2.0 * a)
        times[i] = (2.0 * peak - v0 - v1) / a + max(length[i] - ramps, 0.0) / peak
    return times
