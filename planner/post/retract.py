"""The linear axis that takes the tool away from the table, and the end of its travel there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from config.cell import Cell
from planner.errors import PostError
from planner.kinematics.chain import TOOL_AXIS, Chain

_UPRIGHT = 0.5  # least share of the retracting axis' motion that goes along the machine's z


@dataclass(frozen=True)
class Retract:
    """Which linear axis takes the tool away from the table, to where.  way : +1 or -1"""

    column: int
    end: float
    way: float

    @classmethod
    def of(cls, chain: Chain, cell: Cell) -> Retract:
        """Raises PostError if no linear axis moves the tool away from the table."""
        lifts = chain.linear_directions(np.zeros((1, 5)))[0] @ TOOL_AXIS
        best = int(np.argmax(np.abs(lifts)))
        if abs(float(lifts[best])) < _UPRIGHT:
            raise PostError(
                f"cell {cell.name}: no linear axis moves the tool away from the table",
                "correct the directions of the joints",
            )
        joint = chain.linear[best]
        axis = cell.axis(joint.letter)
        up = float(lifts[best]) > 0.0
        return cls(joint.column, axis.max if up else axis.min, 1.0 if up else -1.0)
