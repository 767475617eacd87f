"""Inverse kinematics in closed form: both rotary branches of a tool axis, and the linear joints that put the tip in place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.errors import PostError
from planner.kinematics.chain import TOOL_AXIS, Chain, ChainJoint, Floats, rotated

Bools = NDArray[np.bool_]

EXACT_CONE_RAD = 1e-7
"""Half angle of the singular cone for exact work: below it the direction of a unit vector in doubles says nothing about the turn."""
_REACH_SLACK = 1e-12  # of the squared third coordinate; rounding at the edge of what two tilted rotaries reach
_SPANS = 1e-9  # of the determinant of the linear joints' directions: below it they do not span space


@dataclass(frozen=True)
class RotaryPair:
    """exp(first alpha) exp(second beta) p = q, with the required axis standing for p or for q.

    Which joint turns freely when the tool axis is parallel to it is the `spin`; the other one is the `tilt`.
    sense : (2,) float, joint angle = sense * (alpha, beta)
    """

    first: ChainJoint
    second: ChainJoint
    sense: tuple[float, float]
    axis_is_p: bool

    @classmethod
    def of(cls, chain: Chain) -> RotaryPair:
        """The pair of a chain of table-table, head-head or head-table type. Raises PostError if the spin is degenerate."""
        first, second = chain.rotary
        both_table = second in chain.table
        mixed = first in chain.table and not both_table
        pair = cls(first, second, (-1.0 if mixed else 1.0, 1.0), both_table)
        fixed = first if both_table else second
        if float(np.linalg.norm(np.cross(fixed.direction, TOOL_AXIS))) < 1e-6:
            raise PostError(
                f"rotary joint {fixed.letter} only turns the tool about itself", "correct the joint's direction"
            )
        return pair

    @property
    def spin(self) -> int:
        """0 or 1: which of (first, second) is free at the singular pose."""
        return 1 if self.axis_is_p else 0

    @property
    def columns(self) -> tuple[int, int]:
        """Columns of (first, second) in joint arrays."""
        return self.first.column, self.second.column

    def sides(self, axis: Floats) -> tuple[Floats, Floats]:
        """p and q, each (n, 3)."""
        still = np.broadcast_to(TOOL_AXIS, axis.shape)
        return (axis, still) if self.axis_is_p else (still, axis)


@dataclass(frozen=True)
class RotaryAngles:
    """Both solutions.

    angles : (n, 2, 2) float, deg in (-180, 180]: row, branch, (first, second)
    is_free : (n,) bool, the axis is parallel to the spin joint within the cone: its angle there is of no meaning
    is_reachable : (n,) bool
    """

    angles: Floats
    is_free: Bools
    is_reachable: Bools


def rotary_angles(pair: RotaryPair, axis: Floats, cone_rad: float = EXACT_CONE_RAD) -> RotaryAngles:
    """Angles of the two rotary joints that give the tool axis (n, 3), unit vectors of the table frame.

    The spin joint comes first, from the level along the tilt joint, which that one keeps; the tilt follows by subproblem 1. So
    the digits hold at the pole and where both branches meet, where the usual root of a small difference loses half of them.
    Source: Paden-Kahan subproblems 1 and 2, Murray, Li & Sastry 3.3.2, for axes at any angle to each other.
    """
    p, q = pair.sides(axis)
    carried, still = (p, q) if pair.spin == 1 else (q, p)
    spin, tilt = (pair.first, pair.second)[pair.spin].direction, (pair.first, pair.second)[1 - pair.spin].direction
    along = float(spin @ tilt) * (carried @ spin)
    level = still @ tilt - along  # what the tilt joint cannot change: spinning has to bring the carried vector there
    cosine, sine = carried @ tilt - along, np.cross(spin, carried) @ tilt
    rest = cosine**2 + sine**2 - level**2
    middle = np.arctan2(sine, cosine)
    half = np.arctan2(np.sqrt(np.maximum(rest, 0.0)), level)
    angles = np.empty((len(axis), 2, 2))
    for branch, turn in enumerate((middle - half, middle + half) if pair.spin == 1 else (middle + half, middle - half)):
        spun = rotated(carried, spin, np.rad2deg(turn))
        by_tilt = angle_about(tilt, spun, still) if pair.spin == 1 else angle_about(tilt, still, spun)
        by_spin = np.rad2deg(turn if pair.spin == 1 else -turn)
        angles[:, branch, pair.spin] = pair.sense[pair.spin] * by_spin
        angles[:, branch, 1 - pair.spin] = pair.sense[1 - pair.spin] * by_tilt
    angles -= 360.0 * np.ceil((angles - 180.0) / 360.0)
    off_axis = np.linalg.norm(np.cross(axis, spin), axis=1)
    return RotaryAngles(angles, off_axis < np.sin(cone_rad), rest > -_REACH_SLACK)


def tilt_for_spin(pair: RotaryPair, axis: Floats, spin_deg: Floats) -> Floats:
    """(n,) deg in (-180, 180]: the tilt joint's angle that brings the tool nearest to the axis when the spin joint stands at spin_deg."""
    p, q = pair.sides(axis)
    w1, w2 = pair.first.direction, pair.second.direction
    if pair.spin == 1:
        return pair.sense[0] * angle_about(w1, rotated(p, w2, pair.sense[1] * spin_deg), q)
    return pair.sense[1] * angle_about(w2, p, rotated(q, w1, -pair.sense[0] * spin_deg))


def linear_joints(chain: Chain, joints: Floats, tip: Floats, tool_tip_mm: Floats) -> Floats:
    """Joints with the rotary columns as given and the linear ones solved so that the tip (n, 3), table frame, is met exactly.

    joints : (n, 5) float, linear columns of no meaning. Returns (n, 5) float; NaN in the linear columns of rows where the
    rotary joints bring the linear ones into one plane.
    """
    solved = np.array(joints, dtype=np.float64)
    columns = [joint.column for joint in chain.linear]
    solved[:, columns] = 0.0
    gap = chain.carried_by_table(solved, tip) - chain.carried_by_head(solved, tool_tip_mm)
    ways = chain.linear_directions(solved)
    flat = np.abs(np.linalg.det(ways)) < _SPANS
    ways[flat] = np.eye(3)
    gap[flat] = np.nan
    solved[:, columns] = np.linalg.solve(ways.transpose(0, 2, 1), gap[:, :, None])[:, :, 0]
    return solved


def both_branches(
    chain: Chain, tip: Floats, axis: Floats, tool_tip_mm: Floats, cone_rad: float = EXACT_CONE_RAD
) -> tuple[Floats, RotaryAngles]:
    """Both poses for each tip and axis: (n, 2, 5) float joints (rotary angles in (-180, 180]) and the angles with their flags."""
    pair = RotaryPair.of(chain)
    found = rotary_angles(pair, axis, cone_rad)
    joints = np.zeros((len(tip), 2, 5))
    joints[:, :, pair.columns[0]] = found.angles[:, :, 0]
    joints[:, :, pair.columns[1]] = found.angles[:, :, 1]
    for branch in range(2):
        joints[:, branch] = linear_joints(chain, joints[:, branch], tip, tool_tip_mm)
    return joints, found


def angle_about(direction: Floats, source: Floats, target: Floats) -> Floats:
    """(n,) deg in (-180, 180]: turn about a unit direction that brings source (n, 3) nearest to target (n, 3).

    Source: Paden-Kahan subproblem 1.
    """
    source = source - (source @ direction)[:, None] * direction
    target = target - (target @ direction)[:, None] * direction
    sine = np.cross(source, target) @ direction
    cosine = np.einsum("ij,ij->i", source, target)
    return np.asarray(np.rad2deg(np.arctan2(sine, cosine)), dtype=np.float64)
