"""Set-ups: pieces that follow each other with one direction up, and how the part is turned for them, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from planner.plan import Setup

Floats = NDArray[np.float64]

_SAME_DEG = 0.5  # directions nearer than this are one
_UP = np.array([0.0, 0.0, 1.0])
_AXES = {"X": np.array([1.0, 0.0, 0.0]), "Y": np.array([0.0, 1.0, 0.0])}


def setups_of(directions: Sequence[Floats]) -> tuple[tuple[Setup, ...], list[int]]:
    """The set-ups of pieces in order, and the number of each piece's.  directions : (3,) float, unit, build frame."""
    found: list[Setup] = []
    number: list[int] = []
    for piece, direction in enumerate(directions):
        if found and angle_deg(found[-1].direction, direction) <= _SAME_DEG:
            last = found[-1]
            found[-1] = Setup(last.direction, last.turn, (*last.subcomponents, piece))
        else:
            found.append(Setup(np.asarray(direction, dtype=np.float64), turn_in_words(direction), (piece,)))
        number.append(len(found) - 1)
    return tuple(found), number


def turn_in_words(direction: Floats) -> str:
    """How a part that stood with z up is turned so that a direction points up: "as clamped", "90° about X" or an axis."""
    angle = angle_deg(_UP, direction)
    if angle <= _SAME_DEG:
        return "as clamped"
    axis = np.cross(direction, _UP)
    length = float(np.linalg.norm(axis))
    if length < np.sin(np.radians(_SAME_DEG)):
        return "180° about Y"
    axis /= length
    for name, unit in _AXES.items():
        along = float(axis @ unit)
        if abs(along) > np.cos(np.radians(_SAME_DEG)):
            return f"{np.copysign(round(angle), along):.0f}° about {name}"
    x, y, z = np.round(axis, 2) + 0.0
    return f"{angle:.0f}° about ({x:g}, {y:g}, {z:g})"


def angle_deg(first: Floats, second: Floats) -> float:
    """Angle between two unit vectors."""
    return float(np.degrees(2.0 * np.arcsin(min(1.0, 0.5 * float(np.linalg.norm(first - second))))))
