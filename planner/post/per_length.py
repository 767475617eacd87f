"""Laser energy and powder per length of what was written, against the Plan: a check of its own that knows nothing of how levels are chosen."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from config.cell import Cell
from planner.kinematics.chain import Floats

Bools = NDArray[np.bool_]

OFF = 0.06
"""Relative: 5 % and what rounding of levels and times adds."""
_WRITES = 1.5  # of the laser's link: what the planned power gives in this time may be off in any stretch, besides
_POWDER_FOLLOWS = 4.0  # times that powder takes to the nozzle and to settle: likewise for powder, whose levels lead


def power_slack_s(cell: Cell) -> float:
    """s of planned power that a stretch may have too much or too little: shorter ones no write over the link can follow."""
    return _WRITES * cell.response.laser_write_s


def powder_slack_s(cell: Cell) -> float:
    """s of planned powder, likewise: what it takes to the nozzle, and in steps back to the planned rate."""
    return _POWDER_FOLLOWS * (cell.response.powder_delay_s + 2.0 * cell.response.powder_settle_s)


def is_off(level: Floats, planned: Floats, share: Floats, time_s: Floats, floor: float, slack_s: float) -> Bools:
    """(n,) bool: moves at whose end some stretch has OFF too much or too little per length.

    level, planned : (n,) what is set on each move of a pass and what the plan has there   share : (n,) actual over planned speed
    time_s : (n,)   floor : least level that the process takes (planned ones below it stand)
    The amount over any stretch has to be the planned per length times its length, within OFF, and slack_s of the greatest planned level.
    """
    wanted = np.maximum(planned * np.minimum(share, 1.0), np.minimum(planned, floor)) * time_s
    given = level * time_s
    slack = slack_s * float(planned.max(initial=0.0))
    return _grows(given - (1.0 + OFF) * wanted, slack) | _grows((1.0 - OFF) * wanted - given, slack)


@njit(cache=True)
def _grows(step: Floats, slack: float) -> Bools:
    """(n,) bool: whether the sum over some stretch that ends here is above the slack."""
    found = np.zeros(len(step), dtype=np.bool_)
    most = 0.0  # of the sums over stretches that end before here; an empty one is nought
    for i in range(len(step)):
        most = max(most, 0.0) + step[i]
        found[i] = most > slack + 1e-9
    return found
