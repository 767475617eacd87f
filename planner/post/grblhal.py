"""grblHAL: five axes, G93 where a rotary axis moves, N-words, M62/M63 for the gate; no splines."""

from __future__ import annotations

from config.cell import Cell
from config.macros import DialectName, Macros
from planner.post.blocks import write
from planner.post.read_blocks import GRBLHAL, Reading
from planner.post.read_blocks import read as read_blocks
from planner.program import Program

__all__ = ["MACROS", "NAME", "fitted", "has_splines", "read", "remarks", "values", "write"]

NAME: DialectName = "grblhal"
MACROS = Macros(start=("G17 G21 G40 G49", "G54 G90 G94"), home=(), tool_change=("M6 T{tool}",), probe=(), end=("M2",))
"""XY plane, mm, no cutter compensation and no length offset (both are in the numbers); first work offset, absolute, feed per minute."""
has_splines = False


def fitted(cell: Cell) -> Cell:
    """The cell as it is: what the file says of outputs and tolerance holds."""
    return cell


def values(cell: Cell) -> dict[str, str]:
    """What the macros may ask for beside the tool's facts: nothing here."""
    return {}


def remarks(cell: Cell) -> list[str]:
    """Lines of the header that only this dialect has."""
    return []


def read(program: Program) -> Reading:
    """What the text says. Raises PostError with the line where it is not what this dialect writes."""
    return read_blocks(program, GRBLHAL)
