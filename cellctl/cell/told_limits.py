"""How the control accelerates by its own settings: what the follower goes by where they differ from the cell file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellctl.domain.timeline import MotionLimits

FIRST_ACCELERATION = 120  # $120 + axis, mm/s2 or deg/s2; $11: junction deviation, mm (grbl 1.1 and grblHAL settings)
JUNCTION_DEVIATION = "11"


def told_limits(settings: Mapping[str, str], letters: Sequence[str]) -> MotionLimits | None:
    """From `$$`; None if it does not tell a positive acceleration for every axis.  settings : number -> value, as text"""
    try:
        acceleration = [float(settings[str(FIRST_ACCELERATION + k)]) for k in range(len(letters))]
        deviation = float(settings[JUNCTION_DEVIATION])
    except (KeyError, ValueError):
        return None
    if not all(value > 0.0 for value in acceleration) or deviation <= 0.0:
        return None
    return MotionLimits(np.array(acceleration), deviation)
