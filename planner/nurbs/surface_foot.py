"""The point of one nearly flat patch nearest to a point: Newton that stays inside the patch."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.nurbs.surface_patches import patch_jet

Floats = NDArray[np.float64]

_STEPS = 60  # quadratic near the foot, linear where the surface has no normal
_TRIALS = 12  # shorter steps by 1/4 each before a direction is given up
_SAME = 1e-15  # a step shorter than this share of the patch ends the search
_ROUNDING = 1e-13  # share of the squared distance below which a rise is rounding


@njit(cache=True, error_model="numpy", nogil=True)
def _nearest_corner(net: Floats, rational: bool, point: Floats) -> tuple[float, float, float]:
    """Own parameters and squared distance of the nearest of the four corners."""
    dimension, best, s, t = point.size, np.inf, 0.0, 0.0
    for row in range(2):
        for column in range(2):
            i, j = row * (net.shape[0] - 1), column * (net.shape[1] - 1)
            weight = net[i, j, dimension] if rational else 1.0
            away2 = 0.0
            for axis in range(dimension):
                away2 += (net[i, j, axis] / weight - point[axis]) ** 2
            if away2 < best:
                best, s, t = away2, float(row), float(column)
    return s, t, best


@njit(cache=True, error_model="numpy", nogil=True)
def _distance2(jet: Floats, point: Floats) -> float:
    total = 0.0
    for axis in range(point.size):
        total += (jet[0, 0, axis] - point[axis]) ** 2
    return total


@njit(cache=True, error_model="numpy", nogil=True)
def _direction(jet: Floats, point: Floats, s: float, t: float, plain: bool) -> tuple[float, float]:
    """Newton's step on half the squared distance (Eq. 6.7); where it would not descend, Gauss-Newton's.

    A parameter at its bound that the slope presses against it stays there.   plain : each parameter by itself.
    """
    gs, gt, e, f, g, ess, est, ett = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for axis in range(point.size):
        away = jet[0, 0, axis] - point[axis]
        by_s, by_t = jet[1, 0, axis], jet[0, 1, axis]
        gs, gt = gs + away * by_s, gt + away * by_t
        e, f, g = e + by_s * by_s, f + by_s * by_t, g + by_t * by_t
        ess, est, ett = ess + away * jet[2, 0, axis], est + away * jet[1, 1, axis], ett + away * jet[0, 2, axis]
    fixed_s = (s <= 0.0 and gs > 0.0) or (s >= 1.0 and gs < 0.0)
    fixed_t = (t <= 0.0 and gt > 0.0) or (t >= 1.0 and gt < 0.0)
    floor = 1e-12 * (e + g) + 1e-300
    if plain or fixed_s or fixed_t:
        bend_s = e + ess if e + ess > floor and not plain else e + floor
        bend_t = g + ett if g + ett > floor and not plain else g + floor
        return (0.0 if fixed_s else -gs / bend_s), (0.0 if fixed_t else -gt / bend_t)
    a, b, c = e + ess, f + est, g + ett
    if not (a > floor and a * c - b * b > 1e-12 * a * abs(c)):
        a, b, c = e + floor, f, g + floor
    inverse = 1.0 / (a * c - b * b)
    return (b * gt - c * gs) * inverse, (b * gs - a * gt) * inverse


@njit(cache=True, error_model="numpy", nogil=True)
def _descend(
    net: Floats, rational: bool, point: Floats, s: float, t: float, by_s: Floats, by_t: Floats, jet: Floats
) -> tuple[float, float, float]:
    """Down to the nearest point from s, t: its own parameters and squared distance."""
    patch_jet(net, s, t, rational, by_s, by_t, jet)
    away2 = _distance2(jet, point)
    for _ in range(_STEPS):
        to_s, to_t, tried, moved = s, t, away2, False
        for plain in (False, True):
            ds, dt = _direction(jet, point, s, t, plain)
            for _ in range(_TRIALS):
                to_s, to_t = min(max(s + ds, 0.0), 1.0), min(max(t + dt, 0.0), 1.0)
                patch_jet(net, to_s, to_t, rational, by_s, by_t, jet)
                tried = _distance2(jet, point)
                moved = tried <= away2 * (1.0 + _ROUNDING)
                if moved:
                    break
                ds, dt = 0.25 * ds, 0.25 * dt
            if moved:
                break
            patch_jet(net, s, t, rational, by_s, by_t, jet)
        if not moved:
            break
        step = abs(to_s - s) + abs(to_t - t)
        s, t, away2 = to_s, to_t, tried
        if step <= _SAME:
            break
    return s, t, away2


@njit(cache=True, error_model="numpy", nogil=True)
def foot_on_patch(
    net: Floats, rational: bool, rim: int, point: Floats, best: float, by_s: Floats, by_t: Floats, jet: Floats
) -> tuple[float, float, float]:
    """Own parameters and squared distance of the patch's nearest point, if nearer than `best` (squared).

    rim : which edges of the patch are edges of the surface: 1 for s = 0, 2 for s = 1, 4 for t = 0, 8 for t = 1.
          On each of them a foot of its own may lie.
    Otherwise (-1, -1, best).   by_s, by_t, jet : scratch as `patch_jet`.
    """
    s, t, corner = _nearest_corner(net, rational, point)
    patch_jet(net, 0.5, 0.5, rational, by_s, by_t, jet)
    if corner >= _distance2(jet, point):
        s, t = 0.5, 0.5
    found_s, found_t = -1.0, -1.0
    s, t, away2 = _descend(net, rational, point, s, t, by_s, by_t, jet)
    if away2 < best:
        found_s, found_t, best = s, t, away2
    for edge in range(4):
        if rim & (1 << edge):
            s, t = (float(edge), 0.5) if edge < 2 else (0.5, float(edge - 2))
            s, t, away2 = _descend(net, rational, point, s, t, by_s, by_t, jet)
            if away2 < best:
                found_s, found_t, best = s, t, away2
    return found_s, found_t, best
