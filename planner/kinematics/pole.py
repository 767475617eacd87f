"""Past the pole of a rotary pair, where the tool stands along the spin joint, at bounded speed of both joints: by leaning a little."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kinematics.chain import TOOL_AXIS, Floats, rotated
from planner.kinematics.inverse import RotaryPair, rotary_angles, tilt_for_spin

Ints = NDArray[np.int64]

_GRID_DEG = 1.0  # of the spin joint's angles looked at
_PINNED_DEG = 0.02  # off the planned axis, at most, where the way begins and ends
_LEAN_COST = 3.0  # of leaning by the whole cone at one station, against a station at the full speed of a joint
_TOO_FAST = 100.0  # cost of speed beyond what the joint has, squared
_SMOOTHINGS = 3  # of the spin's steps on the grid, by halves of both neighbours
_HELD_STATIONS = 5.5  # on either side of the pole: the spin stands there, so that a spline over the stations goes through it


def round_the_pole(pair: RotaryPair, axes: Floats, steps_deg: Floats, cone_deg: float) -> Floats:
    """(n, 3) unit vectors, none farther than the cone from the axes given: those that the rotary joints follow at bounded speed.

    axes : (n, 3) float, unit vectors, table frame, as planned; the first and the last stay
    steps_deg : (n - 1, 2) float, > 0, what (first, second) joint of the pair may turn from station to station
    Candidates of a station are spin angles, each with the tilt that brings the tool nearest to the planned axis; the cheapest
    way through them by dynamic programming: lean squared and speed squared, speed beyond the limit only where nothing else leads on.
    """
    spin = pair.spin
    planned = rotary_angles(pair, axes).angles[:, 0, spin]
    clear = ~rotary_angles(pair, axes, np.deg2rad(_PINNED_DEG)).is_free
    at = np.flatnonzero(clear) if clear.any() else np.arange(1)
    led = np.unwrap(planned[at], period=360.0)
    grid = np.arange(led.min() - 190.0, led.max() + 190.0, _GRID_DEG)
    tilts, lean, off = _candidates(pair, axes, grid)
    held = _HELD_STATIONS * _between_deg(axes[1:], axes[:-1])
    tilts = np.unwrap(tilts, period=360.0, axis=1)
    allowed = np.full(len(axes), cone_deg)
    allowed[[0, -1]] = _PINNED_DEG + _GRID_DEG * _off_spin_deg(pair, axes[[0, -1]]) / 57.0
    per_step = np.column_stack([steps_deg[:, spin], steps_deg[:, 1 - spin]])
    places = _slowest(tilts, lean, off, np.minimum(allowed, cone_deg), per_step / np.array([_GRID_DEG, 1.0]), held, cone_deg)
    angles = grid[places]
    for _ in range(_SMOOTHINGS):
        angles[1:-1] = 0.5 * angles[1:-1] + 0.25 * (angles[:-2] + angles[2:])
    led_axes = axes_at(pair, angles, tilt_for_spin(pair, axes, angles))
    led_axes[[0, -1]] = axes[[0, -1]]
    far = np.einsum("ij,ij->i", led_axes, axes) < np.cos(np.deg2rad(cone_deg))
    if far.any():
        angles = grid[places]
        led_axes = axes_at(pair, angles, tilt_for_spin(pair, axes, angles))
        led_axes[[0, -1]] = axes[[0, -1]]
    return led_axes


def axes_at(pair: RotaryPair, spin_deg: Floats, tilt_deg: Floats) -> Floats:
    """(n, 3) unit vectors, table frame: the tool axis at angles (n,) of the spin and the tilt joint."""
    still = np.broadcast_to(TOOL_AXIS, (len(spin_deg), 3))
    spin, tilt = (pair.first, pair.second)[pair.spin], (pair.first, pair.second)[1 - pair.spin]
    by_spin, by_tilt = pair.sense[pair.spin] * spin_deg, pair.sense[1 - pair.spin] * tilt_deg
    if pair.axis_is_p:  # axis = exp(-second) exp(-first) z
        return rotated(rotated(still, tilt.direction, -by_tilt), spin.direction, -by_spin)
    return rotated(rotated(still, tilt.direction, by_tilt), spin.direction, by_spin)


def _off_spin_deg(pair: RotaryPair, axes: Floats) -> Floats:
    spin = (pair.first, pair.second)[pair.spin].direction
    return np.asarray(np.rad2deg(np.arcsin(np.clip(np.linalg.norm(np.cross(axes, spin), axis=1), 0.0, 1.0))))


def _between_deg(first: Floats, second: Floats) -> Floats:
    return np.asarray(np.rad2deg(2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(first - second, axis=-1), 0.0, 1.0))))


def _candidates(pair: RotaryPair, axes: Floats, grid: Floats) -> tuple[Floats, Floats, Floats]:
    """For each spin angle of the grid, deg, (n, g) each: the tilt, how far the tool is off the planned axis and off the pole with it."""
    n, g = len(axes), len(grid)
    wanted = np.repeat(axes, g, axis=0)
    spin = np.tile(grid, n)
    tilt = tilt_for_spin(pair, wanted, spin)
    there = axes_at(pair, spin, tilt)
    lean, off = _between_deg(there, wanted), _off_spin_deg(pair, there)
    return tilt.reshape(n, g), lean.reshape(n, g), off.reshape(n, g)


@njit(cache=True)
def _slowest(
    tilts: Floats, lean: Floats, off: Floats, allowed: Floats, per_step: Floats, held: Floats, cone_deg: float
) -> Ints:
    """(n,) places in the grid: the cheapest way.

    per_step : (n - 1, 2) float, places of the spin and deg of the tilt   held : (n - 1,) float, deg off the pole, nearer the spin stands
    """
    n, g = lean.shape
    here = np.full(g, np.inf)
    back = np.zeros((n, g), dtype=np.int32)
    for j in range(g):
        if lean[0, j] <= allowed[0]:
            here[j] = 0.0
    if not np.isfinite(here).any():
        here[np.argmin(lean[0])] = 0.0
    for i in range(1, n):
        new = np.full(g, np.inf)
        reach = int(3.0 * per_step[i - 1, 0]) + 1
        for j in range(g):
            if lean[i, j] > allowed[i]:
                continue
            share = lean[i, j] / cone_deg
            for a in range(max(j - reach, 0), min(j + reach + 1, g)):
                if not np.isfinite(here[a]) or (a != j and min(off[i, j], off[i - 1, a]) < held[i - 1]):
                    continue
                spin = abs(j - a) / per_step[i - 1, 0]
                tilt = abs(tilts[i, j] - tilts[i - 1, a]) / per_step[i - 1, 1]
                total = here[a] + _LEAN_COST * share * share + spin * spin + tilt * tilt
                total += _TOO_FAST * (max(spin - 1.0, 0.0) ** 2 + max(tilt - 1.0, 0.0) ** 2)
                if total < new[j]:
                    new[j] = total
                    back[i, j] = a
        if not np.isfinite(new).any():
            nearest, last = int(np.argmin(lean[i])), int(np.argmin(here))
            new[nearest], back[i, nearest] = here[last] + _TOO_FAST * n, last
        here = new
    places = np.zeros(n, dtype=np.int64)
    places[n - 1] = np.argmin(here)
    for i in range(n - 1, 0, -1):
        places[i - 1] = back[i, places[i]]
    return places
