"""Where light began and ended at the plant, against where the Program has it: edges of passes in rows, from the plant's own trace."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell
from planner.program import Channel, LineKind, Program
from sim.trace import Trace
from tests.cell.jobs import CLEARANCE_MM, POWDER_G_MIN, POWER_W, Writer

LEAD_MM = 4.0  # before and behind each pass, at its feed
ROW_MM = 3.0
SPREAD_MM = 3.0  # rows differ in length by up to this, so that their edges fall anywhere between two reports


def rows_program(
    cell: Cell, *, rows: int, feed_mm_s: float, length_mm: float = 14.0, piece_mm: float = 2.0, dwell_s: float = 0.0, seed: int = 3
) -> Program:
    """Straight passes of one layer, to and fro, each with a lead at feed on either side and a way round a corner between them."""
    w, random = Writer(cell), np.random.default_rng(seed)
    stream = cell.cnc.laser_gate_output is not None
    w.line("G21 G90 G17 G49 G54 G93", LineKind.SETUP)
    w.line("M6 T1", LineKind.TOOL)
    w.layer = w.operation = 0
    first = len(w.lines)
    n = w.move(-length_mm / 2 - LEAD_MM, 0.0, CLEARANCE_MM, LineKind.LINK, 60.0)
    for channel, value in ((Channel.MODE, 1), (Channel.CARRIER_GAS_L_MIN, 5.0), (Channel.SHIELD_GAS_L_MIN, 15.0)):
        w.at(n, channel, value, barrier=True)
    n = w.move(-length_mm / 2 - LEAD_MM, 0.0, 0.0, LineKind.LINK, 40.0)
    w.at(n, Channel.POWDER_G_MIN, POWDER_G_MIN, barrier=True)
    for row in range(rows):
        way = 1.0 if row % 2 == 0 else -1.0
        begin, end = np.array([-way, way]) * length_mm / 2 + random.uniform(0.0, SPREAD_MM, 2) * [way, -way]
        y = row * ROW_MM
        n = w.move(begin - way * LEAD_MM, y, 0.0, LineKind.LINK, 40.0)
        if dwell_s and row:
            w.line(f"G4 P{dwell_s:g}", LineKind.DWELL, dwell_s)
        n = w.move(begin, y, 0.0, LineKind.LINK, feed_mm_s)
        w.at(n, Channel.LASER_W, POWER_W)
        if stream:
            w.line(f"M62 P{cell.cnc.laser_gate_output}", LineKind.PROCESS)
        pieces = max(round(abs(end - begin) / piece_mm), 1)
        for k in range(pieces):
            n = w.move(begin + (end - begin) * (k + 1) / pieces, y, 0.0, LineKind.PROCESS, feed_mm_s)
            if k == 0 and not stream:
                w.at(n, Channel.EMISSION, 1)
        if stream:
            w.line(f"M63 P{cell.cnc.laser_gate_output}", LineKind.LINK)
        n = w.move(end + way * LEAD_MM, y, 0.0, LineKind.LINK, feed_mm_s)
        if not stream:
            w.at(n, Channel.EMISSION, 0)
    w.move(w.tip[0], w.tip[1], CLEARANCE_MM, LineKind.LINK, 40.0)
    n = w.line("M2", LineKind.SETUP)
    w.at(n, Channel.MODE, 0, barrier=True)
    return w.program("rows", [first])


@dataclass
class Light:
    """Takes the plant's traces in and finds the edges of light, with the time of each.

    origin_mm : (3,) of the build frame in the table frame
    """

    origin_mm: tuple[float, float, float]
    edges: list[tuple[bool, float, tuple[float, float, float]]] = field(default_factory=list)  # on or off, time, place
    gate: Callable[[], NDArray[np.float64]] | None = None  # (k,) the wired gate over the pieces that come next, 1 open
    gate_edges: list[tuple[bool, float, tuple[float, float, float]]] = field(default_factory=list)  # of the gate itself, without the laser's ramp
    moving: list[tuple[float, float, float, float]] = field(default_factory=list)  # time, speed, emission, powder; of pieces with light
    time_s: float = 0.0
    _before_w: float = 0.0
    _was_open: bool = False

    def apply(self, trace: Trace) -> None:
        """Pieces of a step of the world, in order."""
        half = 0.5 * POWER_W
        self._see_gate(trace)
        for k in range(len(trace.dt)):
            dt, now_w = float(trace.dt[k]), float(trace.emission_w[k])
            if (now_w >= half) != (self._before_w >= half) and dt > 0.0:
                place = 0.5 * (trace.tip0[k] + trace.tip1[k]) - np.array(self.origin_mm)
                self.edges.append((now_w >= half, self.time_s + 0.5 * dt, (float(place[0]), float(place[1]), float(place[2]))))
            if dt > 0.0 and now_w > 1.0:
                speed = float(np.linalg.norm(trace.tip1[k] - trace.tip0[k])) / dt
                self.moving.append((self.time_s, speed, now_w, float(trace.powder_g_min[k])))
            self._before_w = now_w
            self.time_s += dt


    def _see_gate(self, trace: Trace) -> None:
        gate = self.gate() if self.gate is not None else ()
        for k, value in enumerate(gate):
            if (value > 0.5) != self._was_open:
                self._was_open = bool(value > 0.5)
                place = trace.tip0[k] - np.array(self.origin_mm)
                self.gate_edges.append((self._was_open, self.time_s, (float(place[0]), float(place[1]), float(place[2]))))


def edge_errors_mm(program: Program, light: Light, *, of_gate: bool = False) -> tuple[list[float], list[float]]:
    """(on, off) along the pass, late is positive: each edge at the plant against the nearest one of the Program that is of its kind.

    of_gate : edges of the wired gate itself, not of the light behind it
    """
    table = program.table
    tips = table["tip_end"]
    process = np.flatnonzero((table["kind"] == LineKind.PROCESS) & (np.linalg.norm(np.diff(tips, axis=0, prepend=tips[:1]), axis=1) > 1e-6))
    breaks = np.flatnonzero(np.diff(process) > 1)
    firsts, lasts = process[np.append(0, breaks + 1)], process[np.append(breaks, len(process) - 1)]
    begins, ends = tips[firsts - 1], tips[lasts]
    along = (ends - begins) / np.linalg.norm(ends - begins, axis=1)[:, None]
    on: list[float] = []
    off: list[float] = []
    for is_on, _, place in light.gate_edges if of_gate else light.edges:
        row = int(np.argmin(np.abs(begins[:, 1] - place[1])))
        (on if is_on else off).append(float((np.array(place) - (begins if is_on else ends)[row]) @ along[row]))
    return on, off
