"""The cheapest way through candidate poses of a whole operation: branches, turns and leans as a shortest path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kinematics.chain import Floats

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

OUTSIDE_S = 1e6
"""Cost of a pose outside the travel: more than any way between poses inside, s."""
_UNWIND_S = 2.0  # of a retract and an approach, which unwinding takes
_LEAP_S = 20.0  # of half a turn from one row to the next within a piece, squared: leaps cost, fine steps do not
_LEAP_DEG = 90.0  # within a piece: from here on it is asked whether a way out of the travel goes without
_SPARE_LEAP_S = 1e12  # the same where nothing inside the travel leads through: more than being outside all the way
_SLACK_DEG = 1e-6


@dataclass(frozen=True)
class Lattice:
    """Candidate poses of a sequence of rows.

    angles : (n, m, 2) float, deg in (-180, 180], of the two rotary joints   cost : (n, m) float, s, infinite: not possible
    may_unwind : (n,) bool, the tool is off the part before this row: whole turns may change there
    lean : (n, m, 2) float, deg, off the planned axis, in a frame that goes along; or empty: all alike
    lean_step : (n,) float, deg, greatest change of lean from the row before   lean_cost : s per deg of change, squared
    """

    angles: Floats
    cost: Floats
    may_unwind: Bools
    lean: Floats
    lean_step: Floats
    lean_cost: float = 0.0

    @classmethod
    def of_branches(cls, angles: Floats, cost: Floats, may_unwind: Bools) -> Lattice:
        """Both branches (n, 2, 2) of one axis per row."""
        return cls(angles, cost, may_unwind, np.zeros((0, 0, 2)), np.zeros(0))


@dataclass(frozen=True)
class Way:
    """chosen : (n,) int, candidate of each row   angles : (n, 2) float, deg, on its turn   cost : s   inside : all of it in the travel"""

    chosen: Ints
    angles: Floats
    cost: float
    inside: bool


def shortest_way(
    lattice: Lattice, start: Floats, low: Floats, high: Floats, speed: Floats, spare_turns: int = 0
) -> Way:
    """The candidates and turns whose rotary time plus cost is least; within a piece no joint turns by more than half a turn at once.

    start, low, high : (2,) float, deg, where the joints stand and their travel   speed : (2,) float, deg/s
    spare_turns : beyond the travel, looked at where none inside leads through; what is outside costs OUTSIDE_S a row
    Dynamic programming over rows; states are candidates on each turn of each joint (Bellman). An empty lattice gives an empty way.
    """
    n = len(lattice.angles)
    if n == 0:
        return Way(np.zeros(0, dtype=np.int64), np.zeros((0, 2)), 0.0, True)
    fewest = np.ceil((low - _SLACK_DEG - 180.0) / 360.0).astype(np.int64)
    most = np.floor((high + _SLACK_DEG + 180.0) / 360.0).astype(np.int64)
    arrays = (
        np.ascontiguousarray(lattice.angles), np.ascontiguousarray(lattice.cost), lattice.may_unwind,
        np.ascontiguousarray(lattice.lean), lattice.lean_step, lattice.lean_cost,
    )  # fmt: skip
    facts = np.array([start, low - _SLACK_DEG, high + _SLACK_DEG, speed], dtype=np.float64)
    way = _traced(lattice, *_cheapest(*arrays, facts, fewest, most, False), low, high)
    leap = _greatest_step(way, lattice)
    if np.isfinite(way.cost) and leap <= _LEAP_DEG:
        return way
    spare = max(spare_turns, _turns_of(lattice))
    other = _traced(lattice, *_cheapest(*arrays, facts, fewest - spare, most + spare, True), low, high)
    return other if not np.isfinite(way.cost) or _greatest_step(other, lattice) < 0.5 * leap else way


def _traced(lattice: Lattice, chosen: Ints, turns: Ints, cost: float, low: Floats, high: Floats) -> Way:
    angles = lattice.angles[np.arange(len(chosen)), chosen] + 360.0 * turns
    inside = bool(np.isfinite(cost) and np.all((angles >= low - 1e-5) & (angles <= high + 1e-5)))
    return Way(chosen, angles, float(cost), inside)


def _greatest_step(way: Way, lattice: Lattice) -> float:
    """Greatest turn of a joint from one row to the next within a piece, deg."""
    steps = np.abs(np.diff(way.angles, axis=0)).max(axis=1, initial=0.0)
    return float(np.max(steps[~lattice.may_unwind[1:]], initial=0.0))


def _turns_of(lattice: Lattice) -> int:
    """Whole turns that the first possible candidates wind through, and one more."""
    first = np.argmin(lattice.cost, axis=1)
    angles = lattice.angles[np.arange(len(first)), first]
    steps = np.diff(angles, axis=0, prepend=angles[:1])
    wound = np.cumsum(steps - 360.0 * np.round(steps / 360.0), axis=0)
    return 1 + int(np.ceil(np.ptp(wound, axis=0).max(initial=0.0) / 360.0))


@njit(cache=True)
def _cheapest(
    angles: Floats, cost: Floats, may_unwind: Bools, lean: Floats, lean_step: Floats, lean_cost: float,
    facts: Floats, fewest: Ints, most: Ints, is_spare: bool,
) -> tuple[Ints, Ints, float]:  # fmt: skip
    """Chosen candidate (n,), whole turns (n, 2) and the cost; infinite where nothing leads through.

    facts : (4, 2) float, start, least and greatest angle, deg, speed, deg/s   fewest, most : (2,) int, turns looked at
    """
    n, m = cost.shape
    k2 = most[1] - fewest[1] + 1
    turns = (most[0] - fewest[0] + 1) * k2
    back, here = np.full((n, m * turns), -1, dtype=np.int32), np.full(m * turns, np.inf)
    stood = facts[0] - 360.0 * fewest  # as an angle on the first turn
    for i in range(n):
        new = np.full(m * turns, np.inf)
        for b in range(m):
            if not np.isfinite(cost[i, b]):
                continue
            to, reached = slice(b * turns, (b + 1) * turns), new[b * turns : (b + 1) * turns]
            if i == 0:
                _relax(
                    np.zeros(1),
                    stood,
                    angles[0, b],
                    cost[0, b],
                    True,
                    facts,
                    fewest,
                    most,
                    is_spare,
                    0,
                    reached,
                    back[0, to],
                )
                continue
            for a in range(m):
                swing = 0.0
                if len(lean):
                    swing = np.hypot(lean[i, b, 0] - lean[i - 1, a, 0], lean[i, b, 1] - lean[i - 1, a, 1])
                    if swing > lean_step[i]:
                        continue
                    swing = lean_cost * swing * swing
                before, first = here[a * turns : (a + 1) * turns], angles[i - 1, a]
                more = swing + cost[i, b]
                _relax(
                    before,
                    first,
                    angles[i, b],
                    more,
                    may_unwind[i],
                    facts,
                    fewest,
                    most,
                    is_spare,
                    a * turns,
                    reached,
                    back[i, to],
                )
        here = new
    return _followed_back(back, here, turns, k2, fewest)


@njit(cache=True)
def _followed_back(
    back: NDArray[np.int32], here: Floats, turns: int, k2: int, fewest: Ints
) -> tuple[Ints, Ints, float]:
    """Candidates (n,) and turns (n, 2) on the way to the cheapest of the last states, and its cost."""
    n = len(back)
    state = int(np.argmin(here))
    least = here[state]
    chosen, turned = np.zeros(n, dtype=np.int64), np.zeros((n, 2), dtype=np.int64)
    for i in range(n - 1, -1, -1):
        if state < 0:
            break
        chosen[i] = state // turns
        turned[i, 0] = fewest[0] + (state % turns) // k2
        turned[i, 1] = fewest[1] + (state % turns) % k2
        state = back[i, state]
    return chosen, turned, least


@njit(cache=True)
def _relax(
    before: Floats, origin: Floats, target: Floats, more: float, any_turn: bool, facts: Floats, fewest: Ints, most: Ints,
    is_spare: bool, state: int, reached: Floats, back: NDArray[np.int32],
) -> None:  # fmt: skip
    """Costs (k,) of one candidate on each turn, bettered by the ways from one of the row before; back : from which state.

    before : (j,) float, costs on the first j turns   any_turn : every turn is tried, else the nearest one only
    """
    k2 = most[1] - fewest[1] + 1
    for k in range(len(before)):
        if not np.isfinite(before[k]):
            continue
        first = origin[0] + 360.0 * (fewest[0] + k // k2)
        second = origin[1] + 360.0 * (fewest[1] + k % k2)
        near1, near2 = int(np.round((first - target[0]) / 360.0)), int(np.round((second - target[1]) / 360.0))
        low1, high1 = (fewest[0], most[0]) if any_turn else (max(near1, fewest[0]), min(near1, most[0]))
        low2, high2 = (fewest[1], most[1]) if any_turn else (max(near2, fewest[1]), min(near2, most[1]))
        for t1 in range(low1, high1 + 1):
            to1 = target[0] + 360.0 * t1
            out1 = to1 < facts[1, 0] or to1 > facts[2, 0]
            for t2 in range(low2, high2 + 1):
                to2 = target[1] + 360.0 * t2
                outside = out1 or to2 < facts[1, 1] or to2 > facts[2, 1]
                if outside and not is_spare:
                    continue
                total = before[k] + more + abs(to1 - first) / facts[3, 0] + abs(to2 - second) / facts[3, 1]
                if not any_turn:
                    total += (_SPARE_LEAP_S if is_spare else _LEAP_S) * ((to1 - first) ** 2 + (to2 - second) ** 2) / 180.0**2
                total += (OUTSIDE_S if outside else 0.0) + (_UNWIND_S if t1 != near1 or t2 != near2 else 0.0)
                place = (t1 - fewest[0]) * k2 + t2 - fewest[1]
                if total < reached[place]:
                    reached[place] = total
                    back[place] = state + k
