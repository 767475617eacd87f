"""How far the rotary joints turn: along joints as posted, and as an inverse that looks at one point after the other would turn them."""

from __future__ import annotations

import numpy as np

from planner.kinematics.chain import Chain, Floats
from planner.kinematics.inverse import RotaryPair, rotary_angles


def rotary_travel_deg(chain: Chain, joints: Floats) -> float:
    """Sum over both rotary joints of how far they turn along (n, 5) joints, deg."""
    columns = [joint.column for joint in chain.rotary]
    return float(np.abs(np.diff(joints[:, columns], axis=0)).sum())


def pointwise_joints(chain: Chain, axes: Floats, start: Floats) -> Floats:
    """(n, 5) float: rotary joints of the branch nearest to the row before, row by row; linear columns stay as at the start.

    axes : (n, 3) float, unit vectors, table frame   start : (5,) float, joints before the first row
    Each joint goes the nearer way round; there is no looking ahead, no travel and no singular cone: what a control's own
    inverse does with one block after the other.
    """
    pair = RotaryPair.of(chain)
    columns = list(pair.columns)
    angles = rotary_angles(pair, axes).angles
    joints = np.tile(np.asarray(start, dtype=np.float64), (len(axes), 1))
    here = np.asarray(start, dtype=np.float64)[columns]
    for row, both in enumerate(angles):
        near = both + 360.0 * np.round((here - both) / 360.0)
        here = near[int(np.argmin(np.abs(near - here).sum(axis=1)))]
        joints[row, columns] = here
    return joints
