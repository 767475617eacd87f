"""Facts about what a machine wants said at the fixed places of a program: lines of G-code per dialect, with {values} that the post fills in."""

from __future__ import annotations

import re
from collections.abc import Mapping
from string import Formatter
from typing import Literal

from pydantic import model_validator

from config.base import Facts

DialectName = Literal["grblhal", "linuxcnc", "siemens", "fanuc", "heidenhain", "apt"]

VALUES: dict[str, frozenset[str]] = {
    "start": frozenset({"path_mm", "merge_mm", "axis_deg"}),
    "home": frozenset(),
    "tool_change": frozenset({"tool", "name", "diameter_mm", "length_mm"}),
    "probe": frozenset({"tool", "name", "diameter_mm", "length_mm"}),
    "end": frozenset(),
    "gate_on": frozenset({"output"}),
    "gate_off": frozenset({"output"}),
    "laser_w": frozenset({"value"}),
    "powder_g_min": frozenset({"value"}),
    "carrier_gas_l_min": frozenset({"value"}),
    "shield_gas_l_min": frozenset({"value"}),
    "mode": frozenset({"mode"}),
}
"""What may stand in braces in each macro. path_mm, merge_mm: how far the control may leave corners and drop points (LinuxCNC's G64 P Q);
axis_deg: how far it may leave the axis."""

_PRINTABLE = re.compile(r"[ -~]+")
_REAL_TIME = re.compile(r"[?!~]")
_TOOL_WORD = re.compile(r"(?:T|TOOL CALL |LOADTL/)\{tool\}")


class Macros(Facts):
    """Lines of one dialect; a macro that is not given is the dialect's own. One that moves ends with the tool clear of the part.

    start : modes, before anything moves   home : behind it   tool_change : brings tool {tool} in (T{tool} has to stand in it)
    probe : behind each change to a cutter, to measure its length   end : the last lines
    gate_on, gate_off, laser_w, powder_g_min, carrier_gas_l_min, shield_gas_l_min, mode : outputs of five-axis controls, in the stream
    """

    start: tuple[str, ...] | None = None
    home: tuple[str, ...] | None = None
    tool_change: tuple[str, ...] | None = None
    probe: tuple[str, ...] | None = None
    end: tuple[str, ...] | None = None
    gate_on: tuple[str, ...] | None = None
    gate_off: tuple[str, ...] | None = None
    laser_w: tuple[str, ...] | None = None
    powder_g_min: tuple[str, ...] | None = None
    carrier_gas_l_min: tuple[str, ...] | None = None
    shield_gas_l_min: tuple[str, ...] | None = None
    mode: tuple[str, ...] | None = None

    @model_validator(mode="after")
    def _can_be_filled_in(self) -> Macros:
        for name, known in VALUES.items():
            lines: tuple[str, ...] | None = getattr(self, name)
            for line in lines or ():
                _check_line(name, line, known)
        for name in ("tool_change", "end"):
            if getattr(self, name) == ():
                raise ValueError(f"{name}: has no line; leave it out for the dialect's own")
        if self.tool_change and not any(_TOOL_WORD.search(line) for line in self.tool_change):
            raise ValueError("tool_change: no line has T{tool} (or TOOL CALL {tool}, LOADTL/{tool}): nobody could tell which tool is in")
        return self


def check_real_time(macros: Mapping[DialectName, Macros]) -> None:
    """Raise ValueError if a line for grblHAL has a character that acts as it arrives: ? status, ! hold, ~ resume (grbl 1.1, real-time commands)."""
    for name, lines in (macros["grblhal"] if "grblhal" in macros else Macros()).model_dump().items():
        for line in lines or ():
            if found := _REAL_TIME.search(line):
                raise ValueError(f"grblhal.{name}: {line!r} has {found[0]!r}, which grblHAL takes out of the line as a command of its own")


def _check_line(name: str, line: str, known: frozenset[str]) -> None:
    if not _PRINTABLE.fullmatch(line) or line != line.strip():
        raise ValueError(f"{name}: {line!r} is not one line of plain characters without blanks around it")
    try:
        asked = [field for _, field, _, _ in Formatter().parse(line) if field is not None]
    except ValueError as error:
        raise ValueError(f"{name}: {line!r}: {error}") from None
    for field in asked:
        if field not in known:
            there = ", ".join(f"{{{value}}}" for value in sorted(known)) or "none in this macro"
            raise ValueError(f"{name}: {line!r} asks for {{{field}}}; there is: {there}")
