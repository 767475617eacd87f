"""Machine poses along an operation: branch, turn and singular pose chosen for the whole of it, so that joints run continuously."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell
from planner.errors import ReachError
from planner.kinematics.chain import Chain, Floats
from planner.kinematics.free_spin import filled
from planner.kinematics.inverse import RotaryPair, linear_joints, rotary_angles, tilt_for_spin
from planner.kinematics.limits import excess, travel
from planner.kinematics.shortest import OUTSIDE_S, Lattice, shortest_way

Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

CONE_SHARE = 0.25
"""Of the axis tolerance: half angle of the cone about the spin joint in which its angle is kept rather than followed."""
SAME_POSE = 1e-3
"""mm or deg: joints nearer than this are one pose; passes that meet so follow each other without positioning."""
_ELSEWHERE = (
    1e-9  # weight of the way outside rapid links, when a spin angle has to change where the tool axis leaves it free
)


_WINDING_SLACK_DEG = 1e-3


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
        self._low, self._high = (side[self._columns] for side in travel(cell.axes))
        self._speed = np.array([cell.axes[column].max_velocity for column in self._columns])
        self.cone_rad = float(np.deg2rad(CONE_SHARE * cell.axis_tolerance_deg))
        self._spin_deg: float | None = None
        self._branch: int | None = None

    def with_spin(self, spin_deg: float) -> PoseSolver:
        """The same with the spin joint at an angle, deg, where the axis leaves it free all along: the part turned about the tool."""
        other = copy(self)
        other._spin_deg = spin_deg
        return other

    def with_branch(self, branch: int) -> PoseSolver:
        """The same with one of both branches (0, 1) only."""
        other = copy(self)
        other._branch = branch
        return other

    def solve(self, rows: Rows, start: Floats, places: Sequence[str]) -> Poses:
        """Poses of all rows, beginning as near as possible to the joints (5,) where the machine stands.

        places : one text per pass, for messages
        Raises ReachError where no pose gives the axis, where the linear axes do not span space, or where a joint would wind
        out of its travel within passes that follow each other on the part. Other travel is not checked here.
        """
        found = rotary_angles(self.pair, rows.axis, self.cone_rad)
        if not found.is_reachable.all():
            row = int(np.argmin(found.is_reachable))
            direction = ", ".join(f"{value:.3f}" for value in rows.axis[row])
            raise ReachError(
                f"{self.pair.first.letter} and {self.pair.second.letter} cannot bring the tool axis to ({direction}) of the table, "
                f"{places[int(rows.pass_[row])]}",
                "turn the part on the table or choose another build direction",
            )
        stood = start[self._columns]
        if self._spin_deg is not None and found.is_free.all():
            stood = np.where(np.arange(2) == self.pair.spin, self._spin_deg, stood)
        rotary = self._continuous(rows, found.angles, ~found.is_free, stood)
        self._check_winding(rows, rotary, places)
        joints = np.zeros((len(rows.tip), 5))
        joints[:, self._columns] = rotary
        joints = linear_joints(self.chain, joints, rows.tip, self.tool_tip_mm)
        if not np.isfinite(joints).all():
            row = int(np.argmin(np.isfinite(joints).all(axis=1)))
            raise ReachError(
                f"{self._pose(rotary[row])}: the linear axes do not span space there, {places[int(rows.pass_[row])]}",
                "turn the part on the table or choose another build direction",
            )
        step = np.abs(np.diff(np.vstack([start, joints]), axis=0)).max(axis=1)
        return Poses(joints, rows.is_first & (step > SAME_POSE))

    def _continuous(self, rows: Rows, angles: Floats, is_known: Bools, start: Floats) -> Floats:
        """(n, 2) deg: branches and turns by the cheapest way; the spin interpolated where it is free, the tilt fitted to it there."""
        known = np.flatnonzero(is_known)
        values = np.zeros((len(angles), 2))
        pieces = np.flatnonzero(self._starts_piece(rows))
        piece = np.searchsorted(pieces, known, side="right")
        lattice = Lattice.of_branches(
            angles[known], self._cost(rows, angles, known), np.append(True, np.diff(piece) > 0)[: len(known)]
        )
        way = shortest_way(lattice, start, self._low, self._high, self._speed)
        values[known] = way.angles
        if known.size == len(angles):
            return values
        wound = self._without_unwinding(values[known])
        values[known] = wound
        self._fill_free(rows, values, is_known, start)
        unwound = way.angles - wound  # whole turns, from the beginning of a piece on
        shift = np.vstack([np.zeros(2), np.diff(unwound, axis=0)]) if known.size else np.zeros((0, 2))
        for row in np.flatnonzero(np.abs(shift).max(axis=1, initial=0.0) > 180.0):
            values[pieces[piece[row] - 1] :] += shift[row]
        return values

    @staticmethod
    def _without_unwinding(angles: Floats) -> Floats:
        """(n, 2) deg: the same angles from the first on, each less than half a turn from the one before."""
        steps = np.diff(angles, axis=0)
        return np.asarray(np.vstack([angles[:1], angles[:1] + np.cumsum(steps - 360.0 * np.round(steps / 360.0), axis=0)]))

    def _fill_free(self, rows: Rows, values: Floats, is_known: Bools, start: Floats) -> None:
        """Put in angles where the axis leaves the spin free: led over, mostly in rapid links, from the known ones beside."""
        known = np.flatnonzero(is_known)
        step = np.append(0.0, np.linalg.norm(np.diff(rows.tip, axis=0), axis=1))
        leading = slice(0, int(known[0]) + 1) if known.size else slice(0, 0)
        turns_on_the_way = bool(np.any(rows.is_rapid[leading] & (step[leading] > 0.0)))
        way = np.cumsum(step * np.where(rows.is_rapid, 1.0, _ELSEWHERE))
        spin, tilt = self.pair.spin, 1 - self.pair.spin
        is_near = known.size == 0 or (turns_on_the_way and bool(np.all(np.abs(start - values[known[0]]) <= 180.0)))
        begin = start if is_near else values[known[0]]
        for joint in (spin, tilt):
            values[:, joint] = filled(values[:, joint], is_known, way, float(begin[joint]))
        free = np.flatnonzero(~is_known)
        fitted = tilt_for_spin(self.pair, rows.axis[free], values[free, spin])
        values[free, tilt] = fitted + 360.0 * np.round((values[free, tilt] - fitted) / 360.0)

    def _cost(self, rows: Rows, angles: Floats, known: Ints) -> Floats:
        """(k, 2) s: of each branch of the known rows, OUTSIDE_S where a linear axis would leave its travel."""
        cost = np.zeros((len(known), 2))
        for branch in range(2):
            joints = np.zeros((len(known), 5))
            joints[:, self._columns] = angles[known, branch]
            over = excess(self.cell.axes, linear_joints(self.chain, joints, rows.tip[known], self.tool_tip_mm))
            over[:, self._columns] = 0.0
            cost[over.any(axis=1), branch] = OUTSIDE_S
        if self._branch is not None:
            cost[:, 1 - self._branch] = np.inf
        return cost

    def _starts_piece(self, rows: Rows) -> Bools:
        """(n,) bool: first rows of passes beside a rapid link, where the tool is off the part: whole turns may change there."""
        first = rows.is_first
        beside = rows.is_rapid | np.append(True, rows.is_rapid[:-1])
        return np.asarray(first & (beside | (np.arange(len(first)) == 0)))

    def _check_winding(self, rows: Rows, rotary: Floats, places: Sequence[str]) -> None:
        """Raise ReachError for passes on the part, without a rapid link between, that wind a joint through more than its travel."""
        starts = np.flatnonzero(self._starts_piece(rows))
        for joint, letter in enumerate((self.pair.first.letter, self.pair.second.letter)):
            low, high = float(self._low[joint]), float(self._high[joint])
            least = np.minimum.reduceat(rotary[:, joint], starts)
            most = np.maximum.reduceat(rotary[:, joint], starts)
            wound = np.where(high - low >= 360.0, most - least, 0.0)
            worst = int(np.argmax(wound))
            if wound[worst] > high - low + _WINDING_SLACK_DEG:
                raise ReachError(
                    f"axis {letter} would wind by {wound[worst]:.1f} deg, its travel holds {high - low:g} deg, "
                    f"{places[int(rows.pass_[starts[worst]])]}",
                    "unwinding is done off the part only: divide the pass, or plan it as rings that a rapid link parts",
                )

    def _pose(self, rotary: Floats) -> str:
        first, second = self.pair.first.letter, self.pair.second.letter
        return f"{first} {rotary[0]:.2f} deg, {second} {rotary[1]:.2f} deg"
