"""Lines of a Program as they are driven: straight between their ends, or, where the table says so, on an arc of the joints X and Y."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from config import Cell
from sim.cnc.chain import Chain
from sim.job import Job

Array = NDArray[np.float64]

DRAWN_DEG = 3.0  # of an arc between two points that are drawn


def bulge_of(program: Job, index: int) -> float:
    """tan(sweep / 4) of the arc that leads to a row of the table, counter-clockwise > 0 from X to Y; 0: a straight line."""
    table = program.table
    return float(table[index]["bulge"]) if index > 0 and "bulge" in (table.dtype.names or ()) else 0.0


def joints_along(start: Array, end: Array, bulge: float, plane: tuple[int, int], shares: Array) -> Array:
    """(k, n) joints at shares (k,) of the way from start (n,) to end (n,): X and Y on a circle about one centre, the others evenly."""
    joints = np.asarray(start + shares[:, None] * (end - start))
    chord = end[list(plane)] - start[list(plane)]
    if bulge == 0.0 or not chord.any():
        return joints
    sweep = 4.0 * np.arctan(bulge)
    centre = 0.5 * chord + 0.5 / np.tan(0.5 * sweep) * np.array([-chord[1], chord[0]])
    turned = sweep * shares
    cosine, sine = np.cos(turned), np.sin(turned)
    joints[:, plane[0]] = start[plane[0]] + centre[0] - cosine * centre[0] + sine * centre[1]
    joints[:, plane[1]] = start[plane[1]] + centre[1] - sine * centre[0] - cosine * centre[1]
    return joints


def plane_of(cell: Cell) -> tuple[int, int] | None:
    """Columns of X and Y in the cell's joints; None where it has not both."""
    letters = cell.letters
    return (letters.index("X"), letters.index("Y")) if {"X", "Y"} <= set(letters) else None


class Bends:
    """The tip's path along lines, from the ends that the table tells and the cell's kinematics."""

    def __init__(self, program: Job, cell: Cell) -> None:
        self._program, self._plane = program, plane_of(cell)
        self._chain = Chain(cell)
        self._axes = len(cell.letters)
        self._turn = np.asarray(program.machine_from_build, dtype=np.float64)[:3, :3]

    def path(self, first: int, last: int) -> Array:
        """(n, 3) mm, build frame: the tip from the end of the table's row `first` through the rows up to `last`, arcs as polylines."""
        ends = np.asarray(self._program.table["tip_end"][first : last + 1], dtype=np.float64)
        parts = [ends[:1]]
        for index in range(first + 1, last + 1):
            parts.append(self._bent(index))
            parts.append(ends[index - first : index - first + 1])
        return np.concatenate(parts)

    def _bent(self, index: int) -> Array:
        """(k, 3) mm   Points of an arc without its ends: off the chord by what its joints are off theirs, all others standing still."""
        bulge = bulge_of(self._program, index)
        table = self._program.table
        if bulge == 0.0 or self._plane is None or "joints_end" not in (table.dtype.names or ()):
            return np.zeros((0, 3))
        start, end = (np.asarray(table[row]["joints_end"], dtype=np.float64)[: self._axes] for row in (index - 1, index))
        shares = np.linspace(0.0, 1.0, 1 + max(2, int(np.ceil(np.degrees(4.0 * abs(np.arctan(bulge))) / DRAWN_DEG))))[1:-1]
        straight = np.ascontiguousarray(start + shares[:, None] * (end - start))
        driven = joints_along(start, end, bulge, self._plane, shares)
        off = (self._chain.tip_in_table(driven, 0) - self._chain.tip_in_table(straight, 0)) @ self._turn
        low, high = (np.asarray(table[row]["tip_end"], dtype=np.float64) for row in (index - 1, index))
        return np.asarray(low + shares[:, None] * (high - low) + off)
