"""Where a Program first moves behind a spindle that it set going: there the stream stops until tool, datum and speed are checked."""

from __future__ import annotations

import re

import numpy as np

from planner.program import LineKind, Program

COMMENT = re.compile(r"\([^)]*\)|;.*")
SPINDLE_ON = re.compile(r"\bM0?[34](?!\d)")
SPEED = re.compile(r"S(\d+(?:\.\d*)?)")
COMMANDS = (LineKind.SETUP, LineKind.TOOL)


def first_cuts(program: Program) -> dict[int, float]:
    """N-word (from 1) of the first move behind each line that sets the spindle going -> its speed (rpm)."""
    kinds = program.table["kind"]
    moving = np.flatnonzero(~np.isin(kinds, (LineKind.SETUP, LineKind.TOOL, LineKind.DWELL)))
    found: dict[int, float] = {}
    for index in np.flatnonzero(np.isin(kinds, COMMANDS)):
        text = COMMENT.sub("", program.lines[int(index)])
        speed = SPEED.search(text) if SPINDLE_ON.search(text) else None
        place = int(np.searchsorted(moving, index))
        if speed is not None and float(speed.group(1)) > 0.0 and place < len(moving):
            found[int(moving[place]) + 1] = float(speed.group(1))
    return found
