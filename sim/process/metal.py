"""Turns the trace of the machine into beads and cuts on the stock, in pieces of the right length."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from config import Cell
from sim.process.stock import Stock
from sim.trace import Trace

Array = NDArray[np.float64]

CONTACT_MM = 0.02  # a cutter that goes in less than this has only touched
AXIS_TURN_COS = math.cos(math.radians(0.5))  # a piece ends where the tool axis has turned this far
CHORD_COS = math.cos(math.radians(0.6))  # a cut ends where the path has turned this far: 0.005 mm of chord on a piece of 0.5 mm
JOINED_MM = 1e-6
ROUNDING = 1e-6  # of a cell: what is left of a piece by rounding


class Metal:
    """The stock under the machine; gets every trace of the World.

    build_from_table : (4, 4) float   Traces are in the table frame, the stock in the build frame.
    engaged : of each piece of the last trace, deepest cut into metal, mm (0 for none)
    """

    def __init__(self, stock: Stock, cell: Cell, build_from_table: Array) -> None:
        self.stock = stock
        self._rotation, self._shift = build_from_table[:3, :3], build_from_table[:3, 3]
        self._tools = {tool.number: tool for tool in cell.tools}
        self._bead = _Open()
        self._cut = _Open()
        self._path: list[list[float]] = []
        self._process: list[tuple[float, float, float]] = []
        self.engaged: list[tuple[int, float]] = []

    def apply(self, trace: Trace) -> None:
        """Add and remove metal along the pieces of one trace; afterwards `engaged` lists (line, depth mm) of cuts that met metal."""
        self.engaged = []
        moving = np.linalg.norm(trace.tip1 - trace.tip0, axis=1) > JOINED_MM
        if not moving.any():
            if self._bead.is_open and not trace.emission_w.any():
                self._end_bead()
                self._lay_down()
            return
        tool = self._tools.get(trace.tool)
        tip0, tip1 = trace.tip0 @ self._rotation.T + self._shift, trace.tip1 @ self._rotation.T + self._shift
        axis0, axis1 = trace.axis0 @ self._rotation.T, trace.axis1 @ self._rotation.T
        deposits = tool is not None and tool.kind == "deposition"
        for i in np.flatnonzero(moving):
            if deposits:
                self._add(tip0[i], tip1[i], axis1[i], trace.emission_w[i], trace.powder_g_min[i], trace.dt[i])
            elif tool is not None:
                self._remove(tip0[i], tip1[i], axis0[i], axis1[i], int(trace.line[i]), trace.tool)
        self._lay_down()

    def finish(self) -> None:
        """Carry out what waits for more path."""
        self._end_bead()
        self._lay_down()
        self._end_cut()

    def _add(self, start: Array, end: Array, axis: Array, power_w: float, powder: float, seconds: float) -> None:
        """Lay down one piece of motion, cut where the open piece of bead has grown to one cell's length."""
        self._end_cut()
        piece = self._bead
        if power_w < self.stock.material.bead.min_power_w:
            self._end_bead()
            return
        if piece.is_open and not piece.goes_on(start, axis):
            self._end_bead()
        cell = self.stock.cell_mm
        length = float(np.linalg.norm(end - start))
        done = 0.0
        while done < length:
            room = cell - (piece.path if piece.is_open else 0.0)
            take = min(room, length - done)
            part = seconds * take / length
            a, b = start + (done / length) * (end - start), start + ((done + take) / length) * (end - start)
            piece.extend(a, b, axis, axis, part, power_w * part, powder * part)
            done += take
            if piece.path >= cell * (1.0 - ROUNDING):
                self._end_bead()
            if length - done < ROUNDING * cell:
                break

    def _end_bead(self) -> None:
        piece = self._bead
        if piece.is_open and piece.seconds > 0.0:
            self._path.append([*piece.start, *piece.end, *piece.axis0])
            self._process.append((piece.energy / piece.seconds, piece.powder / piece.seconds, piece.seconds))
        piece.is_open = False

    def _lay_down(self) -> None:
        """Carry out the pieces of bead that wait."""
        if self._path:
            self.stock.deposit_pieces(np.array(self._path), np.array(self._process))
            self._path, self._process = [], []

    def _remove(self, start: Array, end: Array, axis0: Array, axis1: Array, line: int, tool: int) -> None:
        self._end_bead()
        piece = self._cut
        if piece.is_open and not (piece.tool == tool and piece.line == line and piece.goes_straight_on(start, end, axis1)):
            self._end_cut()
        piece.tool, piece.line = tool, line
        piece.extend(start, end, axis0, axis1, 0.0, 0.0, 0.0)
        if piece.length >= self._tools[tool].diameter_mm:
            self._end_cut()

    def _end_cut(self) -> None:
        piece = self._cut
        if not piece.is_open:
            return
        self._lay_down()
        tool = self._tools[piece.tool]
        depth = self.stock.cut(
            piece.start, piece.end, piece.axis0, piece.axis1, 0.5 * tool.diameter_mm, tool.corner_radius_mm, -tool.tip_mm[2]
        )
        if depth > CONTACT_MM:
            self.engaged.append((piece.line, depth))
        piece.is_open = False


class _Open:
    """A piece of path that is still growing."""

    def __init__(self) -> None:
        self.is_open = False
        self.start = self.end = self.axis0 = self.axis1 = np.zeros(3)
        self.length = self.path = self.seconds = self.energy = self.powder = 0.0
        self.line = self.tool = 0

    def goes_on(self, start: Array, axis: Array) -> bool:
        """Whether motion from `start` joins the piece without a turn of the axis."""
        return float(np.abs(start - self.end).max()) < JOINED_MM and float(axis @ self.axis0) > AXIS_TURN_COS

    def goes_straight_on(self, start: Array, end: Array, axis: Array) -> bool:
        """Whether it joins and keeps the direction as well."""
        if not self.goes_on(start, axis):
            return False
        chord, step = end - self.start, end - start
        return float(chord @ step) > CHORD_COS * float(np.linalg.norm(chord)) * float(np.linalg.norm(step))

    def extend(self, start: Array, end: Array, axis0: Array, axis1: Array, seconds: float, energy: float, powder: float) -> None:
        """Begin, or go on with, the piece."""
        if not self.is_open:
            self.is_open = True
            self.start, self.axis0 = start, axis0
            self.path = self.seconds = self.energy = self.powder = 0.0
        self.path += float(np.linalg.norm(end - start))
        self.end, self.axis1 = end, axis1
        self.seconds += seconds
        self.energy += energy
        self.powder += powder
        self.length = float(np.linalg.norm(end - self.start))
