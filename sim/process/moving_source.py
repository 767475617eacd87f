"""Melted width and depth under a moving Gaussian heat source on a half space (Eagar & Tsai), tabulated once, looked up in 0.1 us.

Source: T. W. Eagar, N.-S. Tsai, Temperature fields produced by traveling distributed heat sources, Welding Journal 62 (1983) 346-s;
written here in lengths of sigma (standard deviation of the source) and with the time integral over phi = atan(sqrt(2 a t) / sigma):

  T - T0 = q / (k sigma) / (pi sqrt(2 pi)) * int_0^(pi/2) exp(-[(X + u tan(phi)^2)^2 + Y^2] cos(phi)^2 / 2 - Z^2 cot(phi)^2 / 2) dphi
  u = v sigma / (2 a),  a = k / (rho c)

The temperature is proportional to q, so that one function of (u, Y), the highest value along X, holds every width: the pool ends
where q / (k sigma (Tm - T0)) times it is 1.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

SPEEDS = np.geomspace(0.02, 12.0, 25)  # of u: from a creeping wide spot to a fast one
REACHES = np.concatenate(([0.0], np.geomspace(0.05, 10.0, 43)))  # of Y and Z, in sigma
_AGES = np.arange(
    -20.0, 14.0, 0.07
)  # ln(2 a t / sigma^2): the step resolves the passing of the source at X = -100 sigma
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_TRIALS = 24  # golden sections: the place of the maximum to 1e-5 of the search, its value far closer
_SCALE = 1.0 / (math.pi * math.sqrt(2.0 * math.pi))


class SourceTable(NamedTuple):
    """Logarithm of the highest dimensionless temperature along X over (ln u, reach).

    ln_speed : (m,) float   reach : (n,) float, sigma   across : (m, n) at depth 0   below : (m, n) at Y = 0
    """

    ln_speed: Array
    reach: Array
    across: Array
    below: Array


@njit(cache=True)
def temperature(x: float, y: float, z: float, u: float) -> float:
    """(T - T0) k sigma / q at a place given in sigma; the source moves towards +x with u = v sigma / 2a."""
    total = 0.0
    for i in range(_AGES.size):
        age = math.exp(_AGES[i])
        along = x + u * age
        power = -0.5 * (along * along + y * y) / (1.0 + age) - 0.5 * z * z / age
        if power > -80.0:
            total += math.exp(power + 0.5 * _AGES[i]) / (1.0 + age)
    return float(_SCALE * 0.5 * (_AGES[1] - _AGES[0]) * total)


@njit(cache=True)
def highest(y: float, z: float, u: float) -> float:
    """Highest temperature along the line (y, z): it lies behind the source, never before it."""
    reach = 0.5 * (y * y + z * z) * u + 3.0  # a fast point source is hottest at r^2 v / 4a behind itself
    low, high = -reach, 0.5
    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_left, at_right = temperature(left, y, z, u), temperature(right, y, z, u)
    for _ in range(_TRIALS):
        if at_left < at_right:
            low, left, at_left = left, right, at_right
            right = low + _GOLDEN * (high - low)
            at_right = temperature(right, y, z, u)
        else:
            high, right, at_right = right, left, at_left
            left = high - _GOLDEN * (high - low)
            at_left = temperature(left, y, z, u)
    return max(at_left, at_right)


@njit(cache=True)
def _fill(speeds: Array, reaches: Array, across: Array, below: Array) -> None:
    for i in range(speeds.size):
        for j in range(reaches.size):
            across[i, j] = math.log(max(highest(reaches[j], 0.0, speeds[i]), 1e-300))
            below[i, j] = math.log(max(highest(0.0, reaches[j], speeds[i]), 1e-300))


@cache
def source_table() -> SourceTable:
    """The table, computed once a process."""
    across, below = np.empty((SPEEDS.size, REACHES.size)), np.empty((SPEEDS.size, REACHES.size))
    _fill(SPEEDS, REACHES, across, below)
    return SourceTable(np.log(SPEEDS), REACHES, across, below)


@njit(cache=True)
def melted(table: SourceTable, strength: float, u: float) -> tuple[float, float]:
    """Half width and depth of the molten pool, in sigma.

    strength : q / (k sigma (Tm - T0))   u : v sigma / 2a, held within the table's bounds.  (0, 0): nothing melts.
    """
    if strength <= 0.0:
        return 0.0, 0.0
    wanted = -math.log(strength)
    place = (math.log(max(u, 1e-9)) - table.ln_speed[0]) / (table.ln_speed[1] - table.ln_speed[0])
    row = min(max(int(place), 0), table.ln_speed.size - 2)
    share = min(max(place - row, 0.0), 1.0)
    return _reach(table.reach, table.across[row], table.across[row + 1], share, wanted), _reach(
        table.reach, table.below[row], table.below[row + 1], share, wanted
    )


@njit(cache=True)
def _reach(reach: Array, slow: Array, fast: Array, share: float, wanted: float) -> float:
    """Where the logarithm of the temperature, falling along `reach`, is `wanted`; between two rows of the table."""
    low, high = 0, reach.size - 1
    at_low = slow[0] + share * (fast[0] - slow[0])
    at_high = slow[high] + share * (fast[high] - slow[high])
    if wanted >= at_low:
        return 0.0
    if wanted <= at_high:
        return float(reach[high])
    while high - low > 1:
        middle = (low + high) // 2
        value = slow[middle] + share * (fast[middle] - slow[middle])
        if value > wanted:
            low, at_low = middle, value
        else:
            high, at_high = middle, value
    part = (at_low - wanted) / (at_low - at_high)
    if low == 0 and at_low - at_high < 0.02:  # the top of the bell is a parabola
        part = math.sqrt(part)
    return float(reach[low] + part * (reach[high] - reach[low]))
