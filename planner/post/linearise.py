"""Passes to straight moves of the joints: as few as keep the true tip and axis within the cell's tolerances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.errors import ReachError
from planner.kinematics.chain import Chain, Floats
from planner.post.pass_curve import PassCurve
from planner.post.poses import Poses, PoseSolver, Rows

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

# How the tolerance is shared out: samples of the curve, samples of moves with rotary motion, moves merged; words rounded take the rest.
_SAMPLE_SHARE = 0.05
_MOTION_SHARE = 0.35
_MERGE_SHARE = 0.8
_MERGE_SHARE_TURNING = 0.5
_PROBES = (0.25, 0.5, 0.75)  # of a move, where its true path is compared with the pass
_MAX_HALVINGS = 26  # 2^-26 of a span of the curve: a pose that still jumps there jumps
_MERGE_PROBES = 24  # rows looked at in a long merged move: it is smooth, and the written text is read back all along
_STANDS_DEG = 1e-7  # rotary motion below it moves the tip by less than a rounding error


@dataclass(frozen=True)
class LinearOperation:
    """Rows that the machine goes through in straight joint moves.

    rows : those that are kept   poses : of the same rows
    """

    rows: Rows
    poses: Poses


@dataclass
class _Samples:
    """Parameters of one pass with tip, axis and arc length there."""

    parameter: Floats
    is_fixed: Bools
    tip: Floats
    axis: Floats
    arc_mm: Floats

    @classmethod
    def of(cls, curve: PassCurve, parameter: Floats, is_fixed: Bools) -> _Samples:
        return cls(parameter, is_fixed, curve.tips(parameter), curve.axes(parameter), curve.arc_length(parameter))


def linearise(
    curves: Sequence[PassCurve], solver: PoseSolver, start: Floats, tip_tolerance_mm: float, axis_tolerance_deg: float
) -> LinearOperation:
    """Straight joint moves for the passes of one operation with one tool.

    start : (5,) float, joints where the machine stands
    The true tip path between two rows (joints move linearly, the tip does not) is measured on the forward kinematics and
    halved until it and the axis are within their share of the tolerance; then moves are merged as far as the rest allows.
    Raises ReachError where the rotary joints would have to jump, or where no pose gives the axis.
    """
    places = [curve.place for curve in curves]
    samples = [_Samples.of(curve, *curve.first_parameters(_SAMPLE_SHARE * tip_tolerance_mm)) for curve in curves]
    for _ in range(_MAX_HALVINGS):
        rows = _joined(curves, samples)
        poses = solver.solve(rows, start, places)
        wide = _wide_moves(
            curves, solver, rows, poses, _MOTION_SHARE * tip_tolerance_mm, _MOTION_SHARE * axis_tolerance_deg
        )
        if wide.size == 0:
            break
        _halve(curves, samples, rows, wide)
    else:
        at = solver.pair.spin
        letter = (solver.pair.first, solver.pair.second)[at].letter
        raise ReachError(
            f"axis {letter} would have to jump within {places[int(rows.pass_[wide[0]])]}",
            "the tool axis passes a singular pose or the end of a travel: turn the part on the table (placement.rotation_deg)",
        )
    fixed = np.concatenate([sample.is_fixed for sample in samples])
    per_joint = _sensitivity(solver.chain, poses.joints, solver.tool_tip_mm)
    is_rotary = np.isin(np.arange(5), solver.pair.columns)
    share = np.where(_turns(curves, solver, rows, poses), _MERGE_SHARE_TURNING, _MERGE_SHARE)
    budget = share[:, None] * np.array([tip_tolerance_mm, axis_tolerance_deg])
    kept = _merged(poses.joints, rows.arc_mm, fixed, per_joint, is_rotary, budget)
    return LinearOperation(_only(rows, kept), Poses(poses.joints[kept], poses.needs_positioning[kept]))


def _joined(curves: Sequence[PassCurve], samples: Sequence[_Samples]) -> Rows:
    counts = [len(sample.parameter) for sample in samples]
    return Rows(
        np.concatenate([sample.tip for sample in samples]),
        np.concatenate([sample.axis for sample in samples]),
        np.concatenate([sample.arc_mm for sample in samples]),
        np.concatenate([sample.parameter for sample in samples]),
        np.repeat(np.arange(len(samples)), counts),
        np.repeat(np.array([curve.source.rapid for curve in curves]), counts),
    )


def _only(rows: Rows, kept: Bools) -> Rows:
    return Rows(
        rows.tip[kept], rows.axis[kept], rows.arc_mm[kept], rows.parameter[kept], rows.pass_[kept], rows.is_rapid[kept]
    )


def _wide_moves(
    curves: Sequence[PassCurve], solver: PoseSolver, rows: Rows, poses: Poses, tip_mm: float, axis_deg: float
) -> Ints:
    """Indices of moves (from that row to the next) with rotary motion whose true path leaves the tolerances."""
    moves = np.flatnonzero((np.diff(rows.pass_) == 0) & _turns(curves, solver, rows, poses)[1:])
    if moves.size == 0:
        return moves
    is_wide = np.zeros(len(moves), dtype=np.bool_)
    edges = np.flatnonzero(np.append(True, np.diff(rows.pass_[moves]) != 0))
    for share in _PROBES:
        joints = poses.joints[moves] + share * (poses.joints[moves + 1] - poses.joints[moves])
        tips, axes = solver.chain.forward(joints, solver.tool_tip_mm)
        guess = rows.parameter[moves] + share * (rows.parameter[moves + 1] - rows.parameter[moves])
        for begin, end in zip(edges, np.append(edges[1:], len(moves)), strict=True):
            curve = curves[int(rows.pass_[moves[begin]])]
            part = slice(int(begin), int(end))
            at = curve.nearest(tips[part], guess[part])
            off_tip = np.linalg.norm(tips[part] - curve.tips(at), axis=1)
            off_axis = angle_between_deg(axes[part], curve.axes(at))
            is_wide[part] |= (off_tip > tip_mm) | (off_axis > axis_deg)
    return moves[is_wide]


def _turns(curves: Sequence[PassCurve], solver: PoseSolver, rows: Rows, poses: Poses) -> Bools:
    """(n,) bool: rows that the machine comes to with rotary motion, or whose pass has an axis that may vary."""
    columns = list(solver.pair.columns)
    turn = np.abs(np.diff(poses.joints[:, columns], axis=0, prepend=poses.joints[:1, columns])).max(axis=1)
    varies = np.array([not curve.has_constant_axis for curve in curves])[rows.pass_]
    return np.asarray((turn > _STANDS_DEG) | varies)


def _halve(curves: Sequence[PassCurve], samples: list[_Samples], rows: Rows, wide: Ints) -> None:
    middle = 0.5 * (rows.parameter[wide] + rows.parameter[wide + 1])
    for index in np.unique(rows.pass_[wide]):
        old, new = samples[index], middle[rows.pass_[wide] == index]
        parameter = np.concatenate([old.parameter, new])
        order = np.argsort(parameter, kind="stable")
        fixed = np.concatenate([old.is_fixed, np.zeros(len(new), dtype=np.bool_)])
        samples[index] = _Samples.of(curves[index], parameter[order], fixed[order])


def _sensitivity(chain: Chain, joints: Floats, tool_tip_mm: Floats) -> Floats:
    """(n, 6, 5) float: motion of the tip, mm, and of the axis, deg, per mm or degree of each joint (central differences)."""
    result = np.empty((len(joints), 6, 5))
    for column in range(5):
        step = np.zeros(5)
        step[column] = 0.01
        ahead, behind = chain.forward(joints + step, tool_tip_mm), chain.forward(joints - step, tool_tip_mm)
        result[:, :3, column] = (ahead[0] - behind[0]) / 0.02
        result[:, 3:, column] = np.rad2deg(ahead[1] - behind[1]) / 0.02
    return result


def angle_between_deg(first: Floats, second: Floats) -> Floats:
    """(n,) deg between unit vectors (n, 3), exact for small angles too."""
    return np.asarray(np.rad2deg(2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(first - second, axis=1), 0.0, 1.0))))


@njit(cache=True)
def _merged(joints: Floats, arc_mm: Floats, fixed: Bools, per_joint: Floats, is_rotary: Bools, budget: Floats) -> Bools:
    """Which rows stay when each move is stretched as far as every row that it skips lies within its budget (n, 2), mm and deg, of it."""
    n = len(joints)
    kept = fixed.copy()
    begin = 0
    while begin < n - 1:
        end = begin + 1
        while end + 1 < n and not fixed[end]:
            span = arc_mm[end + 1] - arc_mm[begin]
            good = span > 0.0
            stride = 1 + (end - begin) // _MERGE_PROBES
            row = end
            while good and row > begin:
                share = (arc_mm[row] - arc_mm[begin]) / span
                off = joints[begin] + share * (joints[end + 1] - joints[begin]) - joints[row]
                good = _is_near(off, per_joint[row], is_rotary, budget[row])
                row -= stride
            if not good:
                break
            end += 1
        kept[end] = True
        begin = end
    return kept


@njit(cache=True)
def _is_near(off: Floats, per_joint: Floats, is_rotary: Bools, budget: Floats) -> bool:
    """Whether joints that are off (5,) bring tip and axis within the budget: to first order, and a bound of the second."""
    tip2, axis2, turn, reach = 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        tip, axis = 0.0, 0.0
        for j in range(5):
            tip += per_joint[k, j] * off[j]
            axis += per_joint[3 + k, j] * off[j]
        tip2 += tip * tip
        axis2 += axis * axis
    for j in range(5):
        if is_rotary[j]:
            turn += np.deg2rad(abs(off[j]))
            reach += np.rad2deg(np.sqrt(per_joint[0, j] ** 2 + per_joint[1, j] ** 2 + per_joint[2, j] ** 2))
    second = 0.5 * turn * turn
    return bool(np.sqrt(tip2) + second * reach <= budget[0] and np.sqrt(axis2) + np.rad2deg(second) <= budget[1])
