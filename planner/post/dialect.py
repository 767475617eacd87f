"""The seam between posting and the languages of controls: which there are, and what a dialect in joint coordinates has to offer."""

from __future__ import annotations

from typing import Protocol

from config.cell import Cell
from config.macros import DialectName, Macros
from planner.errors import PostError
from planner.post import grblhal, linuxcnc
from planner.post.blocks import Script
from planner.post.read_blocks import Reading
from planner.post.words import Words
from planner.program import Program

JOINT_DIALECTS = ("grblhal", "linuxcnc")
"""Written in the coordinates of the joints: the control knows nothing of the tool's tip."""
TIP_DIALECTS = ("siemens", "fanuc", "heidenhain", "apt")
"""Written in the workpiece's coordinates, tip and axis: the control or its own post makes joints of them."""
DIALECTS = (*JOINT_DIALECTS, *TIP_DIALECTS)


class JointDialect(Protocol):
    """One language in joint coordinates: a module with this inside."""

    NAME: DialectName
    MACROS: Macros
    has_splines: bool

    def fitted(self, cell: Cell) -> Cell:
        """The cell as the dialect uses it: its share of the tolerance, its outputs."""
        ...

    def values(self, cell: Cell) -> dict[str, str]:
        """What macros may ask for, for a fitted cell."""
        ...

    def remarks(self, cell: Cell) -> list[str]:
        """Lines of the header that only this dialect has."""
        ...

    def write(self, words: Words, script: Script, length_max: int) -> tuple[str, ...]:
        """Lines, line i with N(i + 1). Raises PostError."""
        ...

    def read(self, program: Program) -> Reading:
        """What the text says, by a parser that shares nothing with the writer. Raises PostError."""
        ...


_JOINT: dict[str, JointDialect] = {"grblhal": grblhal, "linuxcnc": linuxcnc}


def check_dialect(name: str) -> None:
    """Raise PostError, one line, if there is no such dialect."""
    if name not in DIALECTS:
        raise PostError(f"no dialect {name!r}", f"there is: {', '.join(DIALECTS)}")


def joint_dialect(name: str) -> JointDialect:
    """A dialect of JOINT_DIALECTS by name."""
    return _JOINT[name]
