"""What a tool may hit at a step of a Program: the machine, the plate with its clamps, and the part as it stands."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell
from planner.kinematics.chain import Chain
from planner.plan import Operation, Plan

Floats = NDArray[np.float64]


class Guard:
    """The cell with the part as it stands; grows operation by operation.

    placed : (4, 4) float, table from build
    """

    def __init__(self, plan: Plan, cell: Cell, chain: Chain, placed: Floats) -> None:
        self.plan, self.cell, self.chain, self.placed = plan, cell, chain, placed

    def advance(self, operation: Operation) -> None:
        """Take in what an operation of the plan has added or cut."""
