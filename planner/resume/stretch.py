"""What is run again before the place where metal ended: lead-in and overlap along the pass, and the rest of the line that was cut short."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.errors import ResumeError
from planner.kinematics.chain import Floats
from planner.post.read_blocks import Reading
from planner.program import Channel, LineKind, Program

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

HASTE = 3.0
"""Times the speed of the pass on the overlap: there a bead lies already, and so fast it is molten once more with a third of the powder."""
SNAP_MM = 0.02
"""Places along a pass nearer than this are one: no line is made so short."""


@dataclass(frozen=True)
class Wanted:
    """Lengths along a pass, mm.  overlap, lead_in : before metal's end   None: the usual one   ramp_steps : lines that the overlap is cut into"""

    overlap_mm: float | None
    lead_in_mm: float
    ramp_steps: int


@dataclass(frozen=True)
class Stretch:
    """Pieces of lines that are written anew.

    line, begin, end : (m,) the original's line and the shares of it where each piece begins and ends
    joints : (m + 1, 5) float, machine coordinates   bulge, time_s : (m,) float   arc_mm : (m, 2) float, along the pass
    is_lit : (m,) bool, with the laser on   overlap : (m, 2) float, share of the overlap done at begin and end, 1 behind it
    rest : index of the original's line that comes next   overlap_mm : run again with the laser on, or cut again   lead_in_mm : run dark
    """

    line: Ints
    begin: Floats
    end: Floats
    joints: Floats
    bulge: Floats
    time_s: Floats
    arc_mm: Floats
    is_lit: Bools
    overlap: Floats
    rest: int
    overlap_mm: float
    lead_in_mm: float

    @property
    def speed_mm_s(self) -> float:
        """Of the tip at the begin."""
        return float((self.arc_mm[0, 1] - self.arc_mm[0, 0]) / max(self.time_s[0], 1e-6))


def lit_lines(program: Program, reading: Reading) -> Bools:
    """(n,) bool: moves with the laser's gate open, by the text or by the schedule."""
    if program.gate == "stream":
        return np.asarray(reading.gate & reading.is_motion)
    entries = program.schedule[program.schedule["channel"] == Channel.EMISSION]
    place = np.searchsorted(entries["n"], np.arange(1, len(program.lines) + 1), side="right")
    return np.asarray((np.append(0.0, entries["value"])[place] > 0.0) & reading.is_motion)


def pass_lines(program: Program, line: int) -> tuple[int, int]:
    """First line of the pass that a line belongs to, and one past its last: neighbours of the same operation and pass that do process."""
    table = program.table
    same = (
        (table["operation"] == table["operation"][line])
        & (table["pass_"] == table["pass_"][line])
        & (table["kind"] == LineKind.PROCESS)
    )
    other = np.flatnonzero(~same)
    below, above = other[other < line], other[other > line]
    return (int(below[-1]) + 1 if below.size else 0), (int(above[0]) if above.size else len(table))


def stretch_to(
    program: Program, reading: Reading, lit: Bools, at: tuple[int, float], wanted: Wanted, overlap_mm: float
) -> Stretch:
    """The stretch that ends with a line of a pass, metal having ended at a share of that line.

    at : line that moves, and the share of it that is done   overlap_mm : of this pass   lit : (n,) bool, all False where a cutter works
    Raises ResumeError inside a NURBS block.
    """
    first, _ = pass_lines(program, at[0])
    rows = np.arange(first, at[0] + 1)
    table = program.table
    length = table["arc_end_mm"][rows] - table["arc_start_mm"][rows]
    rows = rows[reading.is_motion[rows] & (length > 0.0)]
    if not rows.size or rows[-1] != at[0]:
        raise ResumeError(
            f"line {at[0]}: no way along the pass belongs to it", "resume from the begin of its operation"
        )
    if np.isin(rows, reading.splines.lines).any():
        raise ResumeError(
            f"line {at[0]} stands in a NURBS block, which cannot be cut in two",
            "resume from the begin of its operation",
        )
    way = np.append(0.0, np.cumsum(table["arc_end_mm"][rows] - table["arc_start_mm"][rows]))
    done = float(way[-2] + at[1] * (way[-1] - way[-2]))
    is_lit = lit[rows]
    lights = bool(is_lit[-1])
    dark = np.flatnonzero(~is_lit)
    since = float(way[dark[-1] + 1]) if lights and dark.size else 0.0  # the laser has been on from here
    again = max(since, done - overlap_mm)
    begin = max(0.0, again - (wanted.lead_in_mm if lights else 0.0))
    marks = _snapped([begin, again, done], way)
    return _pieces(program, reading, rows, way, marks, lights, wanted.ramp_steps if lights else 1)


def _snapped(marks: list[float], way: Floats) -> tuple[float, float, float]:
    """Begin, begin of the overlap, end of metal: on the ends of lines and on each other where they are as near."""
    found: list[float] = []
    for mark in marks:
        near = float(way[np.argmin(np.abs(way - mark))])
        mark = near if abs(near - mark) < SNAP_MM else mark
        found.append(found[-1] if found and abs(found[-1] - mark) < SNAP_MM else mark)
    return found[0], found[1], found[2]


def _pieces(
    program: Program,
    reading: Reading,
    rows: Ints,
    way: Floats,
    marks: tuple[float, float, float],
    lights: bool,
    steps: int,
) -> Stretch:
    begin, again, done = marks
    ramp = np.linspace(again, done, steps + 1) if done - again > 2.0 * steps * SNAP_MM else np.array([again, done])
    near = way[np.abs(ramp[:, None] - way[None, :]).argmin(axis=1)]
    ramp = np.where(np.abs(near - ramp) < SNAP_MM, near, ramp)
    cuts = np.unique(np.concatenate([[begin], ramp, way[way > begin]]))
    middle = 0.5 * (cuts[1:] + cuts[:-1])
    of = np.searchsorted(way, middle, side="right") - 1
    span = np.diff(way)[of]
    share = np.clip(np.column_stack([(cuts[:-1] - way[of]) / span, (cuts[1:] - way[of]) / span]), 0.0, 1.0)
    lines = rows[of]
    joints = np.vstack([_at(reading, lines[:1], share[:1, 0]), _at(reading, lines, share[:, 1])])
    table = program.table
    start, length = table["arc_start_mm"][lines], table["arc_end_mm"][lines] - table["arc_start_mm"][lines]
    part = share[:, 1] - share[:, 0]
    bulge = np.tan(np.arctan(_bulges(reading, lines)) * part)
    overlap = np.ones((len(lines), 2))
    if done > again:
        overlap = np.clip((np.column_stack([cuts[:-1], cuts[1:]]) - again) / (done - again), 0.0, 1.0)
        overlap[middle < again] = 1.0
    return Stretch(
        lines, share[:, 0], share[:, 1], joints, bulge, reading.time_s[lines] * part, start[:, None] + share * length[:, None],
        np.asarray(lights & (middle > again)), overlap, int(rows[-1]) + 1,
        done - again, again - begin,
    )  # fmt: skip


def _at(reading: Reading, lines: Ints, shares: Floats) -> Floats:
    """(k, 5) joints at a share of each line."""
    return np.vstack([reading.at(lines[k : k + 1], float(shares[k])) for k in range(len(lines))])


def _bulges(reading: Reading, lines: Ints) -> Floats:
    """(k,) float: tan(sweep / 4) of the lines, 0 where they are straight."""
    arcs = reading.arcs
    result = np.zeros(len(lines))
    if len(arcs.lines):
        place = np.searchsorted(arcs.lines, lines).clip(0, len(arcs.lines) - 1)
        bent = arcs.lines[place] == lines
        result[bent] = np.tan(0.25 * arcs.sweep[place[bent]])
    return result
