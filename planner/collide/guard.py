"""What a tool may hit at a step of a Program: the machine, the plate with its clamps, and the part as it stands."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from config.cell import Cell, Tool
from planner.collide.bodies import PLATE, Body, Packed, bodies_of, plate_body
from planner.collide.carriers import BASE, Carriers
from planner.collide.clearance import Clearance
from planner.collide.solids import Pairs, least_clearance
from planner.errors import PostError
from planner.kinematics.chain import Chain
from planner.plan import Operation, Plan
from planner.recipe import parse_recipe

Floats = NDArray[np.float64]

_ALWAYS = -1.0  # in `Pairs.cut_mm`: bodies that may not be in each other at all


class Guard:
    """The cell with the part as it stands; grows operation by operation.

    placed : (4, 4) float, table from build
    A cell without `machine` has no bodies: everything is free, and `is_watching` is False.
    Raises PostError for an STL of the cell that is no mesh, a carrier without an axis, a name in `machine.ignore` that is no body.
    """

    def __init__(self, plan: Plan, cell: Cell, chain: Chain, placed: Floats) -> None:
        self.plan, self.cell, self.chain, self.placed = plan, cell, chain, placed
        self.is_watching = cell.machine is not None
        self.contact_mm = cell.machine.contact_mm if cell.machine else 0.0
        """Bodies that are less in each other than this only touch."""
        parked = cell.machine.parked_offset_mm if cell.machine else (0.0, 0.0, 0.0)
        self._carriers = Carriers.of(chain, parked)
        self._bodies = self._all_bodies()
        self._of_tool: dict[tuple[int, bool], tuple[Packed, Pairs, tuple[tuple[str, str], ...]]] = {}

    def clearance(self, tool: Tool, joints: ArrayLike, *, cuts: bool, limit_mm: float = float("inf")) -> Clearance:
        """Least clearance of everything that moves, in every pose.

        tool : the one that works; a cutter is in the spindle and the head parked, or the head is out and no cutter in
        joints : (n, 5) float, mm or deg, machine coordinates
        cuts : the cutter's flutes may be in the part and, by the cell's `plate_cut_mm`, in the plate
        limit_mm : what is farther is not looked for; saves time
        """
        rows = np.ascontiguousarray(np.atleast_2d(np.asarray(joints, dtype=np.float64)))
        if not self.is_watching or not len(rows):
            none = np.full(len(rows), -1, dtype=np.int64)
            return Clearance(np.full(len(rows), limit_mm), none, np.zeros((len(rows), 3)), ())
        bodies, pairs, names = self._mounted(tool, cuts)
        table = self._carriers.number["table"]
        parked = tool.kind != "deposition"
        mm, nearest, places = least_clearance(self._carriers.motion, bodies, pairs, table, rows, parked, limit_mm)
        places = (places - self.placed[:3, 3]) @ self.placed[:3, :3]
        return Clearance(mm, nearest, places, names)

    def advance(self, operation: Operation) -> None:
        """Take in what an operation of the plan has added or cut."""

    def _all_bodies(self) -> list[Body]:
        if self.cell.machine is None:
            return []
        width, depth = parse_recipe(self.plan.recipe_toml).substrate_mm
        size = (width, depth, self.cell.plate.size_mm[2])
        number = self._carriers.number
        bodies = bodies_of(self.cell, number, plate_body(size, number["table"], self.placed))
        known = {body.name for body in bodies}
        unknown = sorted({name for pair in self.cell.machine.ignore for name in pair} - known)
        if unknown:
            raise PostError(f"cell {self.cell.name}: machine.ignore: no body {unknown[0]}", f"there is: {', '.join(sorted(known))}")
        return bodies

    def _mounted(self, tool: Tool, cuts: bool) -> tuple[Packed, Pairs, tuple[tuple[str, str], ...]]:
        """The bodies that are there with a tool, and which of them may meet."""
        key = (tool.number, cuts)
        if key not in self._of_tool:
            bodies = [body for body in self._bodies if body.tool in (0, tool.number)]
            pairs, cut, names = self._pairs(bodies, cuts)
            packed = Packed.of(bodies)
            self._of_tool[key] = packed, Pairs(np.array(pairs, dtype=np.int64).reshape(-1, 2), np.array(cut, dtype=np.float64)), tuple(names)
        return self._of_tool[key]

    def _pairs(self, bodies: list[Body], cuts: bool) -> tuple[list[tuple[int, int]], list[float], list[tuple[str, str]]]:
        """Pairs on different carriers that are not to be ignored, how deep they may be in each other, and their names: the head's side first."""
        machine = self.cell.machine
        assert machine is not None
        ignore = {frozenset(pair) for pair in machine.ignore}
        ends = {self._carriers.number[joint.letter] for joint in self.chain.head} | {self._carriers.number["head_slide"]} - {BASE}
        pairs, cut, names = [], [], []
        for i, one in enumerate(bodies):
            for j in range(i + 1, len(bodies)):
                other = bodies[j]
                if one.carrier == other.carrier or frozenset((one.name, other.name)) in ignore:
                    continue
                first, second = (i, j) if one.carrier in ends else (j, i)
                in_plate = cuts and {one.is_flutes, other.is_flutes} == {True, False} and PLATE in (one.name, other.name)
                pairs.append((first, second))
                cut.append(machine.plate_cut_mm if in_plate else _ALWAYS)
                names.append((bodies[first].name, bodies[second].name))
        return pairs, cut, names
