"""Where the machine's links are: a rigid motion for each carrier of solids, from the joints and the head's slide."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from config import Cell, Joint

Array = NDArray[np.float64]
Index = NDArray[np.int64]

BASE = 0


class Links(NamedTuple):
    """Carriers in order: the base, the head's joints, the head's slide, the table's joints.

    direction, pivot : (n, 3)   Of the joint that moves the carrier against its parent; machine frame at all joints zero, mm.
    is_rotary : (n,) 0 or 1   column : (n,) int   Of the joints' array; -1: the base, -2: the slide.   parent : (n,) int
    slide, table : (1,) int   The carriers of the deposition head, and of the plate.
    """

    direction: Array
    pivot: Array
    is_rotary: NDArray[np.int64]
    column: NDArray[np.int64]
    parent: NDArray[np.int64]
    slide: NDArray[np.int64]
    table: NDArray[np.int64]


def links_of(cell: Cell) -> tuple[Links, dict[str, int]]:
    """The cell's links, and the number of each carrier by its name (base, axis letters, spindle, head_slide, table)."""
    order = {letter: n for n, letter in enumerate(cell.letters)}
    kinds = {axis.letter: axis.kind for axis in cell.axes}
    park = cell.machine.parked_offset_mm if cell.machine else (0.0, 0.0, 0.0)
    rows: list[tuple[tuple[float, ...], tuple[float, ...], int, int, int]] = [((0.0,) * 3, (0.0,) * 3, 0, -1, BASE)]
    names = {"base": BASE}

    def add(joints: tuple[Joint, ...]) -> int:
        parent = BASE
        for joint in joints:
            point = cell.placement.pivots_mm.get(joint.axis, joint.point_mm)
            rows.append((joint.direction, point, int(kinds[joint.axis] == "rotary"), order[joint.axis], parent))
            names[joint.axis] = parent = len(rows) - 1
        return parent

    names["spindle"] = add(cell.kinematics.head)
    rows.append((park, (0.0,) * 3, 0, -2, names["spindle"]))
    names["head_slide"] = len(rows) - 1
    names["table"] = add(cell.kinematics.table)
    direction, pivot, rotary, column, parent = zip(*rows, strict=True)
    links = Links(
        np.array(direction, dtype=np.float64), np.array(pivot, dtype=np.float64), np.array(rotary, dtype=np.int64),
        np.array(column, dtype=np.int64), np.array(parent, dtype=np.int64),
        np.array([names["head_slide"]], dtype=np.int64), np.array([names["table"]], dtype=np.int64),
    )  # fmt: skip
    return links, names


@njit(cache=True, nogil=True)
def rotate(out: Array, axis: Array, angle: float) -> None:
    """Rodrigues' rotation into out[:3, :3]. axis : (3,) unit vector; angle in rad, right-handed."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * (1 - c), x * y * (1 - c) - z * s, x * z * (1 - c) + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * (1 - c) + z * s, c + y * y * (1 - c), y * z * (1 - c) - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * (1 - c) - y * s, z * y * (1 - c) + x * s, c + z * z * (1 - c)


@njit(cache=True, nogil=True)
def multiply(a: Array, b: Array, out: Array) -> None:
    """Product of two (3, 4) rigid motions; out may be neither of them."""
    for i in range(3):
        for j in range(4):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
        out[i, 3] += a[i, 3]


@njit(cache=True, nogil=True)
def multiply_inverse(a: Array, b: Array, out: Array) -> None:
    """inverse(a) b of two (3, 4) rigid motions; out may be neither of them."""
    for i in range(3):
        for j in range(4):
            out[i, j] = a[0, i] * b[0, j] + a[1, i] * b[1, j] + a[2, i] * b[2, j]
        out[i, 3] -= a[0, i] * a[0, 3] + a[1, i] * a[1, 3] + a[2, i] * a[2, 3]


@njit(cache=True, nogil=True)
def place(links: Links, joints: Array, slide: float, world: Array, table: Array) -> None:
    """Motion of every carrier from the pose at all joints zero and the slide out.

    joints : (n,) mm or deg, machine coordinates; slide : 0 parked to 1 deployed
    world : (carriers, 3, 4)   Gets it in the machine frame.   table : the same in the frame of the table.
    """
    own = np.zeros((3, 4))
    for n in range(len(links.column)):
        column = links.column[n]
        own[:] = 0.0
        own[0, 0] = own[1, 1] = own[2, 2] = 1.0
        if column == -2:
            own[:, 3] = (1.0 - slide) * links.direction[n]
        elif column >= 0 and links.is_rotary[n]:
            rotate(own, links.direction[n], np.radians(joints[column]))
            p = links.pivot[n]
            for i in range(3):
                own[i, 3] = p[i] - own[i, 0] * p[0] - own[i, 1] * p[1] - own[i, 2] * p[2]
        elif column >= 0:
            own[:, 3] = joints[column] * links.direction[n]
        if n == BASE:
            world[n] = own
        else:
            multiply(world[links.parent[n]], own, world[n])
    for n in range(len(links.column)):
        multiply_inverse(world[links.table[0]], world[n], table[n])
