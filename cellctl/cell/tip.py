"""Where the tool tip is in the build frame when no job says so: the reported joints through the cell's chain."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from config.cell import Cell
from planner.kinematics.chain import Chain

Vector = tuple[float, float, float]


class TipFinder:
    """Forward kinematics of one cell with its nominal placement."""

    def __init__(self, cell: Cell) -> None:
        """Raises PostError for a chain that is not five-axis."""
        self._chain = Chain.from_cell(cell)
        self._letters = cell.letters
        self._tips = {tool.number: np.array(tool.tip_mm) for tool in cell.tools}
        self._first = cell.tools[0].number
        turn = np.deg2rad(cell.placement.rotation_deg)
        cos, sin = float(np.cos(turn)), float(np.sin(turn))
        self._build_from_table = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        self._origin = np.array(cell.placement.part_origin_mm)

    def find(self, machine: Mapping[str, float], tool: int) -> tuple[Vector, Vector]:
        """Tip (mm) and axis (unit vector) in the build frame. machine : joint per letter, mm or deg; tool : its number, 0 unknown."""
        joints = np.array([[machine.get(letter, 0.0) for letter in self._letters]])
        tips, axes = self._chain.forward(joints, self._tips.get(tool, self._tips[self._first]))
        tip = self._build_from_table @ (tips[0] - self._origin)
        axis = self._build_from_table @ axes[0]
        return (float(tip[0]), float(tip[1]), float(tip[2])), (float(axis[0]), float(axis[1]), float(axis[2]))
