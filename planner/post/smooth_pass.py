"""Passes whose rotary joints would jerk: their axis evened along the way, by so much as the process allows, tip and ends kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.cell import Tool
from planner.kinematics.chain import Floats
from planner.kinematics.feed import JERK_OF_PATH, AxisLimits, derivatives
from planner.kinematics.pole import axes_at
from planner.post.leaned import Stations, leaned_curve
from planner.post.linearise import LinearOperation, angle_between_deg
from planner.post.pass_curve import PassCurve
from planner.post.poses import PoseSolver

CONE_SHARE = 0.2
"""Of the cone that the process allows: how far evening may take the axis off the planned one."""
_PITCH_MM = 0.4
_REACHES_MM = (6.0, 4.5, 3.0, 2.0, 1.5, 1.0, 0.7, 0.4)
"""Of the evening to either side; the greatest that keeps to its bound is taken."""
_ROUNDS = 3  # of running means: together a smooth bell, twice continuously differentiable
_JERK_S = 0.01  # over which jerk is meant, as in the feed
_SAME_ARC_MM = 1e-6


@dataclass(frozen=True)
class RotaryShare:
    """held : (passes,) float, mean speed over a pass that the rotary joints hold by themselves, of the asked one; 1 for links"""

    held: Floats

    @property
    def short(self) -> NDArray[np.bool_]:
        """(passes,) bool: passes that they slow."""
        return np.asarray(self.held < _HELD)


_HELD = 0.99


def rotary_share(curves: Sequence[PassCurve], moves: LinearOperation, solver: PoseSolver) -> RotaryShare:
    """What velocity, acceleration and jerk of the rotary joints leave of the asked speed along the passes as sampled."""
    held = np.ones(len(curves))
    columns = list(solver.pair.columns)
    limits = AxisLimits.of(tuple(solver.cell.axes[column] for column in columns))
    for index, (arcs, joints) in _sampled(curves, moves, columns).items():
        asked = _asked(curves[index], arcs)
        first, second, third = (np.abs(item) for item in derivatives(joints, arcs, _JERK_S * asked))
        two, three = np.maximum(second[1:], second[:-1]), np.maximum(third[1:], third[:-1])
        by_speed = (first / limits.velocity * asked[:, None]).max(axis=1)
        by_change = np.sqrt((two / limits.acceleration).max(axis=1)) * asked
        by_jerk = np.cbrt((three / (JERK_OF_PATH * limits.jerk)).max(axis=1)) * asked
        slow = np.maximum(np.maximum(np.maximum(by_speed, by_change), by_jerk), 1.0)
        planned_s = np.diff(arcs) / asked
        held[index] = planned_s.sum() / (planned_s * slow).sum()
    return RotaryShare(held)


def smoothed(
    curves: Sequence[PassCurve], which: NDArray[np.bool_], moves: LinearOperation, solver: PoseSolver, placed: Floats, tool: Tool,
    cone_deg: float,
) -> list[PassCurve]:  # fmt: skip
    """The passes, those of `which` (passes,) with evened rotary joints, no axis farther than CONE_SHARE of the cone off the planned one."""
    result = list(curves)
    columns = list(solver.pair.columns)
    for index, (arcs, joints) in _sampled(curves, moves, columns).items():
        if which[index]:
            result[index] = _evened(curves[index], arcs, joints, solver, placed, tool, CONE_SHARE * cone_deg)
    return result


def _evened(
    curve: PassCurve, arcs: Floats, joints: Floats, solver: PoseSolver, placed: Floats, tool: Tool, bound_deg: float
) -> PassCurve:
    stations = Stations.along(curve, _PITCH_MM)
    pair = solver.pair
    angles = np.column_stack([np.interp(stations.arc_mm, arcs, joints[:, k]) for k in range(2)])
    planned = np.asarray(curve.axes(stations.parameter))
    for reach_mm in _REACHES_MM:
        even = np.linspace(0.0, curve.length_mm, max(round(curve.length_mm / (0.25 * _PITCH_MM)), 8) + 1)
        wide = np.column_stack([np.interp(even, arcs, joints[:, k]) for k in range(2)])
        wide = _bell(wide, reach_mm / (_ROUNDS * (even[1] - even[0])))
        angles = np.column_stack([np.interp(stations.arc_mm, even, wide[:, k]) for k in range(2)])
        axes = axes_at(pair, angles[:, pair.spin], angles[:, 1 - pair.spin])
        axes[[0, -1]] = planned[[0, -1]]
        if angle_between_deg(axes, planned).max() <= bound_deg:
            return leaned_curve(curve, stations, _through(axes), placed, tool)
    return curve


def _bell(values: Floats, half: float) -> Floats:
    """(n, d) running means of rows, `half` rows to either side, _ROUNDS times; the ends stay, what is beyond them is turned about them."""
    reach = min(round(half), (len(values) - 1) // 2)
    if reach < 1:
        return values
    for _ in range(_ROUNDS):
        before = 2.0 * values[0] - values[reach:0:-1]
        behind = 2.0 * values[-1] - values[-2 : -reach - 2 : -1]
        sums = np.cumsum(np.vstack([np.zeros((1, values.shape[1])), before, values, behind]), axis=0)
        values = (sums[2 * reach + 1 :] - sums[: -2 * reach - 1]) / (2 * reach + 1)
    return np.asarray(values)


def _through(axes: Floats) -> Floats:
    """(n, 3) control points whose even cubic spline goes through the axes but for terms of fourth order; the outer ones stay."""
    points = axes.copy()
    points[2:-2] -= (axes[1:-3] - 2.0 * axes[2:-2] + axes[3:-1]) / 6.0
    return points


def _asked(curve: PassCurve, arcs: Floats) -> Floats:
    """(n - 1,) mm/s between arc lengths (n,)."""
    at = np.searchsorted(curve.set_point_arcs, arcs[:-1] + _SAME_ARC_MM, side="right") - 1
    return np.asarray(curve.source.setpoints[at.clip(0), 1])


def _sampled(curves: Sequence[PassCurve], moves: LinearOperation, columns: list[int]) -> dict[int, tuple[Floats, Floats]]:
    """Pass -> arc lengths (n,), rising, and rotary joints (n, 2) at its samples; of passes at feed whose rotary joints turn."""
    rows = moves.sampled.rows if moves.sampled is not None else moves.rows
    joints = moves.sampled.tube.joints if moves.sampled is not None else moves.poses.joints
    first = np.flatnonzero(rows.is_first)
    found = {}
    for begin, end in zip(first, np.append(first[1:], len(rows.arc_mm)), strict=True):
        index, part = int(rows.pass_[begin]), slice(int(begin), int(end))
        turning = joints[part][:, columns]
        kept = np.append(True, np.diff(rows.arc_mm[part]) > _SAME_ARC_MM)
        if not curves[index].source.is_link and kept.sum() > 3 and np.ptp(turning, axis=0).max() > 0.0:
            found[index] = rows.arc_mm[part][kept], turning[kept]
    return found
