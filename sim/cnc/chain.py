"""Kinematics of the simulated machine, apart from the planner's: joints to tip and tool axis, by Rodrigues' formula along both chains."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from config import Cell, Joint
from sim.cnc.lookahead import Floats

TOOL_AXIS = np.array([0.0, 0.0, 1.0])


@njit(cache=True)
def carry(joints: Floats, angle_deg_or_mm: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Point (x, y, z) carried by one joint row (direction 3, pivot 3, is rotary, axis index); a rotary one turns right-handed."""
    dx, dy, dz = joints[0], joints[1], joints[2]
    if joints[6] == 0.0:
        return x + dx * angle_deg_or_mm, y + dy * angle_deg_or_mm, z + dz * angle_deg_or_mm
    angle = np.radians(angle_deg_or_mm)
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = x - joints[3], y - joints[4], z - joints[5]
    along = (dx * x + dy * y + dz * z) * (1.0 - c)
    return (
        x * c + (dy * z - dz * y) * s + dx * along + joints[3],
        y * c + (dz * x - dx * z) * s + dy * along + joints[4],
        z * c + (dx * y - dy * x) * s + dz * along + joints[5],
    )


@njit(cache=True)
def place_points(head: Floats, table: Floats, joints: Floats, point: Floats, in_table: bool) -> Floats:
    """(k, 3) where a point of the head (machine frame at all joints zero) is for joints (k, n): in the world or in the table frame.

    The head's joints are applied from the tool outwards (last first), the table's inverse from the base inwards (first first).
    """
    count = joints.shape[0]
    out = np.empty((count, 3))
    for k in range(count):
        x, y, z = point[0], point[1], point[2]
        for j in range(head.shape[0] - 1, -1, -1):
            x, y, z = carry(head[j], joints[k, int(head[j, 7])], x, y, z)
        if in_table:
            for j in range(table.shape[0]):
                x, y, z = carry(table[j], -joints[k, int(table[j, 7])], x, y, z)
        out[k, 0], out[k, 1], out[k, 2] = x, y, z
    return out


@njit(cache=True)
def place_pieces(head: Floats, table: Floats, joints: Floats, tip: Floats) -> tuple[Floats, Floats]:
    """Tip and tool axis in the table frame for joints (k, n): (k, 3) mm and (k, 3) unit vectors."""
    tips = place_points(head, table, joints, tip, True)
    above = place_points(head, table, joints, tip + TOOL_AXIS, True)
    return tips, above - tips


@njit(cache=True)
def turn_back(table: Floats, joints: Floats, direction: Floats) -> Floats:
    """(k, 3) a direction of the world in the table frame for joints (k, n): turned back by the table's rotary joints, first first."""
    count = joints.shape[0]
    out = np.empty((count, 3))
    for k in range(count):
        x, y, z = direction[0], direction[1], direction[2]
        for j in range(table.shape[0]):
            if table[j, 6] != 0.0:
                angle = -joints[k, int(table[j, 7])]
                x0, y0, z0 = carry(table[j], angle, 0.0, 0.0, 0.0)
                x, y, z = carry(table[j], angle, x, y, z)
                x, y, z = x - x0, y - y0, z - z0
        out[k, 0], out[k, 1], out[k, 2] = x, y, z
    return out


class Chain:
    """Both chains of a cell with its tools. joints : (k, n) float, mm or deg, machine coordinates, order of the cell's axes."""

    def __init__(self, cell: Cell) -> None:
        kinds = {axis.letter: axis.kind for axis in cell.axes}
        order = {letter: i for i, letter in enumerate(cell.letters)}

        def rows(joints: tuple[Joint, ...]) -> NDArray[np.float64]:
            table = [
                [*joint.direction, *cell.placement.pivots_mm.get(joint.axis, joint.point_mm),
                 float(kinds[joint.axis] == "rotary"), float(order[joint.axis])]
                for joint in joints
            ]  # fmt: skip
            return np.array(table, dtype=np.float64).reshape(-1, 8)

        self._head, self._table = rows(cell.kinematics.head), rows(cell.kinematics.table)
        self._tips = {tool.number: np.array(tool.tip_mm, dtype=np.float64) for tool in cell.tools}
        self._gauge = np.zeros(3)

    def tip_of(self, tool: int) -> NDArray[np.float64]:
        """(3,) tip from the gauge point; the gauge point itself when the spindle is empty or the number is unknown."""
        return self._tips.get(tool, self._gauge)

    def tip_in_table(self, joints: Floats, tool: int) -> Floats:
        """(k, 3) mm, tip in the table frame (carried by the table joints)."""
        return np.asarray(place_points(self._head, self._table, joints, self.tip_of(tool), True))

    def tip_in_world(self, joints: Floats, tool: int) -> Floats:
        """(k, 3) mm, tip in the machine frame."""
        return np.asarray(place_points(self._head, self._table, joints, self.tip_of(tool), False))

    def tip_and_axis_in_table(self, joints: Floats, tool: int) -> tuple[Floats, Floats]:
        """Both of the above and below in one pass: (k, 3) mm, tip, and (k, 3) unit vectors, axis."""
        tips, axes = place_pieces(self._head, self._table, joints, self.tip_of(tool))
        return tips, axes

    def down_in_table(self, joints: Floats) -> Floats:
        """(k, 3) unit vectors, direction of gravity in the table frame; the machine's z is up."""
        return np.asarray(turn_back(self._table, joints, -TOOL_AXIS))

    def axis_in_table(self, joints: Floats, tool: int) -> Floats:
        """(k, 3) unit vectors from tip into the head, in the table frame."""
        return self.tip_and_axis_in_table(joints, tool)[1]
