"""Blocks of tip, axis and commands: what a program in workpiece coordinates says, before any control's words."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from planner.errors import PostError
from planner.post.macros import START
from planner.program import Channel


class What(IntEnum):
    """What a block is."""

    COMMAND = 0
    MACHINE = 1
    """Rapid to axis positions in machine coordinates."""
    RAPID = 2
    """Straight in workpiece coordinates, rapid."""
    LINE = 3
    """Straight in workpiece coordinates, at the feed."""
    START = 4
    """To the first pole of a NURBS, at its feed: without motion where the tool stands there."""
    POLE = 5
    """The next pole of a NURBS."""


class Say(IntEnum):
    """What a command says."""

    BEGIN = 0
    COMMENT = 1
    TOOL = 2
    SPINDLE = 3
    GATE = 4
    LEVEL = 5
    MODE = 6
    DWELL = 7
    END = 8


@dataclass(frozen=True)
class Command:
    """value : tool number, rpm (0: off), 1 or 0 for the gate, level, mode number, s   text : of a comment."""

    say: Say
    value: float = 0.0
    text: str = ""
    channel: Channel | None = None


BLOCK_DTYPE = np.dtype(
    [
        ("what", "u1"),
        ("kind", "u1"),  # LineKind
        ("layer", "<i4"),
        ("operation", "<i4"),
        ("pass_", "<i4"),
        ("tool", "<i4"),
        ("arc_start_mm", "<f8"),
        ("arc_end_mm", "<f8"),
        ("time_s", "<f8"),  # predicted
        ("tip", "<f8", (3,)),  # mm, workpiece: the end, or the pole
        ("axis", "<f8", (3,)),  # unit vector at the end, or the control vector of the pole
        ("tip_end", "<f8", (3,)),  # mm, workpiece, where the tool really is after the block
        ("axis_end", "<f8", (3,)),
        ("joints", "<f8", (5,)),  # there, mm or deg, machine coordinates
        ("feed_mm_min", "<f8"),
        ("weight", "<f8"),
        ("span", "<f8"),  # of the parameter, mm: knots p + i less p + i - 1 at pole i
        ("degree", "u1"),
        ("turns", "?"),  # of a START or POLE: the axis follows a NURBS too
        ("named", "u1"),  # of a machine move, bit k: axis k is told where to go; the others stay
        ("command", "<i4"),  # index, -1: none
        ("item", "<i4"),  # of the tape
    ]
)


@dataclass(frozen=True)
class Blocks:
    """rows : (n,) BLOCK_DTYPE   commands : what the rows' command indices mean."""

    rows: NDArray[np.void]
    commands: list[Command]


_MEANINGS = (
    (re.compile(r"M6 ?T(\d+)|T(\d+) ?M6"), Say.TOOL),
    (re.compile(r"M3 ?S(\d+\.?\d*)"), Say.SPINDLE),
    (re.compile(r"M6([23]) ?P\d+"), Say.GATE),
)
_SILENT = re.compile(r"(?:G21|G90|G94|G54|G49|G17|G40|G80|G61|G64.*)(?:\s|$)|^\(")


def meaning(text: str) -> Command | None:
    """What a line of the tape says to any control; none for modes that every control sets its own way."""
    for pattern, say in _MEANINGS:
        match = pattern.fullmatch(text)
        if match:
            value = float(next(group for group in match.groups() if group))
            return Command(say, float(value == 2.0) if say == Say.GATE else value)
    if text == "M5":
        return Command(Say.SPINDLE, 0.0)
    if text in ("M2", "M30"):
        return Command(Say.END)
    if text in ("", START) or _SILENT.match(text):
        return None
    raise PostError(f"the tape's command {text!r} has no word for a five-axis control", "post with dialect grblhal")
