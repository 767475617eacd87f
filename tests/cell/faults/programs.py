"""Programs for the matrix of faults: as small as the situation that they bring about allows."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache

from config.cell import Cell
from planner.program import Channel, LineKind, Program
from tests.cell.jobs import Writer, mill_pass, one_wall

TOOL_CHANGE = re.compile(r"M6 T(\d+)")


def wall(cell: Cell) -> Program:
    """Two beads over one another, no milling."""
    return one_wall(cell, layers=2, length_mm=40.0, pieces=20, mill=False)


def face(cell: Cell) -> Program:
    """One milling pass and nothing before it."""
    w = Writer(cell)
    w.line("G21 G90 G17 G49 G54 G93", LineKind.SETUP)
    w.layer = w.operation = 0
    mill_pass(w, 1, 60.0)
    w.at(w.line("M2", LineKind.SETUP), Channel.MODE, 0, barrier=True)
    return w.program("face", [1])


@lru_cache(maxsize=8)
def program_for(situation: str, cell_name: str, cell: Cached) -> Program:
    """Program of a situation, made once per cell file. cell : wrapped, because facts do not hash."""
    program = face(cell.facts) if situation == "milling" else wall(cell.facts)
    if cell.facts.cnc.firmware != "grbl":
        return program
    lines = tuple(TOOL_CHANGE.sub(r"T\1", line) for line in program.lines)  # grbl 1.1 knows no M6 and tells no tool
    return replace(program, lines=lines)


class Cached:
    """A cell file as a key: two with the same hash are the same."""

    def __init__(self, facts: Cell) -> None:
        self.facts = facts

    def __hash__(self) -> int:
        return hash(self.facts.sha256)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Cached) and other.facts == self.facts
