"""Fanuc: NURBS where the tool axis stands, rotary positions where it turns, and what the reader notices."""

from __future__ import annotations

import re

import pytest

from config.cell import load_cell
from tests.unit.planner.hand_plan import circle
from tests.unit.planner.tip_posts import (
    assert_is_the_plan,
    assert_noticed,
    bead_pass,
    hybrid,
    posted,
    quarter_circle,
    with_nurbs,
)


@pytest.mark.parametrize("cell", ["trunnion_tcp", "head_head", "head_table"])
def test_read_back_it_is_the_plan_within_the_cells_tolerances(cell: str) -> None:
    assert_is_the_plan("fanuc", cell)


def test_nurbs_carry_a_knot_with_each_pole_and_as_many_alone_as_the_rank() -> None:
    made = posted(bead_pass(circle(15.0, 0.8)), "fanuc", with_nurbs(load_cell("trunnion_tcp")))
    text = "\n".join(made.program.lines)
    blocks = re.findall(r"G06\.2 P4 .*(?:\nN\d+ K\S+ .*)+((?:\nN\d+ K\S+)+)(?=\n)", text)
    assert len(blocks) == 3 and all(len(tail.split("\n")) - 1 == 4 for tail in blocks)
    assert made.read().max_tip_mm < 3e-4


def test_an_exact_arc_is_exact_but_for_the_least_increment() -> None:
    made = posted(bead_pass(quarter_circle(30.0)), "fanuc", with_nurbs(load_cell("trunnion_tcp")))
    report = made.read()
    assert any("P3 K0." in line and " R" in line for line in made.program.lines)
    assert not report.faults and report.max_tip_mm < 2e-4


def test_nurbs_stay_straight_moves_unless_the_cell_file_says_that_the_control_takes_them() -> None:
    made = posted(bead_pass(circle(15.0, 0.8)), "fanuc", load_cell("trunnion_tcp"))
    assert not any("G06.2" in line for line in made.program.lines)
    assert any("CNC.TAKES_NURBS" in line for line in made.program.lines)
    assert made.read().max_tip_mm <= made.cell.chord_tolerance_mm


def test_every_position_has_its_decimal_point_and_every_block_its_number() -> None:
    lines = hybrid("fanuc").program.lines
    assert lines[0] == lines[-1] == "%" and lines[1].startswith("O0001")
    for i, line in enumerate(lines[2:-1], 3):
        assert line.startswith(f"N{i} ")
        if "(" not in line:
            assert all("." in number for number in re.findall(r"[XYZABCKFR](-?[\d.]+)", line)), line


def test_the_rotary_axes_stand_in_every_nurbs() -> None:
    inside = False
    for line in hybrid("fanuc").program.lines:
        inside = "G06.2" in line or (inside and " K" in line)
        assert not (inside and re.search(r" [AC]-?\d", line))


MUTATIONS = {
    "a pole": (lambda t: re.search(r"N\d+ K\S+ X1", t), lambda t: t.replace(" X", " X-")),
    "a knot": (lambda t: re.search(r"K[1-9]\S* X", t), lambda t: re.sub(r"K(\d)", lambda m: f"K{int(m[1]) % 9 + 1}", t)),
    "a last knot": (lambda t: re.fullmatch(r"N\d+ K\S+", t), lambda t: re.sub(r"K\d", "K9", t)),
    "a feed": (lambda t: "F720." in t, lambda t: t.replace("F720", "F700")),
    "a gate word": (lambda t: t.endswith(" M62"), lambda t: t.replace("M62", "(GONE)")),
    "a laser level": (lambda t: "P9101 A1" in t, lambda t: t.replace("A1200.", "A1100.")),
    "a rotary position": (lambda t: re.match(r"N\d+ (G01 )?X\S+ Y\S+ C-?\d", t), lambda t: re.sub(r" C(-?\d)", r" C\g<1>1", t)),
    "a tool's length": (lambda t: "G43.4 H1" in t, lambda t: t.replace("H1", "H2")),
    "a decimal point": (lambda t: re.search(r"X-?\d+\.\s", t + " "), lambda t: re.sub(r"(X-?\d+)\.(\s|$)", r"\1\2", t)),
    "G49": (lambda t: t.endswith(" G49"), lambda t: t.replace("G49", "(GONE)")),
    "the last %": (lambda t: t == "%", lambda t: "(GONE)"),
}  # fmt: skip


@pytest.mark.parametrize("name", MUTATIONS)
def test_the_reader_notices_a_change_of(name: str) -> None:
    find, change = MUTATIONS[name]
    skip = 1 if name == "the last %" else 0
    assert_noticed(name, hybrid("fanuc").with_line(lambda line: bool(find(line)), change, skip))


def test_the_reader_notices_another_weight() -> None:
    made = posted(bead_pass(quarter_circle(30.0)), "fanuc", with_nurbs(load_cell("trunnion_tcp")))
    changed = made.with_line(
        lambda t: re.search(r"N\d+ K\S+ X.* R", t) is not None, lambda t: re.sub(r" R\S+", " R500.", t)
    )
    assert_noticed("a weight", changed)
