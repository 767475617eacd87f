"""The bodies at a finding: outlines of the tool in the spindle, and of what it met, in the commanded pose of the line that comes nearest."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from config import Cell
from sim import job as facts
from sim.job import Job
from sim.machine.bodies import BOX, FRUSTUM, Bodies, Body, body_distance, pack
from sim.machine.links import Links, links_of, place
from sim.machine.solids import bodies_of
from sim.report.bends import bulge_of, joints_along, plane_of

if TYPE_CHECKING:
    from sim.findings import Finding

Array = NDArray[np.float64]

POSES = 97  # along a line, of which the one that comes nearest to the finding's place is shown
CORNERS = 48  # of a circle
AXIS_MM = 60.0  # of the tool's axis shown above its tip
TOOL_CHANGE = re.compile(r"\bM0?6\b.*?\bT(\d+)|\bT(\d+).*?\bM0?6\b")


@dataclass(frozen=True)
class Outline:
    """One body. points : (n, 3) mm, build frame, whose convex hull holds it; is_tool: belongs to what stands in the spindle"""

    name: str
    points: Array
    is_tool: bool


@dataclass(frozen=True)
class Stand:
    """What stands around a place: outlines, and the tool's axis from its tip upwards, (2, 3) mm, build frame."""

    outlines: tuple[Outline, ...]
    axis: Array


class Scene:
    """The bodies of a cell as a Program moves them."""

    def __init__(self, program: Job, cell: Cell) -> None:
        self._program, self._cell = program, cell
        self._links, self._carriers = links_of(cell)
        self._solids = bodies_of(cell, self._carriers)
        self._bodies = pack(self._solids)
        self._build_from_table = np.linalg.inv(np.asarray(program.machine_from_build, dtype=np.float64))

    def at(self, finding: Finding) -> Stand | None:
        """Tool and what it met at the line of a finding, in the pose that brings them nearest to its place.

        None where the Program's table tells no joints, no tool is in the spindle, or the cell states no bodies.
        """
        joints = self._joints(finding.line)
        tool = self._tool(finding.line)
        if joints is None or tool == 0 or not self._solids or finding.at_mm is None:
            return None
        slide = float(mode_of(self._program, finding.line) == facts.DEPOSIT)
        place_mm = np.array(finding.at_mm)
        named = [n for n, solid in enumerate(self._solids) if solid.tool in (0, tool) and is_named(solid.name, finding)]
        carried = [n for n, solid in enumerate(self._solids) if self._is_of_tool(solid, tool)]
        asked = [n for n in named if n in carried] or carried[:1]
        poses = [self._poses(row, slide) for row in joints]
        nearest = min(range(len(poses)), key=lambda k: (round(self._distance(asked, poses[k], place_mm), 6), k))
        shown = [*carried, *(n for n in named if n not in carried)]
        outlines = tuple(Outline(self._solids[n].name, corners_of(self._solids[n], poses[nearest][n]), n in carried) for n in shown)
        return Stand(outlines, self._axis(tool, poses[nearest], carried))

    def _is_of_tool(self, solid: Body, tool: int) -> bool:
        """Whether a solid is part of the tool in the spindle: its cutter, or the head whose number it is."""
        if solid.tool:
            return solid.tool == tool
        kind = next((each.kind for each in self._cell.tools if each.number == tool), "")
        return kind == "deposition" and re.fullmatch(rf"(nozzle|head body)( {tool})?", solid.name) is not None

    def _joints(self, line: int) -> Array | None:
        """(POSES, axes) machine coordinates along a line, as the Program's table has them."""
        table = self._program.table
        if not 0 < line <= len(table) or "joints_end" not in (table.dtype.names or ()):
            return None
        count = len(self._cell.letters)
        end = np.asarray(table[line - 1]["joints_end"], dtype=np.float64)[:count]
        start = np.asarray(table[max(0, line - 2)]["joints_end"], dtype=np.float64)[:count]
        plane, shares = plane_of(self._cell), np.linspace(0.0, 1.0, POSES)
        return joints_along(start, end, bulge_of(self._program, line - 1) if plane else 0.0, plane or (0, 1), shares)

    def _tool(self, line: int) -> int:
        """Number of the tool in the spindle at a line: of the last change before it; 0: none yet."""
        for text in reversed(self._program.lines[:line]):
            found = TOOL_CHANGE.search(text)
            if found:
                return int(found.group(1) or found.group(2))
        return 0

    def _poses(self, joints: Array, slide: float) -> Array:
        """(solids, 3, 4)   Build frame from each solid's own."""
        links: Links = self._links
        world = np.zeros((len(links.column), 3, 4))
        table = np.zeros_like(world)
        place(links, joints, slide, world, table)
        frame = self._build_from_table
        moved = np.concatenate([table, np.tile([[[0.0, 0.0, 0.0, 1.0]]], (len(table), 1, 1))], axis=1)
        own = np.tile(np.eye(4), (len(self._solids), 1, 1))
        own[:, :3] = [solid.pose for solid in self._solids]
        return np.asarray((frame @ moved[[solid.carrier for solid in self._solids]] @ own)[:, :3])

    def _distance(self, asked: list[int], poses: Array, point: Array) -> float:
        """Least signed distance of a point of the build frame from some solids, mm."""
        bodies: Bodies = self._bodies
        found = []
        for n in asked:
            x, y, z = poses[n][:, :3].T @ (point - poses[n][:, 3])
            found.append(float(body_distance(bodies, n, x, y, z)))
        return min(found, default=0.0)

    def _axis(self, tool: int, poses: Array, carried: list[int]) -> Array:
        """(2, 3) mm   The tool's axis from its tip; the head's tip is its focus."""
        first = carried[0]
        tip = np.asarray(next(each.tip_mm for each in self._cell.tools if each.number == tool), dtype=np.float64)
        own = self._solids[first].pose
        low = own[:, :3].T @ (tip - own[:, 3])
        frame = poses[first]
        up = own[:, :3].T @ np.array([0.0, 0.0, AXIS_MM])
        return np.array([frame[:, :3] @ low + frame[:, 3], frame[:, :3] @ (low + up) + frame[:, 3]])


def is_named(name: str, finding: Finding) -> bool:
    """Whether a finding that tells of two bodies tells of this one."""
    return finding.kind in ("collision", "clearance") and re.search(rf"\b{re.escape(name)}\b", finding.text) is not None


def mode_of(program: Job, line: int) -> int | None:
    """What the cell is set to do at a line: the last mode of the schedule up to it; None before the first."""
    entries = program.schedule
    modes = entries["value"][(entries["channel"] == facts.MODE) & (entries["n"] <= line)]
    return int(modes[-1]) if len(modes) else None


def corners_of(body: Body, pose: Array) -> Array:
    """(n, 3) mm   Points whose convex hull holds a body. pose : (3, 4), the frame wanted from the body's own"""
    if body.kind == BOX:
        signs = np.stack(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0], indexing="ij"), axis=-1).reshape(-1, 3)
        own = signs * np.asarray(body.size)
    elif body.kind == FRUSTUM:
        low, high, length = body.size
        turn = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
        ring = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(CORNERS)])
        own = np.concatenate([low * ring, high * ring + [0.0, 0.0, length]])
    else:
        assert body.shell is not None
        own = body.shell.hull
    return np.asarray(own @ pose[:, :3].T + pose[:, 3])


def hull_of(points: Array) -> Array:
    """(m, 2) corners of the convex hull of points in the plane, counter-clockwise. points : (n, 2)

    Source: A. M. Andrew, Another efficient algorithm for convex hulls in two dimensions, Information Processing Letters 9 (1979) 216-219.
    """
    ordered = sorted({(float(x), float(y)) for x, y in np.round(points, 6)})
    if len(ordered) < 3:
        return np.array(ordered).reshape(-1, 2)
    chains = []
    for run in (ordered, ordered[::-1]):
        chain: list[tuple[float, float]] = []
        for x, y in run:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], (x, y)) <= 0.0:
                chain.pop()
            chain.append((x, y))
        chains.append(chain[:-1])
    return np.array(chains[0] + chains[1])


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    """Positive where a, b, c turn left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
