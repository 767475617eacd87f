"""Speed of the tip along a pass: as asked, lowered smoothly where the axes cannot hold it (velocity, acceleration, jerk)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from config.cell import Axis
from planner.kinematics.chain import Floats

Ints = NDArray[np.int64]

JERK_OF_PATH = 0.6
"""Of an axis' jerk: what following the path at constant speed may take; the rest is for changing speed."""
_JERK_OF_TURNING = 0.6  # of an axis' jerk: what a change of speed on a curved stretch may take by its acceleration
_JERK_LEAST = (
    0.2  # of an axis' jerk: what there is for a change of speed at least; where that is too much, speed is lowered
)
_JERK_OF_ENDING = 0.5  # of the jerk left: what the end of a rise takes, in steps of the grid
_LEAST_MM_S = (
    0.05  # below it a change of speed is reckoned as at it: the jerk of a standstill has no bound along the path
)
_ROUNDING = 1.0  # half of the time over which kinks of the caps are rounded, of the time in which an axis reaches its greatest acceleration
_ROUNDS = 6  # of lowering the speed where changes of it take more jerk than there is
_LOWERING = 0.25  # exponent of the jerk's excess by which the squared speed is lowered in a round
_JERK_SLACK = 1.1  # relative: jerk taken as within its limit
_JERK_S = 0.01  # over which jerk is meant: no drive tells shorter changes apart
_CELLS_PER_RAMP = 24.0  # of the grid, in the way in which an axis reaches its greatest acceleration
_CELLS_MOST = 400  # of one move
_GRADING = 0.15  # by how much of the distance to a slower move cells may grow
_CORNER_COSINE = 0.8  # moves that turn more than this (37 deg) meet in a corner: the control's look-ahead passes it


@dataclass(frozen=True)
class AxisLimits:
    """velocity, acceleration, jerk : (5,) float each, mm or deg per s, s2, s3."""

    velocity: Floats
    acceleration: Floats
    jerk: Floats

    @classmethod
    def of(cls, axes: tuple[Axis, ...]) -> AxisLimits:
        """Of a cell's axes."""
        rows = np.array([[axis.max_velocity, axis.max_acceleration, axis.jerk] for axis in axes])
        return cls(rows[:, 0], rows[:, 1], rows[:, 2])


@dataclass(frozen=True)
class SpeedProfile:
    """Speed over the way.

    way_mm : (m,) float, of the tip from the start of the pass, increasing   speed_mm_s : (m,) float, linear in time between
    move : (m - 1,) int, which of the pass's moves each stretch belongs to
    limiting : (moves,) int, the axis that holds the asked speed least there, 3 * column + 0 velocity, 1 acceleration, 2 jerk; -1: none
    """

    way_mm: Floats
    speed_mm_s: Floats
    move: Ints
    limiting: Ints

    @property
    def stretch_times_s(self) -> Floats:
        """(m - 1,) float, s."""
        return np.asarray(2.0 * np.diff(self.way_mm) / (self.speed_mm_s[1:] + self.speed_mm_s[:-1]))

    @property
    def times_s(self) -> Floats:
        """(moves,) float, s: what each move takes."""
        return np.asarray(np.bincount(self.move, self.stretch_times_s, len(self.limiting)), dtype=np.float64)


def speed_profile(joints: Floats, way_mm: Floats, asked_mm_s: Floats, limits: AxisLimits) -> SpeedProfile:
    """The greatest smooth speed of the tip that is nowhere above what is asked and that every axis can follow.

    joints : (n, 5) float, mm or deg, ends of straight joint moves that follow a smooth path but for corners
    way_mm : (n,) float, strictly increasing, way of the tip there   asked_mm_s : (n - 1,) float, > 0
    Along each stretch without corners, with q the joints over the way s: |q'| v <= velocity, |q'' v2 + q' a| <= acceleration,
    |q''' v3 + 3 q'' v a + q' j| <= jerk, derivatives by divided differences; O(n). Source: time scaling of paths as in
    Verscheure et al., IEEE TAC 54 (2009) 2318 (squared speed over the way); the two sweeps keep acceleration and its growth.
    """
    first, second, third = derivatives(joints, way_mm, _JERK_S * asked_mm_s)
    held, limiting = _held(first, second, third, asked_mm_s, limits)
    if (held >= asked_mm_s).all() and np.ptp(asked_mm_s) <= 1e-9 * asked_mm_s[0]:
        return SpeedProfile(way_mm, np.full(len(way_mm), asked_mm_s[0]), np.arange(len(asked_mm_s)), limiting)
    ramp_s = float(np.max(limits.acceleration / limits.jerk))
    way, move = _grid(way_mm, np.minimum(held, asked_mm_s) * ramp_s / _CELLS_PER_RAMP)
    near = _nearness(way_mm, way, move)
    at = np.append(move, move[-1])
    grid1 = np.abs(first[move])
    grid2 = near[:, :1] * second[at] + near[:, 1:] * second[at + 1]
    grid3 = np.abs(near[:, :1] * third[at] + near[:, 1:] * third[at + 1])
    cap = _caps(_fast_enough(first, near, at, limits), grid2, grid3, asked_mm_s[move], limits)
    bend, step, inertia = np.abs(grid2), np.diff(way), (limits.acceleration, limits.jerk)
    smooth1 = _at_places(first, near, at)
    for _ in range(_ROUNDS):
        cap = _without_peaks(way, cap, _ROUNDING * ramp_s)
        back = _swept(cap[::-1], step[::-1], grid1[::-1], bend[::-1], grid3[::-1], *inertia)
        square = _swept(back[::-1], step, grid1, bend, grid3, *inertia)
        share = _jerk_share(way, square, smooth1, grid2, limits.jerk)
        if share.max() <= _JERK_SLACK:
            break
        cap = np.minimum(cap, square * _spread(way, square, share, ramp_s) ** -_LOWERING)
    return SpeedProfile(way, np.sqrt(square), move, limiting)


def _at_places(first: Floats, near: Floats, at: Ints) -> Floats:
    """(m, 5) first derivatives that change evenly from move to move."""
    left, right = np.vstack([first[:1], first[:-1]])[at], np.vstack([first[1:], first[-1:]])[at]
    here = first[at]
    return np.asarray(here + 0.5 * near[:, :1] * (left - here) + 0.5 * near[:, 1:] * (right - here))


def _jerk_share(way: Floats, square: Floats, grid1: Floats, grid2: Floats, jerk: Floats) -> Floats:
    """(m,) largest jerk of an axis over its limit, as the mean over _JERK_S about each place."""
    time = np.append(0.0, np.cumsum(2.0 * np.diff(way) / (np.sqrt(square[1:]) + np.sqrt(square[:-1]))))
    tangential = np.gradient(square, way) * 0.5
    ahead, behind = np.minimum(time + 0.5 * _JERK_S, time[-1]), np.maximum(time - 0.5 * _JERK_S, 0.0)
    share = np.zeros(len(way))
    for k in range(grid1.shape[1]):
        acceleration = grid2[:, k] * square + grid1[:, k] * tangential
        grown = np.interp(ahead, time, acceleration) - np.interp(behind, time, acceleration)
        share = np.maximum(share, np.abs(grown) / np.maximum(ahead - behind, 1e-9) / jerk[k])
    return share


def _spread(way: Floats, square: Floats, share: Floats, ramp_s: float) -> Floats:
    """(m,) the share, 1 at least, carried to all places within a ramp and evened."""
    reach = np.sqrt(square) * ramp_s
    low, high = np.searchsorted(way, way - reach), np.searchsorted(way, way + reach, side="right")
    most = np.maximum(_window_max(np.maximum(share, 1.0), low, high), 1.0)
    whole = np.concatenate([[0.0], np.cumsum(0.5 * (most[1:] + most[:-1]) * np.diff(way))])
    ahead, behind = np.minimum(way + reach, way[-1]), np.maximum(way - reach, way[0])
    return np.asarray(
        (np.interp(ahead, way, whole) - np.interp(behind, way, whole)) / np.maximum(ahead - behind, 1e-12)
    )


@njit(cache=True)
def _window_max(values: Floats, low: Ints, high: Ints) -> Floats:
    """(m,) greatest of values[low[i] : high[i]]."""
    result = np.empty(len(values))
    for i in range(len(values)):
        result[i] = np.max(values[low[i] : high[i]])
    return result


def derivatives(joints: Floats, way_mm: Floats, meant_mm: Floats) -> tuple[Floats, Floats, Floats]:
    """First (n - 1, 5), second and third (n, 5) derivatives of the joints over the way; corners and ends have no second and third ones.

    meant_mm : (n - 1,) float, third derivatives are meant over no less
    """
    step = np.diff(way_mm)[:, None]
    first = np.diff(joints, axis=0) / step
    second, third = np.zeros_like(joints), np.zeros_like(joints)
    if len(step) < 2:
        return first, second, third
    length = np.linalg.norm(first, axis=1)
    cosine = np.einsum("ij,ij->i", first[1:], first[:-1]) / np.maximum(length[1:] * length[:-1], 1e-300)
    smooth = np.concatenate([[False], cosine > _CORNER_COSINE, [False]])
    second[1:-1] = 2.0 * np.diff(first, axis=0) / (step[1:] + step[:-1])
    second[~smooth] = 0.0
    between = np.diff(second, axis=0) / np.maximum(step, meant_mm[:, None])
    between[~(smooth[1:] & smooth[:-1])] = 0.0
    larger = np.abs(between[1:]) > np.abs(between[:-1])
    third[1:-1] = np.where(larger, between[1:], between[:-1])
    return first, second, third


def _held(first: Floats, second: Floats, third: Floats, asked: Floats, limits: AxisLimits) -> tuple[Floats, Ints]:
    """(moves,) mm/s that the axes hold at constant speed, and which axis by what is the least (or -1)."""
    two = np.maximum(np.abs(second[1:]), np.abs(second[:-1]))
    three = np.maximum(np.abs(third[1:]), np.abs(third[:-1]))
    with np.errstate(divide="ignore"):
        by = np.stack(
            [
                limits.velocity / np.abs(first),
                np.sqrt(limits.acceleration / two),
                np.cbrt(JERK_OF_PATH * limits.jerk / three),
            ],
            axis=2,
        ).reshape(len(first), -1)
    least = np.argmin(by, axis=1)
    held = by[np.arange(len(by)), least]
    return held, np.where(held < asked, least, -1)


@njit(cache=True)
def _grid(way_mm: Floats, cell_mm: Floats) -> tuple[Floats, Ints]:
    """Places (m,) in the moves, near together where a move or its neighbour is slow, and the move of each cell (m - 1,).

    cell_mm : (moves,) length of cells at the speed that the axes hold in each move
    """
    n = len(cell_mm)
    way = np.empty(n * (_CELLS_MOST + 1) + 1)
    move = np.empty(len(way), np.int64)
    m = 0
    for i in range(n):
        left = min(cell_mm[max(i - 1, 0)], cell_mm[i])
        right = min(cell_mm[min(i + 1, n - 1)], cell_mm[i])
        length = way_mm[i + 1] - way_mm[i]
        least = length / _CELLS_MOST
        at = 0.0
        while at < length * (1.0 - 1e-9):
            way[m], move[m] = way_mm[i] + at, i
            m += 1
            cell = min(cell_mm[i], left + _GRADING * at, right + _GRADING * (length - at))
            left_over = length - at
            cell = max(cell, least)
            at += left_over if left_over < 1.5 * cell else cell
    way[m] = way_mm[n]
    return way[: m + 1].copy(), move[:m].copy()


def _nearness(way_mm: Floats, way: Floats, move: Ints) -> Floats:
    """(m, 2) share of the move's first and last end at each place: 1 there, 0 as far off as the shorter of the two moves that meet there."""
    length = np.diff(way_mm)
    at = np.append(move, move[-1])
    shorter = np.minimum(length[1:], length[:-1])
    begin, end = np.append(length[0], shorter)[at], np.append(shorter, length[-1])[at]
    return np.clip(1.0 - np.column_stack([(way - way_mm[at]) / begin, (way_mm[at + 1] - way) / end]), 0.0, 1.0)


def _fast_enough(first: Floats, near: Floats, at: Ints, limits: AxisLimits) -> Floats:
    """(m,) mm/s that the axes' velocities allow at each place, without steps where the move before or behind is slower."""
    allowed = np.min(limits.velocity / np.maximum(np.abs(first), 1e-12), axis=1)
    before, behind = np.append(allowed[0], allowed[:-1]), np.append(allowed[1:], allowed[-1])
    lost = np.maximum(allowed - np.minimum(before, allowed), 0.0)[at] * near[:, 0]
    return np.asarray(allowed[at] - np.maximum(lost, np.maximum(allowed - behind, 0.0)[at] * near[:, 1]))


def _caps(fast: Floats, grid2: Floats, grid3: Floats, asked: Floats, limits: AxisLimits) -> Floats:
    """(m,) squared speed that neither the request (m - 1,) nor an axis at constant speed exceeds on either side of a place."""
    with np.errstate(divide="ignore"):
        place = np.minimum(fast**2, np.min(limits.acceleration / np.abs(grid2), axis=1))
        place = np.minimum(place, np.min(JERK_OF_PATH * limits.jerk / grid3, axis=1) ** (2.0 / 3.0))
    place[:-1] = np.minimum(place[:-1], asked**2)
    place[1:] = np.minimum(place[1:], asked**2)
    return np.asarray(place)


@njit(cache=True)
def _swept(
    cap: Floats,
    step: Floats,
    grid1: Floats,
    grid2: Floats,
    grid3: Floats,
    acceleration: Floats,
    jerk: Floats,
) -> Floats:
    """Squared speed that nowhere rises faster than the axes can be accelerated; its rise begins and ends no faster than jerk allows.

    cap : (m,) not exceeded   step : (m - 1,) mm   grid1 : (m - 1, 5), grid2, grid3 : (m, 5) absolute derivatives
    With z = v2 over the way: dz/ds = 2 a, d(dz/ds)/ds = 2 j / v; the rise ends at the cap: a2 <= 2 j (v_cap - v).
    """
    z = np.empty(len(cap))
    z[0] = cap[0]
    rise = 0.0
    for i in range(len(step)):
        v = max(np.sqrt(z[i]), _LEAST_MM_S)
        most, growth, turning = np.inf, np.inf, np.inf
        for k in range(grid1.shape[1]):
            one, three = grid1[i, k], max(grid3[i, k], grid3[i + 1, k])
            two = max(abs(grid2[i, k]), abs(grid2[i + 1, k]))
            if two > 0.0:
                turning = min(turning, _JERK_OF_TURNING * jerk[k] / (3.0 * two * v))
            if one > 0.0:
                most = min(most, max(acceleration[k] - two * z[i], 0.0) / one)
                left = jerk[k] - three * v**3 - 3.0 * two * v * 0.5 * abs(rise)
                growth = min(growth, max(left, _JERK_LEAST * jerk[k]) / one)
        most, slope = min(most, turning), (cap[i + 1] - cap[i]) / step[i]
        # the growth of one step, solved for at its end: it is slow where it begins
        wanted = z[i] + max(rise, 0.0) * step[i] + growth / v * step[i] ** 2
        faster = max(np.sqrt(wanted), v)
        after = min(rise + 2.0 * growth / faster * step[i], 2.0 * most)
        ahead = np.sqrt(max(z[i] + 0.5 * (max(rise, 0.0) + max(after, 0.0)) * step[i], 0.0))
        room = max(np.sqrt(cap[i + 1]) - ahead, 0.0)
        ending = max(slope + 2.0 * np.sqrt(2.0 * _JERK_OF_ENDING * growth * room), 0.5 * (cap[i + 1] - z[i]) / step[i])
        after = max(min(after, ending), min(slope, 0.0))
        z[i + 1] = min(z[i] + 0.5 * (rise + after) * step[i], z[i] + after * step[i])
        z[i + 1] = max(z[i + 1], min(z[i], cap[i + 1]))
        if z[i + 1] > cap[i + 1]:
            z[i + 1] = cap[i + 1]
            after = min(after, (z[i + 1] - z[i]) / step[i])
        rise = after
    return z


def _without_peaks(way: Floats, square: Floats, ramp_s: float) -> Floats:
    """(m,) squared speed, its convex kinks rounded from below over the way of two ramps of the acceleration."""
    reach = np.minimum(np.sqrt(square) * ramp_s, np.minimum(way - way[0], way[-1] - way))
    whole = np.concatenate([[0.0], np.cumsum(0.5 * (square[1:] + square[:-1]) * np.diff(way))])
    inside = reach > 0.0
    mean = square.copy()
    ahead, behind = np.interp(way + reach, way, whole), np.interp(way - reach, way, whole)
    mean[inside] = (ahead - behind)[inside] / (2.0 * reach[inside])
    return np.minimum(mean, square)
