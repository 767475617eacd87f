"""What the writers of programs in workpiece coordinates share: what is said at the program's start, and the words of commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from planner.post.macros import MacroBook
from planner.post.tcp_blocks import Command, Say
from planner.post.tcp_pass import Control
from planner.program import Channel

SMOOTHING_SHARE = 0.2
"""Of the tolerances: what the control may round corners by; the straight moves keep the rest."""


@dataclass(frozen=True)
class Vocabulary:
    """What a writer says beside moves.

    book : macros of the cell, or the dialect's own   header : lines of text for the program's start   letters : of the axes
    output : number of the gate's output   rapid_mm_min : of the slowest linear axis   name : of the program, letters and digits
    box_mm : least and greatest corner of the part, workpiece   smoothing_mm, smoothing_deg : what the control may round
    rotary : columns of the two rotary axes   point : what whole numbers end with
    """

    book: MacroBook
    header: Sequence[str]
    letters: tuple[str, ...]
    output: int
    rapid_mm_min: float
    name: str
    box_mm: tuple[tuple[float, ...], tuple[float, ...]]
    smoothing_mm: float
    smoothing_deg: float
    rotary: tuple[int, ...]
    point: str = ""

    def said(self, command: Command) -> list[str]:
        """Lines of a tool change, an output, a mode or the end. Raises PostError if a macro asks for what there is not."""
        if command.say == Say.TOOL:
            return list(self.book.expanded(f"M6 T{command.value:.0f}"))
        if command.say == Say.GATE:
            return list(self.book.lines("gate_on" if command.value > 0.0 else "gate_off", output=str(self.output)))
        if command.say == Say.MODE:
            return list(self.book.lines("mode", mode=f"{command.value:.0f}{self.point}"))
        if command.say == Say.LEVEL:
            assert command.channel is not None
            return list(self.book.lines(Channel(command.channel).name.lower(), value=plain(command.value, self.point)))
        return list(self.book.lines("end"))

    def opening(self) -> list[str]:
        """Lines of the macros start and home."""
        return [*self.book.lines("start"), *self.book.lines("home")]


OUTPUTS = {
    "laser_w": "laser W",
    "powder_g_min": "powder g/min",
    "carrier_gas_l_min": "carrier gas L/min",
    "shield_gas_l_min": "shield gas L/min",
    "mode": "0 safe, 1 deposit, 2 mill",
}
"""Macros of levels, and what a person calls them."""


def output_remarks(macros: Mapping[str, Sequence[str]]) -> list[str]:
    """One line for each output: its word, and what it sets."""
    found = []
    for name, text in OUTPUTS.items():
        telling = [line for line in macros[name] if "{value}" in line or "{mode}" in line]
        found += [f"{line.format(value='..', mode='..')} {text}" for line in telling[:1] if line.count("{") == 1]
    return found


def nurbs_remark(can: Control, does: Control) -> list[str]:
    """How curves go out, for controls that have NURBS at all."""
    if not can.degrees:
        return []
    return ["curves as NURBS" if does.degrees else "curves as straight moves, cnc.takes_nurbs would give NURBS"]


def plain(value: float, point: str = "") -> str:
    """A level with three decimals at most, no exponent: 1200, 12.5; point : what whole numbers end with."""
    text = f"{value:.3f}".rstrip("0")
    return text[:-1] + point if text.endswith(".") else text
