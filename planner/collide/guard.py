"""What a tool may hit at a step of a Program: the machine, the plate with its clamps, and the part as it stands."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from operator import is_

import numpy as np
from numpy.typing import ArrayLike, NDArray

from config.cell import Cell, Tool
from planner.collide.bodies import PLATE, Body, Packed, bodies_of, plate_body
from planner.collide.carriers import Carriers
from planner.collide.clearance import Clearance
from planner.collide.follow import Watch, follow
from planner.collide.metal import FINISHED_MM, bead_points, cutter_poses, stock_points, wall_points
from planner.collide.standing import Standing
from planner.collide.watched import watched
from planner.errors import PostError
from planner.kinematics.chain import Chain
from planner.plan import Operation, Pass, Plan
from planner.recipe import parse_recipe

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

PART = "part"
PART_MM = 0.5
"""How exactly the points of the part tell where its metal ends: half of a bead's rounding and of their pitch."""


@dataclass(frozen=True, eq=False)
class Least:
    """Where two things came nearest.  mm : less than 0 how deep   place : (3,) mm, build frame   why : one line"""

    pair: tuple[str, str]
    mm: float
    place: Floats
    why: str


@dataclass(frozen=True)
class _Mounted:
    """The bodies that are there with a tool, what of them is looked at, and the names of pairs and of bodies with the part."""

    bodies: Packed
    watch: Watch
    names: tuple[tuple[str, str], ...]


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
        self.standing = Standing()
        self._carriers = Carriers.of(chain, cell.machine.parked_offset_mm if cell.machine else (0.0, 0.0, 0.0))
        self._bodies = self._all_bodies()
        self._flutes = {body.name for body in self._bodies if body.is_flutes}
        self._mountings: dict[tuple[int, bool], _Mounted] = {}
        self._layers = {layer.index: layer for layer in plan.layers}  # whose walls do not stand yet
        self._ups = {layer.index: np.asarray(layer.top[3:6], dtype=np.float64) for layer in plan.layers}
        if self.is_watching and plan.process == "mill":
            self.standing.grow(stock_points(plan, parse_recipe(plan.recipe_toml)))
            self.standing.grow(np.vstack([np.empty((0, 3)), *(wall_points(layer) for layer in plan.layers)]), FINISHED_MM)
        self._least: dict[tuple[str, str], Least] = {}
        self._step = 0
        self._taken = np.empty(0, dtype=np.int64)
        self._begun: tuple[tuple[Pass, ...], Tool | None] = ((), None)

    def clearance(
        self,
        tool: Tool,
        joints: ArrayLike,
        *,
        cuts: bool,
        limit_mm: float = float("inf"),
        joined: ArrayLike | None = None,
        passes: ArrayLike | None = None,
    ) -> Clearance:
        """Least clearance of everything that moves, in every pose, from each other and from the part as it stands.

        tool : the one that works; a cutter is in the spindle and the head parked, or the head is out and no cutter in
        joints : (n, 5) float, mm or deg, machine coordinates
        cuts : the cutter's flutes may be in the part and, by the cell's `plate_cut_mm`, in the plate
        limit_mm : what is farther is not looked for; saves time
        joined : (n,) bool, where the machine comes straight from the row before: the way there counts too; None: single poses
        passes : (n,) int, in which pass of the operation that was begun each row is: what that and the passes before it cut is gone;
            None: all that the operation cuts is gone
        """
        rows = np.ascontiguousarray(np.atleast_2d(np.asarray(joints, dtype=np.float64)))
        count = len(rows)
        if not self.is_watching or not count:
            return Clearance(np.full(count, limit_mm), np.full(count, -1, dtype=np.int64), np.zeros((count, 3)), ())
        there = self._mounted(tool, cuts)
        is_joined = np.zeros(count, dtype=np.bool_) if joined is None else np.asarray(joined, dtype=np.bool_)
        number = np.iinfo(np.int64).max // 2 if passes is None else np.asarray(passes, dtype=np.int64)
        steps = np.broadcast_to(self._step + number, (count,)).astype(np.int64)
        found = follow(
            self._carriers.motion, there.bodies, there.watch, self.standing.forest, rows, is_joined, steps,
            tool.kind != "deposition", float(limit_mm),
        )  # fmt: skip
        return Clearance(*found, there.names)

    def hits(self, found: Clearance) -> Bools:
        """(n,) bool: poses in which something is hit: bodies are deeper in each other than contact, or in the part than its points tell."""
        is_part = _are_part(found.names)[found.pairs]
        return np.asarray(found.mm < np.where(is_part, -max(PART_MM, self.contact_mm), -self.contact_mm))

    def note(self, found: Clearance) -> None:
        """Keep the least clearances of what is really run, for `least`; flutes that touch what they come to cut do not count."""
        for number in np.unique(found.pairs[found.pairs >= 0]):
            rows = np.flatnonzero(found.pairs == number)
            row = int(rows[np.argmin(found.mm[rows])])
            pair, gap = found.names[int(number)], float(found.mm[row])
            if pair[0] in self._flutes and pair[1] in (PART, PLATE) and not self.hits(found)[row]:
                continue
            if pair not in self._least or gap < self._least[pair].mm:
                self._least[pair] = Least(pair, gap, found.place(row), found.why(row))

    @property
    def least(self) -> tuple[Least, ...]:
        """What came nearest to what along all that was noted, the nearest first; what stayed farther than was asked is not there."""
        return tuple(sorted(self._least.values(), key=lambda item: item.mm))

    def begin(self, operation: Operation, tool: Tool | None = None) -> None:
        """What an operation is going to cut counts as gone by the pass that cuts it.

        tool : the cutter that does it; None: of those that it may be done with the one with the shortest flutes
        """
        begun = (operation.passes, tool)
        if len(begun[0]) == len(self._begun[0]) and tool is self._begun[1] and all(map(is_, begun[0], self._begun[0])):
            return
        self.standing.restore(self._taken)
        self._taken, self._begun = np.empty(0, dtype=np.int64), begun
        if operation.process.is_deposit or not self.is_watching:
            return
        poses, numbers = cutter_poses(operation.passes)
        cutter = self._cutter(operation) if tool is None else tool
        if cutter is not None:
            self._taken = self.standing.cut(poses, self._step + numbers, *_cutting_end(cutter))

    def advance(self, operation: Operation, tool: Tool | None = None) -> None:
        """Take in what an operation of the plan, as it is posted, has added or cut.  tool : as for `begin`"""
        if not self.is_watching:
            return
        if operation.process.is_deposit:
            layer = self._layers.pop(operation.layer, None)
            beads = bead_points(operation, self._ups[operation.layer])
            walls = np.empty((0, 3)) if layer is None else wall_points(layer)
            margin = np.append(np.zeros(len(beads)), np.full(len(walls), FINISHED_MM))
            self.standing.grow(np.vstack([beads, walls]), margin)
        else:
            self.begin(operation, tool)
        self._taken, self._begun = np.empty(0, dtype=np.int64), ((), None)
        self._step += len(operation.passes)

    def _cutter(self, operation: Operation) -> Tool | None:
        """Of the cell's cutters of an operation's diameter the one with the shortest flutes."""
        fit = [item for item in self.cell.tools if item.kind != "deposition" and abs(item.diameter_mm - operation.cutter_diameter_mm) < 0.01]
        return min(fit, key=lambda item: item.flute_length_mm, default=None)

    def _all_bodies(self) -> list[Body]:
        if self.cell.machine is None:
            return []
        width, depth = parse_recipe(self.plan.recipe_toml).substrate_mm
        number = self._carriers.number
        plate = plate_body((width, depth, self.cell.plate.size_mm[2]), number["table"], self.placed)
        bodies = bodies_of(self.cell, number, plate)
        known = {body.name for body in bodies}
        unknown = sorted({name for pair in self.cell.machine.ignore for name in pair} - known)
        if unknown:
            raise PostError(f"cell {self.cell.name}: machine.ignore: no body {unknown[0]}", f"there is: {', '.join(sorted(known))}")
        return bodies

    def _mounted(self, tool: Tool, cuts: bool) -> _Mounted:
        key = (tool.number, cuts)
        if key not in self._mountings:
            assert self.cell.machine is not None
            bodies = [body for body in self._bodies if body.tool in (0, tool.number)]
            watch, pairs = watched(bodies, self.cell, self._carriers, self.placed, np.asarray(self.plan.bounds), cuts)
            names = (*pairs, *((body.name, PART) for body in bodies))
            self._mountings[key] = _Mounted(Packed.of(bodies), watch, names)
        return self._mountings[key]


def _cutting_end(tool: Tool) -> tuple[float, float, float]:
    """Radius, rounding of the edge and length of a cutter's flutes, mm."""
    radius = 0.5 * tool.diameter_mm
    edge = radius if tool.kind == "ball_mill" else min(tool.corner_radius_mm, radius)
    return radius, edge, min(tool.flute_length_mm or tool.stickout, tool.stickout)


@lru_cache(maxsize=256)
def _are_part(names: tuple[tuple[str, str], ...]) -> Bools:
    """(k + 1,) bool: pairs of which the second is the part; the last, of no pair, is not."""
    return np.array([*(pair[1] == PART for pair in names), False])
