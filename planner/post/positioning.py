"""Moves between places that no pass connects: up along the retracting axis, across, down."""

from __future__ import annotations

import numpy as np

from config.cell import Cell
from planner.errors import PostError
from planner.kinematics.chain import TOOL_AXIS, Chain, Floats
from planner.kinematics.timing import axis_limited_times
from planner.post.tape import Move, Origin, Tape

_UPRIGHT = 0.5  # least share of the retracting axis' motion that goes along the machine's z
_SAME = 1e-6  # mm or deg


class Positioner:
    """Adds positioning to a tape."""

    def __init__(self, chain: Chain, cell: Cell) -> None:
        lifts = chain.linear_directions(np.zeros((1, 5)))[0] @ TOOL_AXIS
        best = int(np.argmax(np.abs(lifts)))
        if abs(float(lifts[best])) < _UPRIGHT:
            raise PostError(
                f"cell {cell.name}: no linear axis moves the tool away from the table",
                "correct the directions of the joints",
            )
        joint = chain.linear[best]
        self._column = joint.column
        axis = cell.axis(joint.letter)
        self._way = 1.0 if lifts[best] > 0.0 else -1.0
        self._retracted = axis.max if lifts[best] > 0.0 else axis.min
        self._clearance = cell.rapid_clearance_mm
        self._max_velocity = np.array([axis.max_velocity for axis in cell.axes])
        self._all = (1 << len(cell.axes)) - 1
        self._has_retracted = False
        self._has_named_all = False

    def retract(self, tape: Tape, origin: Origin) -> None:
        """Rapid to the end of the retracting axis' travel that is away from the table; nothing if it stands there."""
        target = tape.joints.copy()
        target[self._column] = self._retracted
        if not self._has_retracted or abs(tape.joints[self._column] - self._retracted) > _SAME:
            self._rapid(tape, target, origin, named=1 << self._column if not self._has_retracted else 0)
            self._has_retracted = True

    def approach(self, tape: Tape, target: Floats, feed_mm_s: float | None, origin: Origin) -> None:
        """Retracted over the target (5,), then down to it: rapid, the last rapid_clearance_mm at the feed if one is given."""
        self.retract(tape, origin)
        over = np.array(target)
        over[self._column] = self._retracted
        self._rapid(tape, over, origin, named=0 if self._has_named_all else self._all)
        self._has_named_all = True
        if feed_mm_s is None:
            self._rapid(tape, target, origin)
            return
        above = np.array(target)
        above[self._column] += self._way * min(self._clearance, abs(self._retracted - float(target[self._column])))
        self._rapid(tape, above, origin)
        time_s = abs(float(above[self._column] - target[self._column])) / feed_mm_s
        self._add(tape, target, max(time_s, 1e-3), Move.FEED, origin, 0)

    def _rapid(self, tape: Tape, target: Floats, origin: Origin, named: int = 0) -> None:
        self._add(tape, target, 0.0, Move.RAPID, origin, named)

    def _add(self, tape: Tape, target: Floats, time_s: float, move: Move, origin: Origin, named: int) -> None:
        rows = target[None, :]
        times = axis_limited_times(rows - tape.joints, np.array([time_s]), self._max_velocity)
        tape.moves(rows, np.zeros(2), times, move, origin, named)
