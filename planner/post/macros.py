"""What a program says at its fixed places: the cell file's macros, or else the dialect's own."""

from __future__ import annotations

import re
from collections.abc import Mapping

from config.cell import Cell
from config.macros import DialectName, Macros
from planner.errors import PostError

START = "START"
"""Text of the tape's first command: it stands for the macros start and home."""
END = "M2"
"""Text of the tape's last command: it stands for the macro end."""
_CHANGE = re.compile(r"M6 T(\d+)")


class MacroBook:
    """The macros of one cell in one dialect.

    own : the dialect's macros for what the cell file leaves out   values : what may stand in braces beside the tool's facts
    """

    def __init__(self, cell: Cell, dialect: DialectName, own: Macros, values: Mapping[str, str]) -> None:
        self._cell = cell
        self._given = cell.macros.get(dialect, Macros())
        self._own = own
        self._values = dict(values)

    def lines(self, name: str, /, **values: str) -> tuple[str, ...]:
        """The lines of a macro, filled in. Raises PostError if it asks for what this dialect has not."""
        given = getattr(self._given, name)
        texts: tuple[str, ...] = (getattr(self._own, name) or ()) if given is None else given
        try:
            return tuple(text.format(**{**self._values, **values}) for text in texts)
        except KeyError as error:
            raise PostError(
                f"cell {self._cell.name}: macro {name} asks for {{{error.args[0]}}}, which this dialect has no value for",
                "leave it out of the macro",
            ) from None

    def expanded(self, command: str) -> tuple[str, ...]:
        """Lines that a command of the tape becomes."""
        if command == START:
            return self.lines("start") + self.lines("home")
        if command == END:
            return self.lines("end")
        if change := _CHANGE.fullmatch(command):
            return self._tool_change(int(change[1]))
        return (command,)

    def _tool_change(self, number: int) -> tuple[str, ...]:
        tool = next(tool for tool in self._cell.tools if tool.number == number)
        values = {
            "tool": str(number),
            "name": tool.name,
            "diameter_mm": f"{tool.diameter_mm:g}",
            "length_mm": f"{-tool.tip_mm[2]:g}",
        }
        probe = () if tool.kind == "deposition" else self.lines("probe", **values)
        return self.lines("tool_change", **values) + probe
