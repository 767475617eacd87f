"""Which branch and which turn of the rotary joints a sequence of poses takes: continuous, inside the travel, with the shortest rotary way."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kinematics.chain import Floats

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_OUTSIDE_DEG = 1e6  # cost of a pose outside the travel: more than any way between poses inside


def shortest_branches(angles: Floats, is_allowed: Bools, start: Floats) -> Ints:
    """(n,) int, 0 or 1: the branch of each row, so that the sum of rotary ways (deg) is least.

    angles : (n, 2, 2) float, deg: row, branch, joint   is_allowed : (n, 2) bool   start : (2,) float, deg, where the machine stands
    Dynamic programming over the rows; a branch that is not allowed is taken only where the other one is not either.
    """
    return np.asarray(
        _shortest(np.ascontiguousarray(angles), is_allowed, np.asarray(start, dtype=np.float64)), dtype=np.int64
    )


def unwrapped(angles: Floats, start: Floats) -> Floats:
    """(n, k) float, deg: the same angles, each less than half a turn from the one before; the first from start (k,)."""
    steps = np.diff(np.vstack([start, angles]), axis=0)
    return np.asarray(start + np.cumsum(steps - 360.0 * np.round(steps / 360.0), axis=0))


def turn_shift(values: Floats, low: float, high: float, slack: float = 1e-6) -> float | None:
    """Whole turns, deg, that bring all values into low ... high with the least change; None if there are none."""
    least = np.ceil((low - slack - float(values.min())) / 360.0)
    most = np.floor((high + slack - float(values.max())) / 360.0)
    if least > most:
        return None
    return float(360.0 * min(max(0.0, least), most))


def filled(values: Floats, is_known: Bools, way: Floats, start: float) -> Floats:
    """(n,) float: values where known; between two known ones linear over `way` (n,), not decreasing; before the first one from `start`.

    Where `way` does not grow before the first known row, that row's value holds; behind the last known row its value holds.
    With no known row everything stays at start.
    """
    known = np.flatnonzero(is_known)
    if known.size == 0:
        return np.full(len(values), start)
    places, levels = way[known], values[known]
    if known[0] > 0 and way[known[0]] > way[0]:
        places, levels = np.append(way[0], places), np.append(start, levels)
    result = np.interp(way, places, levels)
    result[known] = values[known]
    return np.asarray(result)


@njit(cache=True)
def _shortest(angles: Floats, is_allowed: Bools, start: Floats) -> Ints:
    n = len(angles)
    back = np.zeros((n, 2), dtype=np.int64)
    cost = np.zeros(2)
    for i in range(n):
        new = np.empty(2)
        for b in range(2):
            best = np.inf
            for a in range(2 if i > 0 else 1):
                way = 0.0
                for k in range(2):
                    step = angles[i, b, k] - (angles[i - 1, a, k] if i > 0 else start[k])
                    way += abs(step - 360.0 * np.round(step / 360.0))
                total = (cost[a] if i > 0 else 0.0) + way
                if total < best:
                    best = total
                    back[i, b] = a
            new[b] = best + (0.0 if is_allowed[i, b] else _OUTSIDE_DEG)
        cost = new
    chosen = np.empty(n, dtype=np.int64)
    if n > 0:
        chosen[n - 1] = 0 if cost[0] <= cost[1] else 1
        for i in range(n - 1, 0, -1):
            chosen[i - 1] = back[i, chosen[i]]
    return chosen
