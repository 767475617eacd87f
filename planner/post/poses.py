"""Machine poses along an operation: branch, turn and singular pose chosen for the whole of it, so that joints run continuously."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell
from planner.errors import ReachError
from planner.kinematics.branches import filled, shortest_branches, turn_shift, unwrapped
from planner.kinematics.chain import Chain, Floats
from planner.kinematics.inverse import RotaryPair, linear_joints, rotary_angles, tilt_for_spin
from planner.kinematics.limits import excess, travel

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

CONE_SHARE = 0.25
"""Of the axis tolerance: half angle of the cone about the spin joint in which its angle is kept rather than followed."""
SAME_POSE = 1e-3
"""mm or deg: joints nearer than this are one pose; passes that meet so follow each other without positioning."""
_ELSEWHERE = (
    1e-9  # weight of the way outside rapid links, when a spin angle has to change where the tool axis leaves it free
)


@dataclass(frozen=True)
class Rows:
    """Samples of all passes of an operation, one after the other.

    tip, axis : (n, 3) float, table frame   arc_mm, parameter : (n,) float   pass_ : (n,) int
    is_rapid : (n,) bool, the row's pass is a rapid link
    """

    tip: Floats
    axis: Floats
    arc_mm: Floats
    parameter: Floats
    pass_: Ints
    is_rapid: Bools

    @property
    def is_first(self) -> Bools:
        """(n,) bool: the first row of a pass."""
        return np.append(True, np.diff(self.pass_) != 0)


@dataclass(frozen=True)
class Poses:
    """joints : (n, 5) float   needs_positioning : (n,) bool, first rows of passes that do not start at the pose before"""

    joints: Floats
    needs_positioning: Bools


class PoseSolver:
    """Poses for one tool of one cell."""

    def __init__(self, chain: Chain, cell: Cell, tool_tip_mm: Floats) -> None:
        self.chain = chain
        self.cell = cell
        self.tool_tip_mm = tool_tip_mm
        self.pair = RotaryPair.of(chain)
        self._columns = list(self.pair.columns)
        self._low, self._high = travel(cell.axes)
        self._cone_rad = float(np.deg2rad(CONE_SHARE * cell.axis_tolerance_deg))

    def solve(self, rows: Rows, start: Floats, places: Sequence[str]) -> Poses:
        """Poses of all rows, beginning as near as possible to the joints (5,) where the machine stands.

        places : one text per pass, for messages. Raises ReachError where no pose gives the axis. Travel is not checked here.
        """
        found = rotary_angles(self.pair, rows.axis, self._cone_rad)
        if not found.is_reachable.all():
            row = int(np.argmin(found.is_reachable))
            direction = ", ".join(f"{value:.3f}" for value in rows.axis[row])
            raise ReachError(
                f"{self.pair.first.letter} and {self.pair.second.letter} cannot bring the tool axis to ({direction}) of the table, "
                f"{places[int(rows.pass_[row])]}",
                "turn the part on the table or choose another build direction",
            )
        rotary = self._continuous(rows, found.angles, ~found.is_free, start[self._columns])
        rotary = self._within_travel(rows, rotary)
        joints = np.zeros((len(rows.tip), 5))
        joints[:, self._columns] = rotary
        joints = linear_joints(self.chain, joints, rows.tip, self.tool_tip_mm)
        step = np.abs(np.diff(np.vstack([start, joints]), axis=0)).max(axis=1)
        return Poses(joints, rows.is_first & (step > SAME_POSE))

    def _continuous(self, rows: Rows, angles: Floats, is_known: Bools, start: Floats) -> Floats:
        """(n, 2) deg: branch by shortest way, unwrapped; the spin interpolated where it is free, the tilt fitted to it there."""
        known = np.flatnonzero(is_known)
        branch = shortest_branches(angles[known], self._is_allowed(rows, angles, known), start)
        values = np.zeros((len(angles), 2))
        values[known] = unwrapped(angles[known, branch], start) if known.size else 0.0
        if known.size == len(angles):
            return values
        step = np.append(0.0, np.linalg.norm(np.diff(rows.tip, axis=0), axis=1))
        leading = slice(0, int(known[0]) + 1) if known.size else slice(0, 0)
        turns_on_the_way = bool(np.any(rows.is_rapid[leading] & (step[leading] > 0.0)))
        way = np.cumsum(step * np.where(rows.is_rapid, 1.0, _ELSEWHERE))
        spin, tilt = self.pair.spin, 1 - self.pair.spin
        begin = start if turns_on_the_way or known.size == 0 else values[known[0]]
        for joint in (spin, tilt):
            values[:, joint] = filled(values[:, joint], is_known, way, float(begin[joint]))
        free = np.flatnonzero(~is_known)
        fitted = tilt_for_spin(self.pair, rows.axis[free], values[free, spin])
        values[free, tilt] = fitted + 360.0 * np.round((values[free, tilt] - fitted) / 360.0)
        return values

    def _is_allowed(self, rows: Rows, angles: Floats, known: Ints) -> Bools:
        """(k, 2) bool: whether each branch of the known rows is inside the travel, the rotary joints on some turn."""
        allowed = np.ones((len(known), 2), dtype=np.bool_)
        low, high = self._low[self._columns] - 1e-6, self._high[self._columns] + 1e-6
        for branch in range(2):
            here = angles[known, branch]
            turn_fits = np.ceil((low - here) / 360.0) <= np.floor((high - here) / 360.0)
            joints = np.zeros((len(known), 5))
            joints[:, self._columns] = here
            joints = linear_joints(self.chain, joints, rows.tip[known], self.tool_tip_mm)
            over = excess(self.cell.axes, joints)
            over[:, self._columns] = 0.0
            allowed[:, branch] = turn_fits.all(axis=1) & ~over.any(axis=1)
        return allowed

    def _within_travel(self, rows: Rows, rotary: Floats) -> Floats:
        """(n, 2) deg: the same angles on other turns where one would wind out of the travel; turns change beside rapid links only."""
        first = np.flatnonzero(rows.is_first)
        beside_rapid = rows.is_rapid[first] | rows.is_rapid[first - 1]
        starts = first[beside_rapid | (first == 0)]
        result = rotary.copy()
        for joint, column in enumerate(self._columns):
            low, high = float(self._low[column]), float(self._high[column])
            least = np.minimum.reduceat(rotary[:, joint], starts)
            most = np.maximum.reduceat(rotary[:, joint], starts)
            shifts = _piece_shifts(least, most, low, high)
            result[:, joint] += np.repeat(shifts, np.diff(np.append(starts, len(rotary))))
        return result


def _piece_shifts(least: Floats, most: Floats, low: float, high: float) -> Floats:
    """(k,) deg, whole turns: shift of each piece, as few different ones in sequence as the travel allows."""
    shifts = np.zeros(len(least))
    begin, current = 0, 0.0
    while begin < len(least):
        end, best = begin, None
        bottom, top = np.inf, -np.inf
        while end < len(least):
            bottom, top = min(bottom, float(least[end])), max(top, float(most[end]))
            shift = turn_shift(np.array([bottom + current, top + current]), low, high)
            if shift is None:
                break
            best = shift
            end += 1
        end = max(end, begin + 1)
        current += best or 0.0
        shifts[begin:end] = current
        begin = end
    return shifts
