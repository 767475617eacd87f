"""How far the rotary joints turn: along joints as posted, and as an inverse that looks at one point after the other would turn them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.kinematics.chain import Chain, Floats
from planner.kinematics.inverse import RotaryPair, rotary_angles, tilt_for_spin

Bools = NDArray[np.bool_]

_STEP_DEG = 5.0


def rotary_travel_deg(chain: Chain, joints: Floats) -> float:
    """Sum over both rotary joints of how far they turn along (n, 5) joints, deg."""
    columns = [joint.column for joint in chain.rotary]
    return float(np.abs(np.diff(joints[:, columns], axis=0)).sum())


def followed_axes(chain: Chain, joints: Floats, is_followed: Bools, step_deg: float = _STEP_DEG) -> Floats:
    """(m, 3) float, unit vectors, table frame: the tool axes that straight joint moves (n, 5) have to give.

    is_followed : (n - 1,) bool, moves whose way matters: rotary joints by a step at a time at most, since one move may turn the tool
    by more than half a turn; of the others, links through the air, the ends beside followed ones alone, and where all ends
    """
    columns = [joint.column for joint in chain.rotary]
    turn = np.abs(np.diff(joints[:, columns], axis=0)).max(axis=1)
    pieces = np.where(is_followed, np.maximum(np.ceil(turn / step_deg), 1.0), 0.0).astype(np.int64)
    pieces[:-1] += is_followed[1:] & ~is_followed[:-1]  # where a link ends
    pieces[-1:] = np.maximum(pieces[-1:], 1)
    move = np.repeat(np.arange(len(pieces)), pieces)
    share = (np.arange(len(move)) - np.repeat(np.cumsum(pieces) - pieces, pieces) + 1.0) / pieces[move]
    between = joints[move] + share[:, None] * (joints[move + 1] - joints[move])
    return chain.forward(np.vstack([joints[:1], between]), np.zeros(3))[1]


def pointwise_joints(chain: Chain, axes: Floats, start: Floats) -> Floats:
    """(n, 5) float: rotary joints of the branch nearest to the row before, row by row; linear columns stay as at the start.

    axes : (n, 3) float, unit vectors, table frame   start : (5,) float, joints before the first row
    Each joint goes the nearer way round, and the spin joint stands where the axis leaves it free; there is no looking ahead, no
    travel and no singular cone: what a control's own inverse does with one block after the other.
    """
    pair = RotaryPair.of(chain)
    columns, spin = list(pair.columns), pair.spin
    found = rotary_angles(pair, axes)
    joints = np.tile(np.asarray(start, dtype=np.float64), (len(axes), 1))
    here = np.asarray(start, dtype=np.float64)[columns]
    for row, both in enumerate(found.angles):
        if found.is_free[row]:
            both = np.tile(here, (2, 1))
            both[:, 1 - spin] = tilt_for_spin(pair, axes[row : row + 1], here[spin : spin + 1])
        near = both + 360.0 * np.round((here - both) / 360.0)
        here = near[int(np.argmin(np.abs(near - here).sum(axis=1)))]
        joints[row, columns] = here
    return joints
