"""The joint chain of a cell: forward kinematics from machine joints to tool tip and tool axis in the table frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell, Placement
from planner.errors import PostError

Floats = NDArray[np.float64]

TOOL_AXIS = np.array([0.0, 0.0, 1.0])
_PARALLEL = 1e-6  # sine of an angle below which two joint axes count as parallel


@dataclass(frozen=True)
class ChainJoint:
    """One joint: its column in (n, 5) joint arrays, and how it moves what it carries."""

    letter: str
    column: int
    is_rotary: bool
    direction: Floats
    point: Floats


@dataclass(frozen=True)
class Chain:
    """Table joints and head joints, each from the machine's base outward.

    Joint arrays are (n, 5) float, mm and degrees, machine coordinates, in the order of the cell's axes.
    Tips are mm and axes unit vectors, both in the table frame (the machine frame at all joints zero).
    """

    letters: tuple[str, ...]
    table: tuple[ChainJoint, ...]
    head: tuple[ChainJoint, ...]

    @classmethod
    def from_cell(cls, cell: Cell, placement: Placement | None = None) -> Chain:
        """The cell's chain with the pivots that were measured for the placement.

        Raises PostError if it has not three linear and two rotary joints that are independent of each other.
        """
        pivots = (placement or cell.placement).pivots_mm
        columns = {letter: k for k, letter in enumerate(cell.letters)}
        sides = [
            tuple(
                ChainJoint(
                    joint.axis,
                    columns[joint.axis],
                    cell.axis(joint.axis).kind == "rotary",
                    np.array(joint.direction),
                    np.array(pivots.get(joint.axis, joint.point_mm)),
                )
                for joint in joints
            )
            for joints in (cell.kinematics.table, cell.kinematics.head)
        ]
        chain = cls(cell.letters, sides[0], sides[1])
        chain._check(cell.name)
        return chain

    @property
    def rotary(self) -> tuple[ChainJoint, ...]:
        """The two rotary joints: those of the table first, each side from the base outward."""
        return tuple(joint for joint in (*self.table, *self.head) if joint.is_rotary)

    @property
    def linear(self) -> tuple[ChainJoint, ...]:
        """The three linear joints: those of the table first, each side from the base outward."""
        return tuple(joint for joint in (*self.table, *self.head) if not joint.is_rotary)

    def forward(self, joints: Floats, tool_tip_mm: Floats) -> tuple[Floats, Floats]:
        """Tip (n, 3) mm and axis (n, 3) of the tool in the table frame.

        joints : (n, 5) float   tool_tip_mm : (3,) float, from the gauge point at all joints zero
        Source: product of exponentials, Murray, Li & Sastry, A Mathematical Introduction to Robotic Manipulation, 3.2.
        """
        tip = np.broadcast_to(np.asarray(tool_tip_mm, dtype=np.float64), (len(joints), 3))
        axis = np.broadcast_to(TOOL_AXIS, (len(joints), 3))
        tip, axis = self._carry(self.head[::-1], joints, 1.0, tip, axis)
        return self._carry(self.table, joints, -1.0, tip, axis)

    def carried_by_head(self, joints: Floats, tool_tip_mm: Floats) -> Floats:
        """World position (n, 3), mm, of the tool tip."""
        tip = np.broadcast_to(np.asarray(tool_tip_mm, dtype=np.float64), (len(joints), 3))
        return self._carry(self.head[::-1], joints, 1.0, tip, tip)[0]

    def carried_by_table(self, joints: Floats, points: Floats) -> Floats:
        """World position (n, 3), mm, of points (n, 3) of the table frame."""
        return self._carry(self.table[::-1], joints, 1.0, points, points)[0]

    def linear_directions(self, joints: Floats) -> Floats:
        """(n, 3, 3) float: row k is how linear joint k moves the tip against the table in the world, per mm."""
        rows = np.empty((len(joints), 3, 3))
        for k, joint in enumerate(self.linear):
            side = self.table if joint in self.table else self.head
            before = side[: side.index(joint)][::-1]
            way = np.broadcast_to(joint.direction if side is self.head else -joint.direction, (len(joints), 3))
            rows[:, k] = self._carry(before, joints, 1.0, way, way)[1]
        return rows

    @staticmethod
    def _carry(
        side: tuple[ChainJoint, ...], joints: Floats, sense: float, points: Floats, vectors: Floats
    ) -> tuple[Floats, Floats]:
        for joint in side:
            value = sense * joints[:, joint.column]
            if joint.is_rotary:
                points = joint.point + rotated(points - joint.point, joint.direction, value)
                vectors = rotated(vectors, joint.direction, value)
            else:
                points = points + value[:, None] * joint.direction
        return np.asarray(points), np.asarray(vectors)

    def _check(self, name: str) -> None:
        if len(self.rotary) != 2 or len(self.linear) != 3:
            raise PostError(
                f"cell {name}: {len(self.linear)} linear and {len(self.rotary)} rotary joints; five-axis posting needs 3 and 2",
                "correct [[axes]] and [[kinematics.*]] of the cell file",
            )
        first, second = self.rotary
        if float(np.linalg.norm(np.cross(first.direction, second.direction))) < _PARALLEL:
            raise PostError(
                f"cell {name}: rotary joints {first.letter} and {second.letter} are parallel",
                "correct their directions",
            )
        ways = self.linear_directions(np.zeros((1, 5)))[0]
        if abs(float(np.linalg.det(ways))) < _PARALLEL:
            raise PostError(f"cell {name}: the linear joints do not span space", "correct their directions")


def rotated(vectors: Floats, direction: Floats, angle_deg: Floats) -> Floats:
    """Vectors (n, 3) turned right-handed about a unit direction (3,) by (n,) degrees. Source: Rodrigues' formula."""
    radians = np.deg2rad(angle_deg)[:, None]
    along = (vectors @ direction)[:, None] * direction
    across = vectors - along
    x, y, z = direction
    crossed = vectors @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # direction x vector, row by row
    turned = along + np.cos(radians) * across + np.sin(radians) * crossed
    return np.asarray(turned, dtype=np.float64)
