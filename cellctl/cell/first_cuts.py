"""Where a Program first moves behind a spindle that it set going: there the stream stops until tool, datum and speed are checked."""

from __future__ import annotations

import re
from bisect import bisect_right

import numpy as np

from planner.program import LineKind, Program

COMMENT = re.compile(r"\([^)]*\)|;.*")
SPINDLE_ON = re.compile(r"\bM0?[34](?!\d)")
SPINDLE_OFF = re.compile(r"\bM0?[56](?!\d)")  # a changer stops the spindle
SPEED = re.compile(r"S(\d+(?:\.\d*)?)")
COMMANDS = (LineKind.SETUP, LineKind.TOOL)
STANDING = (*COMMANDS, LineKind.DWELL)
LOOK_LINES = 256  # at a time: a move follows its spindle within a few lines


def spindle_speeds(program: Program) -> list[tuple[int, float]]:
    """(index of a line, rpm from there on) for every line that sets the spindle going or stops it (0), in their order."""
    found: list[tuple[int, float]] = []
    asked = 0.0
    for index in np.flatnonzero(np.isin(program.table["kind"], COMMANDS)):
        text = COMMENT.sub("", program.lines[int(index)])
        speed = SPEED.search(text)
        asked = float(speed.group(1)) if speed is not None else asked
        if SPINDLE_ON.search(text):
            found.append((int(index), asked))
        elif SPINDLE_OFF.search(text):
            found.append((int(index), 0.0))
    return found


def first_cuts(program: Program, speeds: list[tuple[int, float]]) -> dict[int, float]:
    """N-word (from 1) of the first move behind each line that sets the spindle going -> its speed (rpm)."""
    found: dict[int, float] = {}
    for index, rpm in speeds:
        place = _next_move(program, index) if rpm > 0.0 else None
        if place is not None:
            found[place + 1] = rpm
    return found


def _next_move(program: Program, index: int) -> int | None:
    """Index of the first line from `index` on that moves, None behind the last one; looks no farther than it has to."""
    kinds = program.table["kind"]
    for start in range(index, len(kinds), LOOK_LINES):
        moves = ~np.isin(kinds[start : start + LOOK_LINES], STANDING)
        if moves.any():
            return start + int(moves.argmax())
    return None


def speed_at(speeds: list[tuple[int, float]], index: int) -> float:
    """Speed (rpm) that holds for line `index`; 0 where the spindle stands."""
    place = bisect_right(speeds, index, key=lambda entry: entry[0])
    return speeds[place - 1][1] if place > 0 else 0.0
