"""How the tip's way bends on the arcs of a Program: by the cell's forward kinematics, since the table has only ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell
from planner.kinematics.chain import Chain
from planner.program import Program

Floats = NDArray[np.float64]


def plane_of(program: Program) -> tuple[int, int]:
    """Columns of X and Y in the Program's joints. Raises ValueError if there is none."""
    return program.axis_letters.index("X"), program.axis_letters.index("Y")


def bows(program: Program, cell: Cell) -> Floats:
    """(n, 3) float, mm, build frame: from the middle of each line's chord to the middle of its arc; 0 for straight lines."""
    table = program.table
    found = np.zeros((len(table), 3))
    bent = np.flatnonzero(table["bulge"] != 0.0)
    bent = bent[bent > 0]
    if bent.size == 0:
        return found
    columns = list(plane_of(program))
    start, end = table["joints_end"][bent - 1], table["joints_end"][bent]
    middle = 0.5 * (start + end)
    chord = (end - start)[:, columns]
    away = middle.copy()
    away[:, columns] += 0.5 * table["bulge"][bent, None] * np.column_stack([chord[:, 1], -chord[:, 0]])
    chain, gauge = Chain.from_cell(cell), np.zeros(3)
    moved = chain.forward(away, gauge)[0] - chain.forward(middle, gauge)[0]
    found[bent] = moved @ program.machine_from_build[:3, :3]
    return found
