"""What can be said of a Program without running it: work offset, lengths of lines, its schedule, and travel of its targets."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from config import Axis, Cell
from sim import job as facts
from sim.cnc.actions import Move
from sim.cnc.codes import GcodeError
from sim.cnc.interpreter import Interpreter
from sim.cnc.machine import LIMIT_EPS
from sim.cnc.parser import strip_line, words_of
from sim.findings import Findings
from sim.job import Job

OFFSET_TOLERANCE = 1e-3  # mm or deg
CHANNELS = (facts.MODE, facts.LASER_W, facts.POWDER_G_MIN, facts.CARRIER_GAS_L_MIN, facts.SHIELD_GAS_L_MIN, facts.EMISSION)


def check(program: Job, cell: Cell, line_length_max: int, findings: Findings) -> None:
    """Everything but travel. line_length_max : characters that the firmware takes"""
    _check_offset(program, cell, findings)
    longest = min(line_length_max, cell.cnc.line_length_max)
    for index, line in enumerate(program.lines):
        if len(line) > longest:
            text = f"{len(line)} characters, the firmware takes {longest}: {len(line) - longest} too many"
            findings.add("line length", text, index + 1, rank=float(len(line)))
    _check_schedule(program, findings)
    if cell.machine is None:
        findings.add("unchecked", "the cell states no bodies of its machine: collisions were not looked for", 0, severity="warning")


def _check_offset(program: Job, cell: Cell, findings: Findings) -> None:
    offset = np.array([cell.placement.work_offset.get(letter, 0.0) for letter in cell.letters])
    apart = np.abs(offset - program.work_offset)
    worst = int(np.argmax(apart))
    if apart[worst] > OFFSET_TOLERANCE:
        text = (
            f"the controller's G54 is {offset.tolist()}, the Program was posted for {program.work_offset.tolist()}: "
            f"{cell.letters[worst]} is {apart[worst]:.3f} off"
        )
        findings.add("work offset", text, 0, depth_mm=float(apart[worst]) if cell.axes[worst].kind == "linear" else 0.0)


def _check_schedule(program: Job, findings: Findings) -> None:
    """Entries that nobody would carry out."""
    for row in program.schedule:
        channel, line = int(row["channel"]), int(row["n"])
        if channel not in CHANNELS:
            findings.add("schedule", f"an entry sets channel {channel}, which no device has", line)
        elif channel == facts.MODE and not row["barrier"]:
            findings.add("schedule", "a change of mode is no barrier: nothing would wait for it", line)
        elif not 1 <= line <= len(program.lines):
            findings.add("schedule", f"an entry belongs to line N{line}, which the Program does not have", line)


@dataclass(frozen=True)
class Beyond:
    """A target outside the travel of an axis. `by` is how far, mm or deg; target in machine coordinates, order of the axes."""

    line: int
    axis: Axis
    by: float
    target: tuple[float, ...]
    tool: int

    @property
    def text(self) -> str:
        """One sentence with the figures."""
        unit = "mm" if self.axis.kind == "linear" else "deg"
        letter, end = self.axis.letter, self.axis.max if self.by > 0.0 else self.axis.min
        return f"{letter} would have to go to {end + self.by:.3f} {unit}, its travel ends at {end:g}: {abs(self.by):.3f} {unit} beyond"


def beyond(axes: Sequence[Axis], target: Sequence[float]) -> tuple[Axis, float] | None:
    """The axis that a target leaves farthest, as a share of its travel, and by how much (signed), mm or deg; None: inside."""
    worst: tuple[float, Axis, float] | None = None
    for axis, value in zip(axes, target, strict=True):
        by = value - axis.max if value > axis.max + LIMIT_EPS else value - axis.min if value < axis.min - LIMIT_EPS else 0.0
        share = abs(by) / (axis.max - axis.min)
        if by and (worst is None or share > worst[0]):
            worst = share, axis, by
    return None if worst is None else (worst[1], worst[2])


def targets_beyond_travel(lines: Sequence[str], cell: Cell) -> Iterator[Beyond]:
    """Every target that leaves the travel. Lines that the firmware would refuse are passed over: they are found by running it."""
    letters = cell.letters
    interpreter = Interpreter(
        cell.axes,
        [cell.placement.work_offset.get(letter, 0.0) for letter in letters],
        [axis.home for axis in cell.axes],
        max(tool.max_rpm for tool in cell.tools),
    )
    interpreter.tools = frozenset(tool.number for tool in cell.tools)
    interpreter.modal.tool_selected = cell.tools[0].number
    for number, line in enumerate(lines, 1):
        try:
            actions = interpreter.interpret(words_of(strip_line(line)))
        except GcodeError:
            continue
        for action in actions:
            if isinstance(action, Move):
                found = beyond(cell.axes, action.target)
                if found is not None:
                    yield Beyond(number, *found, action.target, interpreter.modal.tool_selected)
