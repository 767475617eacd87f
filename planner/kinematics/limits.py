"""Travel of the axes: what lies outside, and the one line that says so."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from config.cell import Axis
from planner.errors import TravelLimitError
from planner.kinematics.chain import Floats

_ROUNDING = 1e-6  # mm or deg: what rounding of a pose that stands on a limit may add


def travel(axes: Sequence[Axis]) -> tuple[Floats, Floats]:
    """Least and greatest machine coordinate of each axis: two (5,) float, mm or deg."""
    return np.array([axis.min for axis in axes]), np.array([axis.max for axis in axes])


def excess(axes: Sequence[Axis], joints: Floats) -> Floats:
    """(n, 5) float, mm or deg: how far each joint is outside its travel, 0 inside."""
    low, high = travel(axes)
    return np.asarray(np.maximum(np.maximum(low - joints, joints - high) - _ROUNDING, 0.0))


def check_travel(axes: Sequence[Axis], joints: Floats, place: Sequence[str] | str, hint: str = "") -> None:
    """Raise TravelLimitError for the worst of joints (n, 5) that leaves its axis' travel.

    place : where each row is, or one text for all; it ends the message.
    """
    over = excess(axes, joints)
    if not over.any():
        return
    row, column = np.unravel_index(int(np.argmax(over)), over.shape)
    axis = axes[int(column)]
    unit = "mm" if axis.kind == "linear" else "deg"
    asked = float(joints[row, column])
    limit = axis.max if asked > axis.max else axis.min
    where = place if isinstance(place, str) else place[int(row)]
    raise TravelLimitError(
        f"axis {axis.letter}: {asked:.3f} {unit} asked, limit {limit:g} {unit}, {where}",
        hint or "move the part (placement.part_origin_mm, rotation_deg), or take a shorter tool or a larger machine",
    )
