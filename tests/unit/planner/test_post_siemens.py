"""Sinumerik 840D: what is written, and what the reader notices when a number or a word is another."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from config.cell import load_cell
from config.macros import Macros
from planner.errors import PostError
from planner.nurbs.curve import Curve
from tests.unit.planner.hand_plan import circle, cone_axis
from tests.unit.planner.tip_posts import assert_noticed, bead_pass, hybrid, mill_pass, posted, quarter_circle

CELLS = ("trunnion_tcp", "head_head", "head_table")


@pytest.mark.parametrize("cell", CELLS)
def test_contours_go_out_as_nurbs_and_are_the_plans_to_a_ten_thousandth(cell: str) -> None:
    made = hybrid("siemens", cell)
    report = made.read()
    assert not report.faults and report.setpoints_ok
    assert report.max_tip_mm < 1e-4 and report.max_axis_deg < 1e-4  # straight moves have four decimals, poles six
    assert report.max_feed_ratio == pytest.approx(1.0, abs=1e-4)
    assert sum("BSPLINE" in line for line in made.program.lines) >= 3
    assert any("ORICURVE" in line and "XH=" in line for line in made.program.lines)


def test_a_nurbs_with_a_turning_axis_is_the_plans_to_a_ten_thousandth() -> None:
    made = posted(mill_pass(tip := circle(21.0, 4.0, 24), cone_axis(tip, 15.0)), "siemens", load_cell("trunnion_tcp"))
    report = made.read()
    poles = [line for line in made.program.lines if "PL=" in line]
    assert len(poles) > 20 and not report.faults
    assert report.max_axis_deg < 1e-4


def test_an_exact_arc_keeps_its_weight() -> None:
    made = posted(bead_pass(quarter_circle(30.0)), "siemens", load_cell("trunnion_tcp"))
    report = made.read()
    assert any("SD=2" in line for line in made.program.lines)
    assert any(re.search(r"PW=0\.9\d+", line) for line in made.program.lines)
    assert not report.faults and report.max_tip_mm < 1e-3


def test_the_transformation_is_off_wherever_the_axes_are_positioned() -> None:
    follows = False
    for line in hybrid("siemens").program.lines:
        body = line.split(" ", 1)[1]
        follows = body == "TRAORI" or (follows and body != "TRAFOOF")
        assert not (follows and body.startswith("SUPA"))
        assert follows or not re.match(r"(G[01] )?[XYZ]", body)


def test_the_gate_opens_and_closes_with_the_next_motion_of_the_tip() -> None:
    lines = [line.split(" ", 1)[1] for line in hybrid("siemens").program.lines]
    for i, line in enumerate(lines):
        if "$A_OUT" in line:
            behind = next(text for text in lines[i + 1 :] if not text.startswith(("H", ";", "WHEN")))
            assert re.match(r"(ORI\w+ )?(G[01] )?[XYZ]|BSPLINE", behind), f"{line} before {behind}"


def test_the_first_move_only_lifts_and_the_tip_is_followed_when_every_axis_has_been_told() -> None:
    moves = [line.split(" ", 4)[4] for line in hybrid("siemens").program.lines if "SUPA" in line]
    assert re.fullmatch(r"Z[\d.]+", moves[0])
    assert [word[0] for word in moves[1].split(" ")] == list("XYZAC")


MUTATIONS = {
    "a pole's sign": (lambda t: "PL=" in t and re.search(r"X-?1\d", t), lambda t: re.sub(r"X(-?)(\d)", lambda m: f"X{'' if m[1] else '-'}{m[2]}", t)),
    "a knot": (lambda t: re.match(r"N\d+ X.*PL=[1-9]", t), lambda t: re.sub(r"PL=(\d)", lambda m: f"PL={int(m[1]) % 9 + 1}", t)),
    "a knot left out": (lambda t: re.search(r"PL=[1-9]", t), lambda t: re.sub(r" PL=\S+", "", t)),
    "a second point": (lambda t: "XH=" in t and "PL=" in t, lambda t: re.sub(r"ZH=(\d)", "ZH=-\\1", t)),
    "a feed": (lambda t: " F720" in t or " F300" in t, lambda t: t.replace("F720", "F721").replace("F300", "F301")),
    "a gate word": (lambda t: "$A_OUT[1]=1" in t, lambda t: t.split(" ")[0] + " ; gone"),
    "a gate that stays open": (lambda t: "$A_OUT[1]=0" in t, lambda t: t.split(" ")[0] + " ; gone"),
    "a laser level": (lambda t: "H1=1200" in t, lambda t: t.replace("1200", "1201")),
    "a powder flow": (lambda t: re.search(r"H2=\d", t), lambda t: re.sub(r"H2=\S+", "H2=3", t)),
    "a tool": (lambda t: "T2 M6" in t, lambda t: t.replace("T2", "T3")),
    "a spindle": (lambda t: " M3" in t, lambda t: t.replace("M3", "M5")),
    "TRAORI": (lambda t: t.endswith("TRAORI"), lambda t: t.replace("TRAORI", "; gone")),
    "FGROUP": (lambda t: "FGROUP" in t, lambda t: t.split(" ")[0] + " ; gone"),
    "an axis position": (lambda t: "SUPA" in t and "X" in t, lambda t: re.sub(r" Y(-?)(\d)", r" Y\g<1>1\2", t)),
    "an axis vector": (lambda t: "A3=" in t and "C3=0." in t, lambda t: re.sub(r"A3=(-?)", lambda m: f"A3={'' if m[1] else '-'}", t)),
    "the end": (lambda t: t.endswith("M30"), lambda t: t.replace("M30", "M0")),
}  # fmt: skip


@pytest.mark.parametrize("name", MUTATIONS)
def test_the_reader_notices_a_change_of(name: str) -> None:
    find, change = MUTATIONS[name]
    assert_noticed(name, hybrid("siemens").with_line(lambda line: bool(find(line)), change))


def test_the_reader_notices_another_weight() -> None:
    made = posted(bead_pass(quarter_circle(30.0)), "siemens", load_cell("trunnion_tcp"))
    assert_noticed("a weight", made.with_line(lambda t: "PW=0" in t, lambda t: re.sub(r"PW=0\.\d+", "PW=0.7", t)))


def test_the_reader_notices_a_line_left_out() -> None:
    made = hybrid("siemens")
    for i in (k for k, line in enumerate(made.program.lines) if re.fullmatch(r"N\d+ X\S+( Y\S+)?", line)):
        lines = list(made.program.lines)
        lines[i] = f"N{i + 1} ;"
        changed = replace(made, program=replace(made.program, lines=tuple(lines)))
        assert_noticed(f"line {i + 1}", changed)
        return


def test_outputs_are_the_cells_own_macros() -> None:
    cell = load_cell("trunnion_tcp")
    own = Macros(gate_on=("M70",), gate_off=("M71",), laser_w=("H9={value}",), end=("LASER_END", "M17"))
    made = posted(bead_pass(circle(15.0, 0.8)), "siemens", cell.model_copy(update={"macros": {"siemens": own}}))
    texts = [line.split(" ", 1)[1] for line in made.program.lines]
    assert {"M70", "M71", "H9=1200"} <= set(texts) and texts[-2:] == ["LASER_END", "M17"]
    assert not made.read().faults


def test_gates_that_cannot_be_told_apart_are_refused() -> None:
    cell = load_cell("trunnion_tcp")
    own = Macros(gate_on=("M70",), gate_off=("M70",))
    with pytest.raises(PostError, match="gate_on and gate_off both say 'M70'"):
        posted(bead_pass(circle(15.0, 0.8)), "siemens", cell.model_copy(update={"macros": {"siemens": own}})).read()


def test_a_turned_work_offset_is_refused_by_name() -> None:
    cell = load_cell("trunnion_tcp")
    offset = {**cell.placement.work_offset, "C": 10.0}
    turned = cell.model_copy(update={"placement": cell.placement.model_copy(update={"work_offset": offset})})
    with pytest.raises(PostError, match="work offset of C is 10 deg"):
        posted(bead_pass(circle(15.0, 0.8)), "siemens", turned)


def test_every_line_of_the_table_stands_for_its_text_in_order_of_time() -> None:
    program = hybrid("siemens").program
    assert len(program.table) == len(program.lines)
    assert np.all(np.diff(program.table["time_end_s"]) >= -1e-9)
    assert np.array_equal(program.table["n"], np.arange(1, len(program.lines) + 1))
    assert program.duration_s == pytest.approx(program.table["time_end_s"][-1])


def test_straight_stretches_of_a_cubic_go_out_as_straight_moves() -> None:
    corners = np.array([[0.0, 0.0, 5.0], [24.0, 0.0, 5.0], [24.0, 12.0, 5.0]])
    points = np.vstack(
        [corners[0], *(a + np.array([[1.0], [2.0], [3.0]]) / 3.0 * (b - a) for a, b in pairwise(corners))]
    )
    tip = Curve(3, np.repeat([0.0, 1.0, 2.0], [4, 3, 4]), points)
    made = posted(bead_pass(tip), "siemens", load_cell("trunnion_tcp"))
    assert not any("BSPLINE" in line for line in made.program.lines)
    assert not made.read().faults and made.read().max_tip_mm < 1e-4
