"""Heidenhain Klartext: LN with axis vectors, running block numbers, and what the reader notices."""

from __future__ import annotations

import re
from itertools import pairwise

import pytest

from tests.unit.planner.tip_posts import assert_is_the_plan, assert_noticed, hybrid


@pytest.mark.parametrize("cell", ["trunnion_tcp", "head_head"])
def test_read_back_it_is_the_plan_within_the_cells_tolerances(cell: str) -> None:
    assert_is_the_plan("heidenhain", cell)


def test_blocks_are_numbered_from_nought_inside_the_programs_frame() -> None:
    lines = hybrid("heidenhain").program.lines
    assert [int(line.split(" ")[0]) for line in lines] == list(range(len(lines)))
    assert lines[0] == "0 BEGIN PGM BY_HAND MM" and lines[-1].endswith(" END PGM BY_HAND MM")
    assert sum("BLK FORM" in line for line in lines) == 2


def test_tool_centre_point_management_is_reset_before_machine_coordinates_and_tool_calls() -> None:
    follows = False
    for line in hybrid("heidenhain").program.lines:
        if "TCPM" in line:
            follows = "RESET" not in line
        assert not (follows and ("M91" in line or re.search(r"TOOL CALL \d", line)))


def test_vectors_stand_only_where_the_axis_changes() -> None:
    lines = hybrid("heidenhain").program.lines
    vectors = [re.findall(r"T[XYZ](\S+)", line) for line in lines if " LN " in line]
    assert all(first != second for first, second in pairwise(vectors) if first != ["+0", "+0", "+1"])
    assert any(" L X" in line for line in lines)


MUTATIONS = {
    "a sign": (lambda t: re.search(r" L X\+1\d", t), lambda t: t.replace("X+", "X-")),
    "a vector": (lambda t: re.search(r" TX\+0\.[1-9]", t), lambda t: t.replace("TX+", "TX-")),
    "a vector's length": (lambda t: re.search(r" TX\+0\.[1-9]", t), lambda t: re.sub(r"TZ\+0\.9", "TZ+0.8", t)),
    "a feed": (lambda t: " F720" in t, lambda t: t.replace("F720", "F800")),
    "a gate word": (lambda t: t.endswith(" M62"), lambda t: t.replace("M62", "; gone")),
    "a gas flow": (lambda t: re.search(r"PLC=\+4/\+\d", t), lambda t: re.sub(r"/\+\d+", "/+1", t)),
    "FMAX": (lambda t: " FMAX" in t and "M91" not in t, lambda t: t.replace("X+", "X-").replace("Z+", "Z-")),
    "TCPM": (lambda t: "FUNCTION TCPM" in t, lambda t: t.split(" ")[0] + " ; gone"),
    "a spindle speed": (lambda t: "TOOL CALL S" in t, lambda t: re.sub(r"S\d+", "S100", t)),
    "a block number": (lambda t: t.startswith("40 "), lambda t: "41" + t[2:]),
    "the end": (lambda t: " END PGM" in t, lambda t: t.replace("END PGM", "; END PGM")),
}


@pytest.mark.parametrize("name", MUTATIONS)
def test_the_reader_notices_a_change_of(name: str) -> None:
    find, change = MUTATIONS[name]
    assert_noticed(name, hybrid("heidenhain").with_line(lambda line: bool(find(line)), change))
