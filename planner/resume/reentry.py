"""Where and with what the machine goes on: in the middle of a pass, or at the begin of the next one; tool, mode and levels there."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from config.cell import Cell, Tool
from config.material import Material
from planner.errors import ResumeError
from planner.kinematics.chain import Floats
from planner.post.read_blocks import Reading
from planner.program import Channel, LineKind, Program
from planner.resume.stretch import HASTE, Stretch, Wanted, lit_lines, pass_lines, stretch_to

_DWELL = re.compile(r"G0?4\s*P(\d+\.?\d*|\.\d+)")


@dataclass(frozen=True)
class Reentry:
    """What the head of the resumed program has to bring about.

    line, fraction : where metal ended   target : (5,) joints at which the head is on the way   place : line whose row says what it belongs to
    stretch : what is run again; None: at the begin of a pass   rest : index of the first line that is run as it stands
    dwells : lines that wait between the layers, to be waited before all else   levels : channel -> value there
    """

    line: int
    fraction: float
    place: int
    target: Floats
    stretch: Stretch | None
    rest: int
    dwells: tuple[int, ...]
    tool: Tool
    spindle_rpm: float
    levels: dict[Channel, float]

    @property
    def is_deposit(self) -> bool:
        """Whether the laser works, not a cutter."""
        return self.tool.kind == "deposition"


@dataclass(frozen=True)
class Source:
    """What is resumed: the program, the cell fitted to its dialect, its text as read, and its powder (None: nothing is deposited)."""

    program: Program
    cell: Cell
    reading: Reading
    material: Material | None

    def usual_overlap_mm(self, tool: Tool, line: int) -> float:
        """One bead's width at the level and the speed of a line, as much less as axes cannot run it HASTE times as fast; of a cutter its radius."""
        if tool.kind != "deposition" or self.material is None:
            return 0.5 * tool.diameter_mm
        row, law = self.program.table[line], self.material.bead
        arc_mm = max(float(row["arc_end_mm"] - row["arc_start_mm"]), 1e-6)
        speed = arc_mm / max(float(self.reading.time_s[line]), 1e-6)
        power = _levels(self.program, line).get(Channel.LASER_W, 0.0)
        width = float(law.width_coefficient * power**law.width_power_exponent * speed**law.width_speed_exponent)
        per_mm = np.maximum(np.abs(self.reading.joints[line + 1] - self.reading.joints[line]) / arc_mm, 1e-9)
        fastest = float(np.min(np.array([axis.max_velocity for axis in self.cell.axes]) / per_mm))
        gain = float(np.min(np.array([axis.max_acceleration for axis in self.cell.axes]) / per_mm))
        peak = min(
            fastest, float(np.hypot(speed, np.sqrt(gain * width)))
        )  # speeds up over one half, brakes over the other
        share = 1.0 if peak >= HASTE * speed else 0.5 * (1.0 + peak / speed) / HASTE
        return width * min(1.0, share)


def reentry_at(source: Source, at: tuple[int, float], wanted: Wanted) -> Reentry:
    """Where a Program goes on that ended at a share of a line.

    Raises ResumeError: nothing is left, no such tool, a NURBS block.
    """
    program, cell, reading = source.program, source.cell, source.reading
    lit = lit_lines(program, reading)
    inside = _inside(program, cell, reading, lit, at)
    if inside is not None:
        tool = _tool(program, cell, reading, inside[0])
        overlap_mm = source.usual_overlap_mm(tool, inside[0]) if wanted.overlap_mm is None else wanted.overlap_mm
        stretch = stretch_to(program, reading, lit, inside, wanted, overlap_mm)
        levels = _levels(program, inside[0])
        rpm = float(reading.spindle_rpm[inside[0]])
        return Reentry(*at, inside[0], stretch.joints[0], stretch, stretch.rest, (), tool, rpm, levels)
    first = _next_pass(program, reading, at)
    before = _begin_of_links(program, reading, first, at[0])
    tool = _tool(program, cell, reading, first)
    dwells = np.flatnonzero(program.table["kind"][: first + 1] == LineKind.DWELL)
    waits = tuple(int(line) for line in dwells[dwells >= at[0]] if _DWELL.search(program.lines[line]))
    return Reentry(
        *at, first, reading.joints[before + 1], None, before + 1, tuple(line for line in waits if line <= before), tool,
        float(reading.spindle_rpm[first]), _levels(program, before + 1, first),
    )  # fmt: skip


def _tool(program: Program, cell: Cell, reading: Reading, line: int) -> Tool:
    number = int(reading.tool[line])
    for tool in cell.tools:
        if tool.number == number:
            return tool
    there = ", ".join(f"T{tool.number}" for tool in cell.tools)
    raise ResumeError(
        f"line {line} needs tool T{number}, the cell {cell.name} has {there}",
        "add it to [[tools]] of the cell file as it was",
    )


def _inside(
    program: Program, cell: Cell, reading: Reading, lit: NDArray[np.bool_], at: tuple[int, float]
) -> tuple[int, float] | None:
    """Line and share at which a pass that has begun and is not finished goes on; None: the next one begins."""
    line, share = at
    table = program.table
    if table["kind"][line] != LineKind.PROCESS or table["pass_"][line] < 0:
        return None
    first, end = pass_lines(program, line)
    ahead = np.flatnonzero(reading.is_motion[line:end])
    if not ahead.size:
        return None
    if ahead[0] > 0:
        line, share = line + int(ahead[0]), 0.0
    if _tool(program, cell, reading, line).kind != "deposition":
        has_begun = share > 0.0 or bool(reading.is_motion[first:line].any())
        return (line, share) if has_begun else None
    if not lit[first:line].any() and not (lit[line] and share > 0.0):
        return None
    if lit[line]:
        return line, share
    ahead = np.flatnonzero(lit[line:end])
    return (line + int(ahead[0]), 0.0) if ahead.size else None


def _next_pass(program: Program, reading: Reading, at: tuple[int, float]) -> int:
    """First moving line of the next pass that does something; of the one that a line belongs to if none of it is done."""
    table = program.table
    does = (table["kind"] == LineKind.PROCESS) & (table["pass_"] >= 0) & reading.is_motion
    line = at[0]
    if table["kind"][line] == LineKind.PROCESS and table["pass_"][line] >= 0:
        first, end = pass_lines(program, line)
        line = end if _is_done(program, reading, line, first) else first
    ahead = np.flatnonzero(does[line:])
    if not ahead.size:
        raise ResumeError(
            "nothing is left to be made: the last pass is done there", "choose a layer or an operation to make again"
        )
    return line + int(ahead[0])


def _is_done(program: Program, reading: Reading, line: int, first: int) -> bool:
    """Whether the light of a pass lies behind a line of it, or a cutter has come to its end."""
    lit = lit_lines(program, reading)[first : line + 1]
    return bool(lit.any()) or not bool(reading.is_motion[line : pass_lines(program, line)[1]].any())


def _begin_of_links(program: Program, reading: Reading, first: int, since: int) -> int:
    """Line at whose end the machine is highest on the links that lead to a pass; the line before the pass where none does."""
    table = program.table
    begin = first
    while begin > 0 and _leads(program, begin - 1, first):
        begin -= 1
    rows = np.arange(begin, first)
    rows = rows[reading.is_motion[rows] & np.isfinite(reading.joints[rows + 1]).all(axis=1)]
    if not rows.size:
        return first - 1
    heights = np.einsum("ij,ij->i", table["tip_end"][rows], np.broadcast_to(table["axis_end"][first], (len(rows), 3)))
    return int(rows[np.flatnonzero(heights > heights.max() - SAME_HEIGHT_MM)[-1]])


SAME_HEIGHT_MM = 0.01
"""Of links: what rounding makes of one height."""


def _leads(program: Program, line: int, first: int) -> bool:
    """Whether a line is a link, or a comment among links."""
    row, text = program.table[line], program.lines[line]
    return bool(row["kind"] == LineKind.LINK) or (row["kind"] == LineKind.SETUP and "(" in text)


def _levels(program: Program, line: int, upto: int | None = None) -> dict[Channel, float]:
    """Value of each channel when a line begins; without gas and powder that the lines up to another one set anyway."""
    schedule = program.schedule
    found: dict[Channel, float] = {}
    for channel in (
        Channel.MODE,
        Channel.LASER_W,
        Channel.CARRIER_GAS_L_MIN,
        Channel.SHIELD_GAS_L_MIN,
        Channel.POWDER_G_MIN,
    ):
        of_channel = schedule[schedule["channel"] == channel]
        before = of_channel[of_channel["n"] <= line + 1] if upto is None else of_channel[of_channel["n"] < line + 1]
        later = upto is not None and bool(((of_channel["n"] > line) & (of_channel["n"] <= upto + 1)).any())
        if before.size and not later:
            found[channel] = float(before["value"][-1])
    return found
