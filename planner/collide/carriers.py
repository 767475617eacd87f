"""What moves the bodies of a cell: a rigid motion for each link of both chains and for the slide of the deposition head."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from planner.kinematics.chain import Chain

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BASE = 0
SLIDE = -2
"""In `Motion.column`: the head's slide; -1: nothing."""


class Motion(NamedTuple):
    """Carriers in order, each after its parent.

    parent : (c,)   column : (c,) of the joints' array, SLIDE or -1   is_rotary : (c,) 0 or 1
    direction : (c, 3) of the joint, of the slide its way to where it is parked   point : (c, 3) mm, on a rotary joint's axis
    """

    parent: Ints
    column: Ints
    is_rotary: Ints
    direction: Floats
    point: Floats


@dataclass(frozen=True)
class Carriers:
    """number : of each carrier by name: base, axis letters, spindle, head_slide, table."""

    number: dict[str, int]
    motion: Motion

    @classmethod
    def of(cls, chain: Chain, parked_offset_mm: tuple[float, float, float]) -> Carriers:
        """The carriers of a chain.  parked_offset_mm : way of the head's slide from deployed to parked."""
        number = {"base": BASE}
        rows = [(BASE, -1, 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))]
        for end, side in (("spindle", chain.head), ("table", chain.table)):
            last = BASE
            for joint in side:
                rows.append((last, joint.column, int(joint.is_rotary), tuple(joint.direction), tuple(joint.point)))
                last = number[joint.letter] = len(rows) - 1
            number[end] = last
        rows.append((number["spindle"], SLIDE, 0, parked_offset_mm, (0.0, 0.0, 0.0)))
        number["head_slide"] = len(rows) - 1
        parent, column, rotary, direction, point = (np.array(part) for part in zip(*rows, strict=True))
        return cls(number, Motion(parent, column, rotary, direction.astype(np.float64), point.astype(np.float64)))


@njit(cache=True)
def place(motion: Motion, joints: Floats, is_parked: bool, world: Floats) -> None:
    """Motions (c, 3, 4) of all carriers from where they are with all joints at zero and the head deployed, machine frame.

    joints : (5,) float, mm or deg
    """
    own = np.empty((3, 4))
    for n in range(len(motion.parent)):
        own[:] = 0.0
        own[0, 0] = own[1, 1] = own[2, 2] = 1.0
        column = motion.column[n]
        if column == SLIDE:
            if is_parked:
                own[:, 3] = motion.direction[n]
        elif column >= 0 and motion.is_rotary[n]:
            _turn(own, motion.direction[n], motion.point[n], np.deg2rad(joints[column]))
        elif column >= 0:
            own[:, 3] = joints[column] * motion.direction[n]
        if n == BASE:
            world[n] = own
        else:
            product(world[motion.parent[n]], own, world[n])


@njit(cache=True)
def _turn(out: Floats, axis: Floats, point: Floats, angle: float) -> None:
    """Motion (3, 4) that turns right-handed about an axis through a point. Source: Rodrigues' formula."""
    c, s = np.cos(angle), np.sin(angle)
    for i in range(3):
        for j in range(3):
            out[i, j] = (1.0 - c) * axis[i] * axis[j]
        out[i, i] += c
    out[0, 1] -= s * axis[2]
    out[1, 0] += s * axis[2]
    out[0, 2] += s * axis[1]
    out[2, 0] -= s * axis[1]
    out[1, 2] -= s * axis[0]
    out[2, 1] += s * axis[0]
    for i in range(3):
        out[i, 3] = point[i] - out[i, 0] * point[0] - out[i, 1] * point[1] - out[i, 2] * point[2]


@njit(cache=True)
def product(a: Floats, b: Floats, out: Floats) -> None:
    """a b of motions (3, 4); out is neither of them."""
    for i in range(3):
        for j in range(4):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
        out[i, 3] += a[i, 3]


@njit(cache=True)
def relative(a: Floats, b: Floats, out: Floats) -> None:
    """The inverse of a times b, of motions (3, 4); out is neither of them."""
    for i in range(3):
        for j in range(4):
            out[i, j] = a[0, i] * b[0, j] + a[1, i] * b[1, j] + a[2, i] * b[2, j]
        out[i, 3] -= a[0, i] * a[0, 3] + a[1, i] * a[1, 3] + a[2, i] * a[2, 3]


@njit(cache=True)
def moved(motion: Floats, point: Floats, out: Floats) -> None:
    """A point (3,) carried by a motion (3, 4); out may be the point."""
    x, y, z = point[0], point[1], point[2]
    for i in range(3):
        out[i] = motion[i, 0] * x + motion[i, 1] * y + motion[i, 2] * z + motion[i, 3]
