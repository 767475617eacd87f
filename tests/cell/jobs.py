"""Small Programs made by hand: what a post would write for a wall of a few beads on the shipped trunnion cell."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from config.cell import Cell
from planner.program import LINE_DTYPE, SCHEDULE_DTYPE, Channel, LineKind, Program

POWER_W = 800.0
POWDER_G_MIN = 10.0
FEED_MM_S = 10.0
CLEARANCE_MM = 20.0


@dataclass
class Writer:
    """Writes lines and the table row of each. Joints follow from tip and tool with the table at A0 C0."""

    cell: Cell
    lines: list[str] = field(default_factory=list)
    rows: list[tuple[object, ...]] = field(default_factory=list)
    schedule: list[tuple[int, int, int, float]] = field(default_factory=list)
    tip: np.ndarray = field(default_factory=lambda: np.array([60.0, 0.0, 580.0]))
    time_s: float = 0.0
    layer: int = -1
    operation: int = -1
    tool: int = 1

    def joints(self) -> np.ndarray:
        offset = next(tool.tip_mm for tool in self.cell.tools if tool.number == self.tool)
        origin = np.array(self.cell.placement.part_origin_mm)
        return np.concatenate([self.tip + origin - np.array(offset), [0.0, 0.0]])

    def line(self, text: str, kind: LineKind, seconds: float = 0.0) -> int:
        """Append; the line's N-word."""
        n = len(self.lines) + 1
        self.lines.append(f"N{n} {text}")
        start, self.time_s = self.time_s, self.time_s + seconds
        row = (
            n,
            kind,
            self.layer,
            self.operation,
            0,
            0.0,
            0.0,
            start,
            self.time_s,
            tuple(self.tip),
            (0.0, 0.0, 1.0),
            tuple(self.joints()),
            0.0,
        )
        self.rows.append(row)
        return n

    def at(self, n: int, channel: Channel, value: float, *, barrier: bool = False) -> None:
        """Put an entry of the schedule on line n."""
        self.schedule.append((n, channel, int(barrier), value))

    def move(self, x: float, y: float, z: float, kind: LineKind, feed_mm_s: float) -> int:
        """Straight line of the tip in the build frame."""
        goal = np.array([x, y, z])
        seconds = max(float(np.linalg.norm(goal - self.tip)) / feed_mm_s, 0.01)
        self.tip = goal
        words = self.joints()
        for k, letter in enumerate(self.cell.letters):
            words[k] -= self.cell.placement.work_offset.get(letter, 0.0)
        text = " ".join(f"{letter}{value:.4f}" for letter, value in zip("XYZ", words[:3], strict=True))
        return self.line(f"G1 {text} F{60.0 / seconds:.4f}", kind, seconds)

    def program(self, name: str, layer_starts: list[int]) -> Program:
        """All of it."""
        cell = self.cell
        table = np.array(self.rows, dtype=LINE_DTYPE)
        order = sorted(range(len(self.schedule)), key=lambda k: (self.schedule[k][0], k))
        schedule = np.array([self.schedule[k] for k in order], dtype=SCHEDULE_DTYPE)
        frame = np.eye(4)
        frame[:3, 3] = cell.placement.part_origin_mm
        offset = np.array([cell.placement.work_offset.get(letter, 0.0) for letter in cell.letters])
        gate = "stream" if cell.cnc.laser_gate_output is not None else "modbus"
        return Program(
            name, cell.name, "grblhal", "0" * 64, "0" * 64, cell.sha256, 0.5, "hybrid", "316L", tuple(self.lines), table, schedule,
            np.array([*layer_starts, len(self.lines)], dtype=np.int64), cell.letters, frame, np.eye(4), offset, gate, (1, 2), self.time_s,
        )  # fmt: skip


def one_wall(
    cell: Cell, *, layers: int = 2, length_mm: float = 40.0, pieces: int = 10, dwell_s: float = 0.0, mill: bool = True
) -> Program:
    """`layers` beads over one another, each of `pieces` lines; dwell between them; then one milling pass with tool 2."""
    w = Writer(cell)
    starts = []
    w.line("G21 G90 G17 G49 G54 G93", LineKind.SETUP)
    w.line("M6 T1", LineKind.TOOL)
    for layer in range(layers):
        w.layer, w.operation = layer, layer
        starts.append(len(w.lines))
        bead(w, layer * 1.0, length_mm, pieces, first=layer == 0)
        if dwell_s:
            w.line(f"G4 P{dwell_s:g}", LineKind.DWELL, dwell_s)
    if mill:
        mill_pass(w, layers, length_mm)
    end = w.line("M2", LineKind.SETUP)
    w.at(end, Channel.MODE, 0, barrier=True)
    return w.program("one_wall", starts)


def bead(w: Writer, z: float, length: float, pieces: int, *, first: bool) -> None:
    """To the clearance, approach, gate open, the pass, gate shut, away."""
    stream = w.cell.cnc.laser_gate_output is not None
    n = w.move(-length / 2 - 5.0, 0.0, z + CLEARANCE_MM, LineKind.LINK, 190.0)
    if first:
        w.at(n, Channel.MODE, 1, barrier=True)
        w.at(n, Channel.CARRIER_GAS_L_MIN, 5.0, barrier=True)
        w.at(n, Channel.SHIELD_GAS_L_MIN, 15.0, barrier=True)
    n = w.move(-length / 2 - 5.0, 0.0, z, LineKind.LINK, 40.0)
    w.at(n, Channel.POWDER_G_MIN, POWDER_G_MIN, barrier=True)
    n = w.move(-length / 2, 0.0, z, LineKind.LINK, FEED_MM_S)
    w.at(n, Channel.LASER_W, POWER_W)
    if stream:
        w.line(f"M62 P{w.cell.cnc.laser_gate_output}", LineKind.PROCESS)
    for k in range(pieces):
        n = w.move(-length / 2 + length * (k + 1) / pieces, 0.0, z, LineKind.PROCESS, FEED_MM_S)
        if k == 0 and not stream:
            w.at(n, Channel.EMISSION, 1)
    if stream:
        w.line(f"M63 P{w.cell.cnc.laser_gate_output}", LineKind.LINK)
    n = w.move(length / 2 + 5.0, 0.0, z, LineKind.LINK, FEED_MM_S)
    if not stream:
        w.at(n, Channel.EMISSION, 0)
    w.move(length / 2 + 5.0, 0.0, z + CLEARANCE_MM, LineKind.LINK, 40.0)


def mill_pass(w: Writer, layers: int, length: float) -> None:
    """The guarded change to tool 2 and one pass over the top."""
    w.operation += 1
    n = w.line("M6 T2", LineKind.TOOL)
    w.at(n, Channel.MODE, 2, barrier=True)
    w.tool = 2
    w.line("M3 S6000", LineKind.SETUP)
    w.move(-length / 2 - 10.0, 0.0, layers + CLEARANCE_MM, LineKind.LINK, 60.0)
    w.move(-length / 2 - 10.0, 0.0, layers, LineKind.LINK, 20.0)
    w.move(length / 2 + 10.0, 0.0, layers, LineKind.PROCESS, 15.0)
    w.move(length / 2 + 10.0, 0.0, layers + CLEARANCE_MM, LineKind.LINK, 40.0)
    w.line("M5", LineKind.SETUP)


def for_another_cell(program: Program) -> Program:
    """The same Program, as if it had been posted for another cell."""
    return replace(program, cell_sha256="f" * 64, cell_name="another")


def before_a_change(program: Program) -> Program:
    """The same Program, as if the cell had been changed or measured anew since it was posted."""
    return replace(program, cell_sha256="f" * 64)
