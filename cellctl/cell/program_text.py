"""What the words of a Program's text say: where the gate is open, which tool is mounted where."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from planner.program import Channel, LineKind, Program

GATE_WORD = re.compile(r"M6([23])\s*P(\d+)")
COMMENT = re.compile(r"\([^)]*\)|;.*")
TOOL_WORD = re.compile(r"T(\d+)")


def gate_of_lines(program: Program) -> NDArray[np.bool_]:
    """(n,) bool: whether the gate is open on each line, by M62/M63 in the text or by EMISSION in the schedule.

    M62 and M63 act with the next motion, so from their own line on.
    """
    size = len(program.lines)
    marks: list[tuple[int, bool]] = []
    if program.gate == "stream":
        for index, line in enumerate(program.lines):
            if "M6" in line and (found := GATE_WORD.search(COMMENT.sub("", line))):
                marks.append((index, found.group(1) == "2"))
    else:
        rows = program.schedule[program.schedule["channel"] == Channel.EMISSION]
        marks = [(int(row["n"]) - 1, bool(row["value"])) for row in rows]
    gate = np.zeros(size, dtype=np.bool_)
    ends = [*(start for start, _ in marks[1:]), size]
    for (start, is_open), end in zip(marks, ends, strict=False):  # a Program without a word of the gate has one end and no mark
        gate[start:end] = is_open
    return gate


def mounted_tools(program: Program) -> list[tuple[int, int]]:
    """(line index, tool number) of every tool change."""
    lines = np.flatnonzero(program.table["kind"] == LineKind.TOOL)
    found = ((int(i), TOOL_WORD.search(COMMENT.sub("", program.lines[int(i)]))) for i in lines)
    return [(i, int(word.group(1))) for i, word in found if word]
