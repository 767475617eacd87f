"""Passes to straight moves of the joints: as few as keep the true tip and axis within the cell's tolerances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from planner.errors import ReachError
from planner.kinematics.chain import Chain, Floats
from planner.post.arc_shape import arc_points
from planner.post.pass_curve import PassCurve
from planner.post.poses import Poses, PoseSolver, Rows
from planner.post.tube import Tube, straight_moves, tube_about

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

# How the tolerance is shared out: samples of the curve, samples of moves with rotary motion, moves; words rounded take the rest.
_SAMPLE_SHARE = 0.05
_MOTION_SHARE = 0.12
_MOVE_SHARE = 0.82
_MOVE_SHARE_TURNING = 0.74
OVER = 1.03
"""Of a move's share of the tolerance: what its measured error may be before another vertex is put in."""
_PROBES = (0.25, 0.5, 0.75)  # of a move, where its true path is compared with the pass
_MAX_HALVINGS = 26  # 2^-26 of a span of the curve: a pose that still jumps there jumps
_MAX_PINNINGS = 12
_STANDS_DEG = 1e-7  # rotary motion below it moves the tip by less than a rounding error


@dataclass(frozen=True)
class Sampled:
    """What moves are made from: samples between which the machine's straight way is the pass, and the tube about them.

    rows : tip, axis, arc length of the passes   budget : (n, 2) float, mm and deg, that moves may be off there
    tip_share_mm, axis_share_deg : what the samples themselves are off
    """

    rows: Rows
    tube: Tube
    budget: Floats
    chain: Chain
    tool_tip_mm: Floats
    tip_share_mm: float
    axis_share_deg: float


@dataclass(frozen=True)
class LinearOperation:
    """Rows that the machine goes through in straight joint moves, or in arcs.

    rows : ends of the moves, where the tip and the axis really are there   poses : of the same rows
    sampled : the passes themselves, none if these moves do not come from there
    bulge : (n,) float, of the move that leads to each row: tan(sweep / 4) of an arc of X and Y, 0: straight; none: all straight
    places : (n,) float, rows of the samples and fractions of rows where the moves end; none if unknown
    tip_mm, axis_deg : largest distance from the passes by construction, words not rounded yet
    """

    rows: Rows
    poses: Poses
    sampled: Sampled | None = field(default=None, repr=False)
    bulge: Floats | None = None
    places: Floats | None = None
    tip_mm: float = 0.0
    axis_deg: float = 0.0


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
    The true tip path between two samples (joints move linearly, the tip does not) is measured on the forward kinematics and
    halved until it and the axis are within their share of the tolerance; then few moves are laid through the tube that the
    rest of the tolerance is, and measured again at every sample. Ends of passes and places of set-points are met exactly.
    Raises ReachError where the rotary joints would have to jump, or where no pose gives the axis.
    """
    rows, poses, fixed = _sampled(curves, solver, start, tip_tolerance_mm, axis_tolerance_deg)
    per_joint = _sensitivity(solver.chain, poses.joints, solver.tool_tip_mm)
    is_rotary = np.isin(np.arange(5), solver.pair.columns)
    turns = _turns(curves, solver, rows, poses)
    tolerance = np.array([tip_tolerance_mm, axis_tolerance_deg])
    budget = np.where(turns, _MOVE_SHARE_TURNING, _MOVE_SHARE)[:, None] * tolerance
    tube = tube_about(poses.joints, rows.arc_mm, fixed, per_joint, is_rotary, budget)
    share = tolerance * ([_MOTION_SHARE, _MOTION_SHARE] if turns.any() else [_SAMPLE_SHARE, 0.0])
    sampled = Sampled(rows, tube, budget, solver.chain, solver.tool_tip_mm, float(share[0]), float(share[1]))
    place, joints, errors = _moves(sampled)
    pieces = rows_at(sampled, place, joints)
    needs = np.zeros(len(place), dtype=np.bool_)
    needs[pieces.is_first] = poses.needs_positioning[rows.is_first]
    worst = errors.max(axis=0, initial=0.0) + share
    return LinearOperation(pieces, Poses(joints, needs), sampled, None, place, float(worst[0]), float(worst[1]))


def _sampled(
    curves: Sequence[PassCurve], solver: PoseSolver, start: Floats, tip_tolerance_mm: float, axis_tolerance_deg: float
) -> tuple[Rows, Poses, Bools]:
    """Samples of the passes, near enough that the machine's straight way between them is the pass; which have to be met exactly."""
    places = [curve.place for curve in curves]
    longest_mm = 4.0 * _SAMPLE_SHARE * tip_tolerance_mm / np.deg2rad(axis_tolerance_deg)
    samples = [_first_samples(curve, tip_tolerance_mm, longest_mm) for curve in curves]
    for _ in range(_MAX_HALVINGS):
        rows = _joined(curves, samples)
        poses = solver.solve(rows, start, places)
        wide = _wide_moves(
            curves, solver, rows, poses, _MOTION_SHARE * tip_tolerance_mm, _MOTION_SHARE * axis_tolerance_deg
        )
        if wide.size == 0:
            return rows, poses, np.concatenate([sample.is_fixed for sample in samples])
        _halve(curves, samples, rows, wide)
    at = solver.pair.spin
    letter = (solver.pair.first, solver.pair.second)[at].letter
    raise ReachError(
        f"axis {letter} would have to jump within {places[int(rows.pass_[wide[0]])]}",
        "the tool axis passes a singular pose or the end of a travel: turn the part on the table (placement.rotation_deg)",
    )


def _first_samples(curve: PassCurve, tip_tolerance_mm: float, longest_mm: float) -> _Samples:
    """Samples of a pass before any pose is known.

    longest_mm : between samples of a pass whose axis may turn. A move whose end is off in its rotary joints by an angle bows by a
    quarter of that angle times its length, which samples at its ends alone would not see.
    """
    parameter, is_fixed = curve.first_parameters(_SAMPLE_SHARE * tip_tolerance_mm)
    if curve.has_constant_axis:
        return _Samples.of(curve, parameter, is_fixed)
    arcs = curve.arc_length(parameter)
    counts = np.maximum(np.ceil(np.diff(arcs) / longest_mm), 1.0).astype(np.int64)
    place = np.repeat(np.arange(len(counts)), counts)
    share = (np.arange(len(place)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[place]
    inner = share > 0.0
    more = curve.at_arc_length(arcs[place[inner]] + share[inner] * np.diff(arcs)[place[inner]])
    order = np.argsort(np.concatenate([parameter, more]), kind="stable")
    every = np.concatenate([parameter, more])[order]
    return _Samples.of(curve, every, np.concatenate([is_fixed, np.zeros(len(more), dtype=np.bool_)])[order])


def _moves(sampled: Sampled) -> tuple[Floats, Floats, Floats]:
    """Places (k,) and joints (k, 5) of the vertices, and errors (n, 2), mm and deg, at the samples.

    Rows where a move is further off than its tube (it was laid to first order) become vertices themselves, until none is.
    """
    tube = sampled.tube
    pinned = tube.pinned.copy()
    for _ in range(_MAX_PINNINGS):
        place, joints = straight_moves(tube, pinned)
        errors = move_errors(sampled, place, joints)
        over = (errors / sampled.budget).max(axis=1)
        move = np.searchsorted(place, np.arange(len(over)), side="right")
        worst = np.zeros(len(place) + 1)
        np.maximum.at(worst, move, over)
        bad = (over > OVER) & (over == worst[move]) & ~pinned
        if not bad.any():
            break
        pinned |= bad
    return place, joints, errors


def move_errors(sampled: Sampled, place: Floats, joints: Floats, bulge: Floats | None = None) -> Floats:
    """(n, 2) float, mm and deg: distance of the true tip and axis of moves from the passes, by forward kinematics, at each sample.

    place : (k,) float, rows and fractions of rows where the moves end, the first 0   joints : (k, 5) float   bulge : (k,) float, of arcs
    """
    rows = sampled.rows
    n = len(rows.arc_mm)
    if n < 2:
        return np.zeros((n, 2))
    after = np.searchsorted(place, np.arange(n), side="left")
    before = np.maximum(after - 1, 0)
    low, high = way_at(rows.arc_mm, place[before]), way_at(rows.arc_mm, place[after])
    gone = np.where(after > before, high - low, 0.0)
    share = np.divide(rows.arc_mm - low, gone, out=np.ones(n), where=gone > 0.0)
    share = np.where(place[after] == np.arange(n), 1.0, share)
    here = joints[before] + share[:, None] * (joints[after] - joints[before])
    if bulge is not None:
        bent = np.flatnonzero(bulge[after])
        xy = np.array([sampled.chain.letters.index("X"), sampled.chain.letters.index("Y")])
        ends = joints[before[bent]][:, xy], joints[after[bent]][:, xy]
        here[bent[:, None], xy] = arc_points(*ends, bulge[after[bent]], share[bent])
    return off_path(rows, *sampled.chain.forward(here, sampled.tool_tip_mm))


def off_path(rows: Rows, tip: Floats, axis: Floats) -> Floats:
    """(n, 2) float, mm and deg: tips (n, 3) and axes (n, 3) from the polyline of samples, beside the sample of the same row."""
    n = len(rows.arc_mm)
    best = np.full((n, 2), np.inf)
    here = np.arange(n)
    for other in (np.maximum(here - 1, 0), np.minimum(here + 1, n - 1)):
        other = np.where(rows.pass_[other] == rows.pass_, other, here)
        way, off = rows.tip[other] - rows.tip, tip - rows.tip
        square = np.einsum("ij,ij->i", way, way)
        along = np.einsum("ij,ij->i", off, way)
        share = np.clip(np.divide(along, square, out=np.zeros(n), where=square > 0.0), 0.0, 1.0)[:, None]
        distance = np.linalg.norm(off - share * way, axis=1)
        turned = angle_between_deg(axis, rows.axis + share * (rows.axis[other] - rows.axis))
        nearer = distance < best[:, 0]
        best[nearer] = np.column_stack([distance, turned])[nearer]
    return best


def way_at(way_mm: Floats, place: Floats) -> Floats:
    """(k,) mm: arc lengths at places, rows and fractions of rows."""
    return np.asarray(np.interp(place, np.arange(len(way_mm)), way_mm))


def rows_at(sampled: Sampled, place: Floats, joints: Floats) -> Rows:
    """Rows at places of the samples, with the tips and axes that the joints give."""
    rows = sampled.rows
    tip, axis = sampled.chain.forward(joints, sampled.tool_tip_mm)
    at = np.floor(place).astype(np.int64)
    parameter = way_at(rows.parameter, place)
    return Rows(tip, axis, way_at(rows.arc_mm, place), parameter, rows.pass_[at], rows.is_rapid[at])


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
