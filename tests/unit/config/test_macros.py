"""Macros of the cell file: what can be filled in is taken, everything else is refused in one line."""

from __future__ import annotations

import pytest

from config.base import FACTS_DIR, ConfigError, parse_facts
from config.cell import Cell, load_cell
from config.macros import Macros

CELL = (FACTS_DIR / "cells" / "trunnion_tcp.toml").read_text()


def with_macro(line: str) -> str:
    head = CELL.split("[macros.grblhal]")[0]
    return f"{head}[macros.grblhal]\n{line}\n"


@pytest.mark.parametrize("name", ["trunnion_tcp", "trunnion_rtu", "head_head", "head_table"])
def test_shipped_cells_say_their_macros_for_grblhal(name: str) -> None:
    macros = load_cell(name).macros["grblhal"]
    assert macros.tool_change == ("M6 T{tool}",) and macros.end == ("M2",) and macros.start


def test_a_macro_with_values_that_are_there_is_taken() -> None:
    cell = parse_facts(Cell, with_macro('tool_change = ["G53 G0 Z0", "M6 T{tool}", "(length {length_mm})"]'), "cell")
    assert cell.macros["grblhal"].tool_change == ("G53 G0 Z0", "M6 T{tool}", "(length {length_mm})")
    assert cell.macros["grblhal"].start is None


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ('tool_change = ["M6 T{tol}"]', r"tool_change: 'M6 T\{tol\}' asks for \{tol\}; there is: \{diameter_mm\}"),
        ('home = ["G28 {axis}"]', r"home: .* asks for \{axis\}; there is: none in this macro"),
        ('tool_change = ["M6"]', r"no line has T\{tool\}"),
        ("tool_change = []", "tool_change: has no line"),
        ('end = ["M2\\nM30"]', "is not one line of plain characters"),
        ('start = ["G21 {"]', "start: 'G21 {'"),
        ('start = ["(ready?)"]', "has '\\?', which grblHAL takes out of the line"),
        ('begin = ["G21"]', "unknown key"),
    ],
)
def test_a_macro_that_cannot_be_filled_in_is_refused_in_one_line(line: str, fault: str) -> None:
    with pytest.raises(ConfigError, match=fault) as caught:
        parse_facts(Cell, with_macro(line), "cell.toml")
    assert "\n" not in caught.value.message


def test_macros_for_a_dialect_that_does_not_exist_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"macros\.klartext"):
        parse_facts(Cell, CELL.replace("[macros.grblhal]", "[macros.klartext]"), "cell.toml")


def test_a_cell_with_other_macros_is_another_cell_for_its_programs() -> None:
    cell = load_cell("trunnion_tcp")
    other = cell.model_copy(update={"macros": {"grblhal": Macros(end=("M30",))}})
    assert other.sha256 != cell.sha256
