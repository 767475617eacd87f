"""Point to point along two contours: equal tangent directions belong together, straight runs in proportion."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.matching.outline import Outline

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_SAMPLES = 192  # on the whole contour for the search
_FINE = 3  # times as many for the refinement, which finds places between samples
_LONGEST_STEP = 4  # samples on the top contour that one step on the bottom contour may cover in the search
_STRETCH = 1e-3  # rad²: what uneven progress costs against a difference of directions
_APART = 1.0  # rad²: what a distance of the contour's whole length costs in the search
_ROUNDS = 10


def match_outlines(low: Outline, high: Outline, anchors: Floats) -> tuple[Floats, Floats]:
    """Measures of the bottom and the top outline that belong together: (k,) and (k,) float, both not decreasing.

    anchors : (a, 2, 2) float   for corners that one crease joins: measures before and behind the turn, of low and high
    The last row is the first, one round on. Ends of one ruling have parallel tangents as far as the contours allow
    (then the wall is developable, and of all rulings through a point of a convex wall this one leaves it least);
    where directions do not tell, on straight runs, progress is even.
    """
    if not len(anchors):
        first = _start(low, high)
        spans = [(first, first + 1.0)]
    else:
        behind, before = anchors[:, :, 1], np.roll(anchors[:, :, 0], -1, axis=0)
        behind = behind + np.cumsum(np.vstack([np.zeros(2), np.diff(behind, axis=0) < 0.0]), axis=0)
        before = before + np.ceil(behind - before - 1e-12)
        spans = list(zip(behind, before, strict=True))
    rows = [_match_span(low, high, start, stop, not len(anchors)) for start, stop in spans]
    first_row = rows[0][:1] + 1.0
    table = np.vstack([*rows, first_row] if len(anchors) else rows)
    return np.maximum.accumulate(table[:, 0]), np.maximum.accumulate(table[:, 1])


def _start(low: Outline, high: Outline) -> Floats:
    """(2,) float: measures where both outlines have the same direction, near each other, where the bottom one bends."""
    x = np.arange(_SAMPLES) / _SAMPLES
    _, theta_low, points_low = low.at(x)
    _, theta_high, points_high = high.at(x)
    bend = np.abs(low.at(x + 1.0 / _SAMPLES)[1] - low.at(x - 1.0 / _SAMPLES)[1])
    at = int(np.argmax(bend))
    apart = (points_high - points_high.mean(axis=0)) - (points_low[at] - points_low.mean(axis=0))
    length = np.linalg.norm(np.diff(low.points, axis=0), axis=1).sum()
    angle = (theta_high - theta_low[at] + np.pi) % (2.0 * np.pi) - np.pi
    cost = angle**2 + _APART * (np.linalg.norm(apart, axis=1) / length * 4.0) ** 2
    return np.array([x[at], x[int(np.argmin(cost))]])


def _match_span(low: Outline, high: Outline, start: Floats, stop: Floats, is_round: bool) -> Floats:
    """(k, 2) float: measures that belong together from start to stop, (2,) float each, which do."""
    count = max(int(np.ceil(_SAMPLES * float((stop - start).max()))), 6)
    share = np.linspace(0.0, 1.0, count + 1)
    x_low, x_high = start[0] + share * (stop[0] - start[0]), start[1] + share * (stop[1] - start[1])
    _, theta_low, points_low = low.at(x_low)
    _, theta_high, points_high = high.at(x_high)
    theta_high = theta_high - 2.0 * np.pi * np.round((theta_high[0] - theta_low[0]) / (2.0 * np.pi))
    shift = points_high.mean(axis=0) - points_low.mean(axis=0)
    scale = np.sqrt(_APART) / max(float(np.linalg.norm(np.diff(low.points, axis=0), axis=1).sum()), 1e-300)
    path = cheapest_path(theta_low, theta_high, points_low * scale, (points_high - shift) * scale, _STRETCH)
    fine = np.linspace(0.0, 1.0, _FINE * count + 1)
    _, fine_low, _ = low.at(start[0] + fine * (stop[0] - start[0]))
    _, fine_high, _ = high.at(start[1] + fine * (stop[1] - start[1]))
    fine_high = fine_high - 2.0 * np.pi * np.round((fine_high[0] - fine_low[0]) / (2.0 * np.pi))
    guess = np.interp(fine, share, path / count) * (len(fine) - 1)
    place = refine_path(fine_low, fine_high, guess, _STRETCH, is_round, _ROUNDS) / (len(fine) - 1)
    return np.column_stack([start[0] + fine * (stop[0] - start[0]), start[1] + place * (stop[1] - start[1])])


@njit(cache=True)
def cheapest_path(theta_low: Floats, theta_high: Floats, points_low: Floats, points_high: Floats, stretch: float) -> Floats:
    """For each sample of the bottom contour the sample of the top contour: (n,) float, not decreasing, ends to ends.

    theta_low, theta_high : (n,) float, rad;  points_low, points_high : (n, 3) float, scaled so that their squared
    distance counts like rad²;  stretch : cost of a step that is one sample too long or short, rad²
    Source: dynamic programming over monotone paths (Sakoe and Chiba 1978).
    """
    n = theta_low.shape[0]
    cost = np.full(n, np.inf)
    following = np.empty(n)
    step = np.zeros((n, n), np.int8)
    cost[0] = 0.0
    for i in range(1, n):
        for j in range(n):
            best = np.inf
            for d in range(min(_LONGEST_STEP, j) + 1):
                value = cost[j - d] + stretch * (d - 1.0) ** 2
                if value < best:
                    best = value
                    step[i, j] = d
            if best < np.inf:
                turn = theta_low[i] - theta_high[j]
                apart = 0.0
                for k in range(3):
                    apart += (points_low[i, k] - points_high[j, k]) ** 2
                best += turn * turn + apart
            following[j] = best
        cost, following = following, cost
    path = np.empty(n)
    j = n - 1
    for i in range(n - 1, -1, -1):
        path[i] = j
        j -= step[i, j]
    return path


@njit(cache=True)
def refine_path(
    theta_low: Floats, theta_high: Floats, guess: Floats, stretch: float, is_round: bool, rounds: int
) -> Floats:
    """The path between samples: least squares of the directions' differences and of uneven progress.

    guess : (n,) float, places on the top contour in samples, 0 ... n - 1
    is_round : the last sample is the first, one round on, and both may move; else the ends stay
    Returns (n,) float, not decreasing. Gauss-Newton; each round solves a (cyclic) tridiagonal system.
    """
    n = theta_low.shape[0]
    unknowns = n - 1 if is_round else n
    place = guess.copy()
    turn = theta_high[n - 1] - theta_high[0]
    diagonal, right = np.empty(unknowns), np.empty((unknowns, 2))
    for _ in range(rounds):
        for i in range(unknowns):
            whole = np.floor(place[i] / (n - 1))
            rest = place[i] - whole * (n - 1)
            k = min(int(rest), n - 2)
            slope = theta_high[k + 1] - theta_high[k]
            residual = theta_low[i] - (theta_high[k] + (rest - k) * slope + whole * turn)
            before = place[i - 1] if i > 0 else place[unknowns - 1] - (n - 1)
            after = place[i + 1] if i + 1 < unknowns else place[0] + (n - 1)
            diagonal[i] = slope * slope + 2.0 * stretch
            right[i, 0] = slope * residual + stretch * (before - 2.0 * place[i] + after)
            right[i, 1] = 0.0
            if not is_round and (i == 0 or i == n - 1):
                diagonal[i], right[i, 0] = 1e12, 0.0
        move = _solve_ring(diagonal, right, -stretch) if is_round else _solve_chain(diagonal, right, -stretch)[:, 0]
        largest = 0.0
        for i in range(unknowns):
            place[i] += max(-8.0, min(8.0, move[i]))
            largest = max(largest, abs(move[i]))
        if is_round:
            place[n - 1] = place[0] + (n - 1)
        for i in range(1, n):
            place[i] = max(place[i], place[i - 1])
        if is_round:
            for i in range(n):
                place[i] = min(place[i], place[n - 1])
        else:
            for i in range(n):
                place[i] = min(place[i], n - 1.0)
        if largest < 1e-6:
            break
    return place


@njit(cache=True)
def _solve_chain(diagonal: Floats, right: Floats, off: float) -> Floats:
    """Solution (n, 2) of the symmetric tridiagonal system with one value beside the diagonal, for two right sides."""
    n = diagonal.shape[0]
    pivot = np.empty(n)
    result = right.copy()
    pivot[0] = diagonal[0]
    for i in range(1, n):
        factor = off / pivot[i - 1]
        pivot[i] = diagonal[i] - factor * off
        for k in range(2):
            result[i, k] -= factor * result[i - 1, k]
    for k in range(2):
        result[n - 1, k] /= pivot[n - 1]
    for i in range(n - 2, -1, -1):
        for k in range(2):
            result[i, k] = (result[i, k] - off * result[i + 1, k]) / pivot[i]
    return result


@njit(cache=True)
def _solve_ring(diagonal: Floats, right: Floats, off: float) -> Floats:
    """Solution (n,) of the tridiagonal system whose corners hold the off-diagonal value too (Sherman-Morrison)."""
    n = diagonal.shape[0]
    first = -diagonal[0]
    changed = diagonal.copy()
    changed[0] -= first
    changed[n - 1] -= off * off / first
    sides = right.copy()
    sides[0, 1], sides[n - 1, 1] = first, off
    both = _solve_chain(changed, sides, off)
    share = (both[0, 0] + off * both[n - 1, 0] / first) / (1.0 + both[0, 1] + off * both[n - 1, 1] / first)
    return both[:, 0] - share * both[:, 1]
