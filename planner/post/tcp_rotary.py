"""Rotary positions for blocks that say them beside the tip: those of the tool axis where the block ends, on the tape's branch and turn."""

from __future__ import annotations

import numpy as np

from planner.kinematics.chain import Chain, Floats
from planner.kinematics.inverse import RotaryPair, rotary_angles

_NEAR_DEG = 1.0  # farther from the tape's own position than this it would be another way round
_FREE_DEG = 0.5  # about the pole the axis hardly says where the spin stands


def turned_to(chain: Chain, axes: Floats, joints: Floats) -> Floats:
    """(n, 5) joints (n, 5) with their rotary positions made exact for the axes (n, 3), table frame; as given where the spin is free.

    Along the pass the tape's moves may be ahead of it by the tolerance; the tip of a block in workpiece coordinates is not.
    """
    pair = RotaryPair.of(chain)
    columns = list(pair.columns)
    found = rotary_angles(pair, axes, float(np.deg2rad(_FREE_DEG)))
    near = found.angles + 360.0 * np.round((joints[:, None, columns] - found.angles) / 360.0)
    apart = np.abs(near - joints[:, None, columns]).max(axis=2)
    branch = np.argmin(apart, axis=1)
    every = np.arange(len(axes))
    is_near = (apart[every, branch] < _NEAR_DEG) & found.is_reachable & ~found.is_free
    exact = joints.copy()
    exact[np.ix_(is_near, columns)] = near[every, branch][is_near]
    return exact
