"""Rotary joints where the tool axis leaves one of them free: led over from what is known beside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.kinematics.chain import Floats

Bools = NDArray[np.bool_]


def filled(values: Floats, is_known: Bools, way: Floats, start: float) -> Floats:
    """(n,) float: values where known; between two known ones linear over `way` (n,), not decreasing; before the first one from `start`.

    Where `way` does not grow before the first known row, that row's value holds; behind the last known row its value holds.
    With no known row everything stays at start.
    """
    known = np.flatnonzero(is_known)
    if known.size == 0:
        return np.full(len(values), start)
    places, levels = way[known], values[known]
    if known[0] > 0 and way[known[0]] > way[0]:
        places, levels = np.append(way[0], places), np.append(start, levels)
    result = np.interp(way, places, levels)
    result[known] = values[known]
    return np.asarray(result)
