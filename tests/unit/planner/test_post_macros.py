"""What a program says of itself and at its fixed places: header, operations, macros of the cell file."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from config.cell import Cell, load_cell
from config.macros import Macros
from planner.errors import PostError
from planner.files import read_program, write_program
from planner.files.plan_file import plan_sha256
from planner.post import post
from planner.post.header import remark
from planner.post.reread import read
from planner.program import LineKind, Program
from tests.unit.planner.hand_plan import cone_operation, contour_operation, fill_operation, hybrid_plan, plan_of


@cache
def cell() -> Cell:
    return load_cell("trunnion_tcp")


@cache
def plain() -> Program:
    return post(hybrid_plan(), cell())


def with_macros(**lines: tuple[str, ...]) -> Cell:
    return cell().model_copy(update={"macros": {"grblhal": Macros(**lines)}})


def texts(program: Program) -> list[str]:
    return [line.split(" ", 1)[-1] for line in program.lines]


@pytest.mark.parametrize("dialect", ["grblhal", "linuxcnc"])
def test_the_header_tells_part_plan_cell_placement_tools_limits_and_time(dialect: str) -> None:
    program = post(hybrid_plan(), cell(), dialect=dialect)
    head = "\n".join(program.lines[:13])
    assert f"(part by hand, plan {plan_sha256(hybrid_plan())[:12]}, 316L hybrid)" in head
    assert f"(cell trunnion-tcp, {dialect}, within" in head
    assert "(part at X0 Y0 Z-420 turned 0, G54 X0 Y0 Z-420 A0 C0)" in head
    assert "(T1 coaxial head, 2 mm spot)" in head and "(T2 end mill D8)" in head
    joints = program.table["joints_end"]
    assert f"(C {joints[:, 4].min():.1f} to {joints[:, 4].max():.1f} of -3600 to 3600)" in head
    minutes = round(program.duration_s / 60.0)
    assert f"(2 layers, 5 operations, about {minutes} min)" in head


def test_each_operation_begins_with_a_line_that_names_it_and_its_layer() -> None:
    table = plain().table
    for number, text in enumerate(
        ["deposit_contour T1", "deposit_fill T1", "deposit_contour T1", "deposit_fill T1", "mill_side T2"]
    ):
        first = int(np.argmax(table["operation"] == number))
        assert texts(plain())[first] == f"(layer {number // 2 if number < 4 else 1} op {number} {text})"
        assert table["kind"][first] == LineKind.SETUP and table["pass_"][first] == -1
        assert table["time_end_s"][first] == table["time_start_s"][first]


def test_comments_hold_nothing_that_ends_them_or_acts_on_the_way() -> None:
    assert remark("50 % (new); ~!? [x] {y}\n\x18é") == "(50 _ _new__ ___ _x_ _y____)"
    assert len(remark("x" * 300)) == 72


def test_a_firmware_without_comments_gets_none() -> None:
    quiet = cell().model_copy(update={"cnc": cell().cnc.model_copy(update={"takes_comments": False})})
    program = post(hybrid_plan(), quiet)
    assert not any("(" in line for line in program.lines)
    assert program.duration_s == pytest.approx(plain().duration_s)


def test_macros_of_the_cell_stand_where_they_belong_and_barriers_before_them() -> None:
    facts = with_macros(
        start=("G21 G90", "G17 G94 G54"),
        tool_change=("M5", "M6 T{tool}", "(D{diameter_mm} L{length_mm})"),
        end=("M9", "M30"),
    )
    program = post(hybrid_plan(), facts)
    said = texts(program)
    change = said.index("M6 T2")
    assert said[change - 1 : change + 2] == ["M5", "M6 T2", "(D8 L140)"]
    modes = program.schedule[(program.schedule["channel"] == 0) & (program.schedule["value"] == 2)]
    assert modes["n"].tolist() == [change] and modes["barrier"].all()
    assert said[-2:] == ["M9", "M30"]
    assert int(program.schedule["n"][-1]) == len(program.lines) - 1  # safe before the first line of the end
    assert "G21 G90" in said and said.index("G17 G94 G54") == said.index("G21 G90") + 1
    assert np.all(program.table["kind"][change - 1 : change + 2] == LineKind.TOOL)


def test_behind_a_macro_that_moves_every_axis_and_mode_is_named_again() -> None:
    program = post(hybrid_plan(), with_macros(tool_change=("G53 G0 Z0", "M6 T{tool}"), probe=("G38.2 Z-10 F50",)))
    said = texts(program)
    probe = said.index("G38.2 Z-10 F50")
    assert said[probe - 1] == "M6 T2"  # cutters only: the head is not probed
    behind = next(line for line in program.lines[probe + 1 :] if "X" in line)
    assert all(letter in behind for letter in "XYZAC") and "G0" in behind
    reading = read(program)
    assert np.isnan(reading.joints[probe + 1]).all()
    at = program.lines.index(behind)
    assert np.allclose(reading.joints[at + 1], program.table["joints_end"][at])


def test_a_macro_that_asks_for_what_the_dialect_has_not_is_refused_in_one_line() -> None:
    with pytest.raises(PostError, match=r"macro start asks for \{path_mm\}") as caught:
        post(hybrid_plan(), with_macros(start=("G64 P{path_mm}",)))
    assert "\n" not in caught.value.message


@pytest.mark.parametrize("dialect", ["linuxcnc", "siemens", "fanuc", "heidenhain", "apt"])
def test_a_program_of_every_dialect_is_read_again_from_its_folder(dialect: str, tmp_path: Path) -> None:
    plan = plan_of([contour_operation(0), fill_operation(0), cone_operation(0)])
    write_program(plain(), tmp_path)  # another dialect's files do not stay
    program = post(plan, cell(), dialect=dialect)
    write_program(program, tmp_path)
    again = read_program(tmp_path)
    assert again.lines == program.lines and again.dialect == dialect
    kept = {path.name for path in tmp_path.iterdir()} - {"program.json", "lines.h5"}
    suffix = {"linuxcnc": ".ngc", "siemens": ".mpf", "fanuc": ".nc", "heidenhain": ".h", "apt": ".apt"}[dialect]
    assert kept and all(name.endswith(suffix) for name in kept)
