"""Turns the trace of the machine into beads and cuts on the stock, in pieces of the right length."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from config import Cell, Tool
from sim.process import bead
from sim.process import pieces as cutting
from sim.process.bead import pool_law
from sim.process.cut import ENGAGED, ENGAGED_AT, GOUGE, GOUGE_AT
from sim.process.deposit import deposit_pieces
from sim.process.heat import cold_state, heat_step
from sim.process.pieces import bead_pieces, by_move, cut_pieces, end_bead, end_cut, most_pieces
from sim.process.stock import Stock
from sim.trace import Trace

Array = NDArray[np.float64]

CONTACT_MM = 0.02  # a cutter that goes in less than this has only touched
PIECE_SPOTS = 0.1  # of the spot's diameter: a piece of bead is no shorter, the pool is far wider
G_PER_MIN = 1.0 / 60.0


class Engagement(NamedTuple):
    """A piece of a cutter's path that met metal, or the part behind it.

    line : N-word   depth_mm : deepest cut into metal   gouge_mm : deepest cut below the part's surface, 0 without `Stock.guard`
    at_mm : (3,) float, build frame, the worst place   tool : number
    """

    line: int
    depth_mm: float
    gouge_mm: float
    at_mm: Array
    tool: int


class Laid(NamedTuple):
    """What was laid in each piece of the last trace, (k,) float each; NaN without light, but for base_k.

    width_mm, height_mm : of the bead; 0: nothing melted   catch : share of the powder that became metal
    defocus_mm : height of the focus above the surface   unsupported : share of the pool with nothing beneath   base_k : temperature of the part
    """

    width_mm: Array
    height_mm: Array
    catch: Array
    defocus_mm: Array
    unsupported: Array
    base_k: Array


class Metal:
    """The stock under the machine; gets every trace of the World.

    build_from_table : (4, 4) float   Traces are in the table frame, the stock in the build frame.
    layer_of_line : (m,) int16   Layer by N-word, for the marks of what is laid; None: all is layer 0.
    engaged : cuts of the last trace that met metal   laid : beads of the last trace
    heat : (2,) float   Temperature of the part, K, and mass laid, g.   powder_g : powder that has left the nozzle
    """

    def __init__(self, stock: Stock, cell: Cell, build_from_table: Array) -> None:
        self.stock = stock
        self._rotation = np.ascontiguousarray(build_from_table[:3, :3], dtype=np.float64)
        self._shift = np.ascontiguousarray(build_from_table[:3, 3], dtype=np.float64)
        self._tools = {tool.number: tool for tool in cell.tools}
        self._laws = {tool.number: pool_law(stock.material, tool) for tool in cell.tools if tool.kind == "deposition"}
        self._head = min(self._laws)
        self._bead = np.zeros(cutting.OPEN_BEAD_SIZE)
        self._bead[cutting.POOL] = cutting.FIRST_MM_S
        self._cut = np.zeros(cutting.OPEN_CUT_SIZE)
        self._marks = np.zeros(0, dtype=np.int16)
        self._lines: NDArray[np.int16] | None = None
        self.heat = cold_state(self._laws[self._head].heat)
        self.powder_g = 0.0
        self.engaged: list[Engagement] = []
        self._last = np.zeros(bead.LAID_COLUMNS)
        self.laid = Laid(*np.zeros((bead.LAID_COLUMNS, 0)))

    @property
    def layer_of_line(self) -> NDArray[np.int16] | None:
        """(m,) int16   Layer by N-word; lines beyond it count as layer 0."""
        return self._lines

    @layer_of_line.setter
    def layer_of_line(self, layers: NDArray[np.int16] | None) -> None:
        """Beads are marked with these from now on."""
        self._lines = layers
        self._marks = np.zeros(0, dtype=np.int16) if layers is None else (np.maximum(np.asarray(layers), 0) + 1).astype(np.int16)

    @property
    def base_k(self) -> float:
        """Temperature of the part, K."""
        return float(self.heat[0])

    def lays(self, tool: int) -> bool:
        """Whether a tool is a deposition head."""
        return tool in self._laws

    def apply(self, trace: Trace) -> None:
        """Add and remove metal along the pieces of one trace; `engaged` and `laid` tell of it."""
        self.engaged = []
        tool = self._tools.get(trace.tool)
        seconds = float(trace.dt.sum())
        self.powder_g += float(trace.powder_g_min @ trace.dt) * G_PER_MIN
        if tool is not None and tool.kind == "deposition":
            self._end_cut()
            self._add(trace, tool, seconds)
            return
        self._end_bead()
        self._wait(trace, seconds)
        if tool is not None:
            self._remove(trace, tool)

    def finish(self) -> None:
        """Carry out what waits for more path."""
        self._end_bead()
        self._end_cut()

    def snapshot(self) -> dict[str, NDArray[np.generic]]:
        """The state of metal, heat and open pieces, to be given to `restore`."""
        own = {"heat": self.heat.copy(), "open_bead": self._bead.copy(), "open_cut": self._cut.copy(), "powder_g": np.array(self.powder_g)}
        own |= {"last_laid": self._last.copy(), "head": np.array(self._head)}
        return {**self.stock.snapshot(), **own}

    def restore(self, state: dict[str, NDArray[np.generic]]) -> None:
        """Go back to a snapshot. Raises ValueError when it is of another grid."""
        self.stock.restore(state)
        for array, name in ((self.heat, "heat"), (self._bead, "open_bead"), (self._cut, "open_cut"), (self._last, "last_laid")):
            array[:] = state[name]
        self._head = int(state["head"])
        self.powder_g = float(state["powder_g"])

    def _add(self, trace: Trace, tool: Tool, seconds: float) -> None:
        """Lay down the motion of a deposition head."""
        lit = trace.emission_w.max(initial=0.0) >= self.stock.material.bead.min_power_w
        if not lit and self._bead[cutting.IS_OPEN] == 0.0:
            self._bead[cutting.POOL] = cutting.FIRST_MM_S
            self._wait(trace, seconds)
            return
        piece_mm = max(self.stock.cell_mm, PIECE_SPOTS * tool.diameter_mm)
        way = float(np.sqrt(((trace.tip1 - trace.tip0) ** 2).sum(axis=1)).sum())
        out = np.empty((most_pieces(way, seconds, len(trace), piece_mm), bead.PIECE_COLUMNS))
        least_w = self.stock.material.bead.min_power_w
        count = bead_pieces(
            trace.tip0, trace.tip1, trace.axis1, trace.down, trace.emission_w, trace.powder_g_min, trace.dt, trace.line,
            self._rotation, self._shift, piece_mm, least_w, 0.5 * tool.diameter_mm, self._bead, out,
        )  # fmt: skip
        laid = self._lay(out[:count], tool.number)
        self.laid = Laid(*by_move(out[:count], laid, trace.emission_w, least_w, self._last, float(self.heat[0])).T)

    def _end_bead(self) -> None:
        if self._bead[cutting.IS_OPEN] == 1.0:
            out = np.empty((1, bead.PIECE_COLUMNS))
            self._lay(out[: end_bead(self._bead, out, 0, 0.5 * self._tools[self._head].diameter_mm)], self._head)
        self._bead[cutting.POOL] = cutting.FIRST_MM_S

    def _lay(self, rows: Array, tool: int) -> Array:
        """Lay down pieces of bead; what was laid, (n, LAID_COLUMNS)."""
        self._head = tool
        return deposit_pieces(self.stock, self._laws[tool], rows, self._marks, self.heat)

    def _wait(self, trace: Trace, seconds: float) -> None:
        """Let time without a pool go by."""
        law = self._laws[self._head]
        if seconds > 0.0:
            heat_step(law.heat, self.heat, law.melt.absorptivity * float(trace.emission_w @ trace.dt) / seconds, seconds)
        columns = np.full((bead.LAID_COLUMNS, len(trace)), np.nan)
        columns[bead.BASE_K] = self.heat[0]
        self.laid = Laid(*columns)

    def _remove(self, trace: Trace, tool: Tool) -> None:
        """Cut along the motion of a cutter."""
        out = np.empty((len(trace) + 1, cutting.CUT_COLUMNS))
        count = 0
        if self._cut[cutting.IS_OPEN_CUT] == 1.0 and self._cut[cutting.CUT_TOOL] != tool.number:
            self._end_cut()
        count = cut_pieces(
            trace.tip0, trace.tip1, trace.axis0, trace.axis1, trace.line, self._rotation, self._shift, tool.number, tool.diameter_mm,
            self._cut, out,
        )  # fmt: skip
        self._carry_out(out[:count])

    def _end_cut(self) -> None:
        if self._cut[cutting.IS_OPEN_CUT] == 1.0:
            out = np.empty((1, cutting.CUT_COLUMNS))
            self._carry_out(out[: end_cut(self._cut, out, 0)])

    def _carry_out(self, cuts: Array) -> None:
        """Cut pieces of one tool."""
        if not len(cuts):
            return
        tool = self._tools[int(cuts[0, cutting.CUT_TOOL])]
        path = cuts[:, : cutting.CUT_LINE]
        told = self.stock.cut_pieces(path, 0.5 * tool.diameter_mm, tool.corner_radius_mm, flutes_mm(tool), tool.number)
        for row, cut in zip(told, cuts, strict=True):
            if row[ENGAGED] > CONTACT_MM or row[GOUGE] > 0.0:
                at = row[GOUGE_AT : GOUGE_AT + 3] if row[GOUGE] > 0.0 else row[ENGAGED_AT : ENGAGED_AT + 3]
                line = int(cut[cutting.CUT_LINE])
                self.engaged.append(Engagement(line, float(row[ENGAGED]), float(row[GOUGE]), at.copy(), tool.number))


def flutes_mm(tool: Tool) -> float:
    """Length over which a cutter cuts: its flutes, or all that sticks out where the cell file does not say."""
    return tool.flute_length_mm or -tool.tip_mm[2]
