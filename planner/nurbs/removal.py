"""Removing knots as long as the shape stays within a tolerance, with a proven bound of what it moved."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]
Flags = NDArray[np.bool_]


def remove_knots(
    degree: int, knots: Floats, net: Floats, tolerance: float, rational: bool, only: ArrayLike | None = None
) -> tuple[Floats, Floats, float]:
    """Remove inner knots, the one that moves the shape least first, while the moves add up to the tolerance at most.

    knots     : (m,) float         Clamped.
    net       : (n, k, D) float    Control points, (n, 1, D) of a curve, rows of a surface; homogeneous if `rational`.
    tolerance : how far any point (at equal parameter) may move, in the unit of the points
    only      : values of the knots that may go (default: all inner ones)
    Returns (knots, net, bound): no point has moved further than `bound` <= tolerance.
    The bound is that of the hull: putting the knot back gives control points of the new shape in the old basis, and
    the shapes differ at most as these from the old ones. Moves of one span add up.
    Raises ValueError if the tolerance is negative.
    Source: Piegl & Tiller A5.8 (one knot), A9.9 (which first, errors per span), Eq. 5.30 (rational).
    """
    if not tolerance >= 0.0:
        raise ValueError(f"a tolerance cannot be negative: {tolerance:g}")
    free = np.ones(len(knots), dtype=bool) if only is None else np.isin(knots, np.asarray(only, dtype=np.float64))
    at, size = _surroundings(net, rational)
    kept, rows, bound = _remove(degree, knots.copy(), net.copy(), tolerance, rational, free, at, size)
    return kept, rows, float(bound)


def _surroundings(net: Floats, rational: bool) -> tuple[Floats, float]:
    """Middle of the control points and the radius round it that holds them all."""
    flat = net.reshape(-1, net.shape[2])
    points = flat[:, :-1] / flat[:, -1:] if rational else flat
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return middle, float(np.linalg.norm(points - middle, axis=1).max())


@njit(cache=True, error_model="numpy", nogil=True)
def _without(degree: int, knots: Floats, net: Floats, r: int, s: int, rows: Floats) -> int:
    """Control rows that replace r-p ... r-s when the knot of index r and multiplicity s goes once, into rows[1 ...].

    rows[0] and the row after the last are the neighbours that stay. Returns how many rows replace (A5.8 with t = 0).
    """
    u, first, last = knots[r], r - degree, r - s
    count = last - first + 1
    rows[0], rows[count + 1] = net[first - 1], net[last + 1]
    i, j, left, right = first, last, 1, count
    while j - i > 0:
        alpha = (u - knots[i]) / (knots[i + degree + 1] - knots[i])
        beta = (u - knots[j]) / (knots[j + degree + 1] - knots[j])
        rows[left] = (net[i] - (1.0 - alpha) * rows[left - 1]) / alpha
        rows[right] = (net[j] - beta * rows[right + 1]) / (1.0 - beta)
        i, j, left, right = i + 1, j - 1, left + 1, right - 1
    if j < i:
        rows[left - 1] = 0.5 * (rows[left - 1] + rows[left])
    for k in range(left, count + 1):
        rows[k] = rows[k + 1]
    return count - 1


@njit(cache=True, error_model="numpy", nogil=True)
def _move(
    degree: int, knots: Floats, net: Floats, r: int, s: int, rational: bool, middle: Floats, size: float, rows: Floats
) -> float:
    """How far points may move when the knot goes once; infinite if a weight would not stay positive."""
    count = _without(degree, knots, net, r, s, rows)
    first, dimension = r - degree, middle.size
    worst, least = 0.0, 1.0
    if rational:
        least = net[first : r - s + 1, :, dimension].min()
        for k in range(1, count + 1):
            least = min(least, rows[k, :, dimension].min())
        if not least > 0.0:
            return np.inf
    for k in range(count + 1):
        at = first + k
        alpha = (knots[r] - knots[at]) / (knots[at + degree + 1] - knots[at])
        for m in range(net.shape[1]):
            heavier = 0.0
            if rational:
                again = alpha * rows[k + 1, m, dimension] + (1.0 - alpha) * rows[k, m, dimension]
                heavier = net[at, m, dimension] - again
            total = 0.0
            for axis in range(dimension):
                again = alpha * rows[k + 1, m, axis] + (1.0 - alpha) * rows[k, m, axis]
                total += (net[at, m, axis] - again - middle[axis] * heavier) ** 2
            worst = max(worst, (np.sqrt(total) + 2.0 * size * abs(heavier)) / least)
    return worst


@njit(cache=True, error_model="numpy", nogil=True)
def _price(
    degree: int, knots: Floats, net: Floats, free: Flags, low: int, high: int, rational: bool,
    middle: Floats, size: float, rows: Floats, prices: Floats,
) -> None:  # fmt: skip
    """What it costs to remove each knot of index low ... high-1: its move, infinite where it must stay."""
    for r in range(low, high):
        prices[r] = np.inf
        if not free[r] or knots[r] == knots[r + 1] or r <= degree or r >= len(net):
            continue
        s = 1
        while knots[r - s] == knots[r]:
            s += 1
        if s <= degree:
            prices[r] = _move(degree, knots, net, r, s, rational, middle, size, rows)


@njit(cache=True, error_model="numpy", nogil=True)
def _remove(
    degree: int, knots: Floats, net: Floats, tolerance: float, rational: bool, free: Flags, middle: Floats, size: float
) -> tuple[Floats, Floats, float]:
    """The cheapest knot goes first; every span remembers how far it has moved."""
    count = len(net)
    rows = np.empty((degree + 3, net.shape[1], net.shape[2]))
    prices, moved = np.full(len(knots), np.inf), np.zeros(len(knots))
    _price(degree, knots, net, free, 0, count, rational, middle, size, rows, prices)
    while True:
        r = int(np.argmin(prices[:count]))
        if not prices[r] <= tolerance:
            break
        s = 1
        while knots[r - s] == knots[r]:
            s += 1
        spans = moved[r - degree : min(r - s + degree + 1, count)]
        if spans.max() + prices[r] > tolerance:
            prices[r], free[r] = np.inf, False
            continue
        spans += prices[r]
        moved[r - 1] = max(moved[r - 1], moved[r])
        fewer = _without(degree, knots, net, r, s, rows)
        net[r - degree : r - degree + fewer] = rows[1 : fewer + 1]
        for k in range(r - s, count - 1):
            net[k] = net[k + 1]
        for k in range(r, count + degree):
            knots[k] = knots[k + 1]
            free[k], prices[k], moved[k] = free[k + 1], prices[k + 1], moved[k + 1]
        if knots[r - 1] == knots[r]:
            free[r - 1] = free[r]
        count -= 1
        around = (max(r - 2 * degree - 1, 0), min(r + 2 * degree + 1, count))
        own, own_knots = net[:count], knots[: count + degree + 1]
        _price(degree, own_knots, own, free, around[0], around[1], rational, middle, size, rows, prices)
    return knots[: count + degree + 1].copy(), net[:count].copy(), moved[:count].max()
