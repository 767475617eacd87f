"""The rest of an interrupted program as text: what it repeats, what it adds, what it refuses."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import planner
from config import load_cell
from planner.errors import PlannerError, ResumeError
from planner.files.program_file import program_files, read_program, write_program
from planner.plan import Operation, Pass, Plan, Process
from planner.post.pass_curve import PassCurve
from planner.post.reread import read
from planner.program import Channel, LineKind, Program
from planner.recipe import Recipe
from planner.resume import ResumePoint
from planner.resume.stretch import HASTE
from tests.unit.planner.hand_plan import FEED_MM_S, GAS, LASER_W, POWDER, circle, cone_axis, link, plan_of
from tests.unit.planner.small_parts import box

CELL = load_cell("trunnion_tcp")
MODBUS_CELL = load_cell("trunnion_rtu")
SHA = "0" * 64
ON_PATH_MM = 0.012  # chord tolerance and the rounding of words
RING_MM, LEAN_DEG = 12.0, 25.0


@cache
def small_plan() -> Plan:
    """Two layers of contours and fill, then a face and a wall milled."""
    return planner.plan(box(10.0, 6.0, 1.6), Recipe(process="hybrid"), part_name="box")


@cache
def small(cell_name: str = "trunnion_tcp") -> Program:
    """Its program."""
    return planner.post(small_plan(), load_cell(cell_name))


def leaning_ring() -> Plan:
    """One bead round a circle, the head leaning outwards: both rotary axes stand turned and one moves all the way."""
    tip = circle(RING_MM, 0.0)
    axis = cone_axis(tip, LEAN_DEG)
    first = axis.evaluate([axis.domain[0]])[0]
    first = first / np.linalg.norm(first)
    start = np.array([RING_MM, 0.0, 0.0])
    rows = np.array([[0.0, FEED_MM_S, 0.0, POWDER, GAS], [2.0, FEED_MM_S, LASER_W, POWDER, GAS], [tip.length - 2.0, FEED_MM_S, 0.0, POWDER, GAS]])
    far = start + 8.0 * first
    passes = (link(far, start, axis=first), Pass(tip, axis, rows), link(start, far, axis=first))
    return plan_of([Operation(Process.DEPOSIT_OVERHANG, 0, passes, bead_width_mm=2.0)], half_mm=14.0)


def resumed(program: Program, point: ResumePoint, **options: object) -> Program:
    cell = CELL if program.cell_name == CELL.name else MODBUS_CELL
    return planner.resume(program, cell, point, program_sha256=SHA, **options)  # type: ignore[arg-type]


def words(line: str) -> str:
    """A line without its number."""
    return re.sub(r"^N\d+\s*", "", line)


def lit_lines(program: Program) -> list[int]:
    """Indices of moves with the gate open, by the text."""
    reading = read(program)
    return [int(k) for k in np.flatnonzero(reading.gate & reading.is_motion)]


def middle_of_a_bead(program: Program) -> tuple[int, float]:
    """A long lit line, and a share of it with room for lead-in and overlap before it."""
    table = program.table
    longest = max(lit_lines(program), key=lambda k: float(table["arc_end_mm"][k] - table["arc_start_mm"][k]))
    return longest, 0.6


def cutting_lines(program: Program) -> list[int]:
    reading = read(program)
    does = (program.table["kind"] == LineKind.PROCESS) & reading.is_motion & (reading.tool == 2)
    return [int(k) for k in np.flatnonzero(does)]


def test_rest_of_the_program_is_the_original_text_with_new_numbers() -> None:
    program = small()
    line, share = middle_of_a_bead(program)
    made = resumed(program, ResumePoint.at(line, share))
    head = made.continues.head_lines  # type: ignore[union-attr]
    assert made.continues is not None and made.continues.resumed_line == line + 1
    rest = [words(text) for text in made.lines[head:]]
    before = [words(text) for text in program.lines[line + 1 :]]
    assert len(rest) == len(before)
    changed = [(old, new) for old, new in zip(before, rest, strict=True) if old != new]
    assert len(changed) <= 2 and all(set(re.findall(r"[XYZAC][-\d.]+", old)) == set(re.findall(r"[XYZAC][-\d.]+", new)) for old, new in changed)
    assert [int(match[1]) for text in made.lines if (match := re.match(r"N(\d+)", text))] == list(range(1, len(made.lines) + 1))


def test_same_arguments_give_the_same_bytes_and_the_file_keeps_where_it_goes_on(tmp_path: Path) -> None:
    program = small()
    point = ResumePoint.at(*middle_of_a_bead(program))
    first, second = resumed(program, point), resumed(program, point)
    assert program_files(first) == program_files(second)
    write_program(first, tmp_path)
    again = read_program(tmp_path)
    assert again.continues == first.continues and again.lines == first.lines


def test_programs_that_resume_nothing_are_written_as_before() -> None:
    assert b"continues" not in program_files(small())["program.json"]


def test_every_row_before_the_rest_lies_on_the_pass_of_the_plan_that_it_names() -> None:
    program, plan = small(), small_plan()
    made = resumed(program, ResumePoint.at(*middle_of_a_bead(program)))
    rows = made.table[: made.continues.head_lines]  # type: ignore[union-attr]
    rows = rows[(rows["kind"] == LineKind.PROCESS) & (rows["arc_end_mm"] > rows["arc_start_mm"])]
    assert len(rows) >= 4
    curve = PassCurve(plan.operations[int(rows["operation"][0])].passes[int(rows["pass_"][0])], program.machine_from_build, "")
    there = curve.tips(curve.at_arc_length(rows["arc_end_mm"]))
    tips = rows["tip_end"] @ program.machine_from_build[:3, :3].T + program.machine_from_build[:3, 3]
    assert np.linalg.norm(tips - there, axis=1).max() < ON_PATH_MM
    assert np.allclose(rows["arc_start_mm"][1:], rows["arc_end_mm"][:-1])


def test_laser_is_opened_one_overlap_before_metals_end_after_a_dark_lead_in_and_rises() -> None:
    program = small()
    line, share = middle_of_a_bead(program)
    made = resumed(program, ResumePoint.at(line, share), overlap_mm=2.0, lead_in_mm=1.5)
    row = program.table[line]
    end = float(row["arc_start_mm"] + share * (row["arc_end_mm"] - row["arc_start_mm"]))
    reading, table = read(made), made.table
    first_lit = int(np.flatnonzero(reading.gate & reading.is_motion)[0])
    assert table["arc_start_mm"][first_lit] == pytest.approx(end - 2.0, abs=1e-6)
    dark = np.flatnonzero((table["kind"] == LineKind.PROCESS) & reading.is_motion)[0]
    assert table["arc_start_mm"][dark] == pytest.approx(end - 3.5, abs=1e-6)
    levels = made.schedule[made.schedule["channel"] == Channel.LASER_W]
    rising = levels["value"][levels["n"] <= made.continues.head_lines]  # type: ignore[union-attr]
    assert (np.diff(rising) > 0.0).all() and rising[-1] == pytest.approx(level_at(program, line))
    again = (table["arc_end_mm"] <= end + 1e-6) & (np.arange(len(table)) >= first_lit) & (table["n"] <= made.continues.head_lines)  # type: ignore[union-attr]
    speed = 2.0 / reading.time_s[again & reading.is_motion].sum()
    planned = (row["arc_end_mm"] - row["arc_start_mm"]) / read(program).time_s[line]
    assert speed == pytest.approx(HASTE * planned, rel=1e-3)


def level_at(program: Program, line: int) -> float:
    """Laser's level by the schedule."""
    of = program.schedule[(program.schedule["channel"] == Channel.LASER_W) & (program.schedule["n"] <= line + 1)]
    return float(of["value"][-1])


def test_machine_is_up_then_turns_then_goes_over_the_place_then_comes_down() -> None:
    program = planner.post(leaning_ring(), CELL)
    lit = lit_lines(program)
    made = resumed(program, ResumePoint.at(lit[len(lit) // 2], 0.4))
    head = made.table[: made.continues.head_lines]  # type: ignore[union-attr]
    way = head["joints_end"][: int(np.argmax(head["kind"] == LineKind.PROCESS))]
    z, top = CELL.letters.index("Z"), CELL.axis("Z").max
    turns = np.flatnonzero(np.abs(np.diff(way[:, 3:], axis=0)).max(axis=1) > 1e-9)
    across = np.flatnonzero(np.abs(np.diff(way[:, :2], axis=0)).max(axis=1) > 1e-9)
    down = np.flatnonzero(np.diff(way[:, z]) < 0.0)
    assert turns.size == 1 and turns[0] < across[0] < down[0] and (way[turns[0] : down[0] + 1, z] == top).all()
    schedule = made.schedule[made.schedule["barrier"] == 1]
    wanted = [Channel.MODE, Channel.CARRIER_GAS_L_MIN, Channel.SHIELD_GAS_L_MIN, Channel.POWDER_G_MIN]
    assert [int(entry["channel"]) for entry in schedule[:4]] == wanted


def test_part_of_an_inverse_time_line_takes_its_part_of_the_time() -> None:
    program = planner.post(leaning_ring(), CELL)
    before = read(program)
    line = max(lit_lines(program), key=lambda k: float(before.time_s[k]))
    assert "G93" in "".join(program.lines)
    made = resumed(program, ResumePoint.at(line, 0.5))
    head = made.continues.head_lines  # type: ignore[union-attr]
    assert read(made).time_s[head - 1] == pytest.approx(0.5 * before.time_s[line], rel=1e-3)


def test_arc_that_is_cut_in_two_keeps_its_circle() -> None:
    program = small()
    before = read(program)
    arcs = before.arcs
    k = int(np.flatnonzero([int(line) in cutting_lines(program) for line in arcs.lines])[1])
    line = int(arcs.lines[k])
    made = resumed(program, ResumePoint.at(line, 0.5), overlap_mm=0.0)
    after = read(made).arcs
    first = int(np.flatnonzero(after.lines == made.continues.head_lines - 1)[0])  # type: ignore[union-attr]
    assert after.radius[first] == pytest.approx(arcs.radius[k], abs=0.003)
    assert np.linalg.norm(after.centre[first] - arcs.centre[k]) < 0.003
    assert after.sweep[first] == pytest.approx(0.5 * arcs.sweep[k], rel=2e-3)


def test_cutter_goes_in_again_along_what_it_has_cut_with_its_spindle_on() -> None:
    program = small()
    line = cutting_lines(program)[len(cutting_lines(program)) // 2]
    made = resumed(program, ResumePoint.at(line, 0.5), overlap_mm=1.0)
    head = made.continues.head_lines  # type: ignore[union-attr]
    reading = read(made)
    row = program.table[line]
    end = 0.5 * float(row["arc_start_mm"] + row["arc_end_mm"])
    process = np.flatnonzero((made.table["kind"][:head] == LineKind.PROCESS) & reading.is_motion[:head])
    assert made.table["arc_start_mm"][process[0]] == pytest.approx(end - 1.0, abs=0.03)
    assert not reading.is_rapid[process[0] - 2 : head].any() and (reading.spindle_rpm[process] > 0.0).all()
    assert not reading.gate.any() and not (made.schedule["channel"] == Channel.LASER_W)[made.schedule["n"] <= head].any()


@pytest.mark.parametrize("cell_name", ["trunnion_tcp", "trunnion_rtu"])
def test_every_point_of_a_program_resumes_or_says_that_nothing_is_left(cell_name: str) -> None:
    """Each result is read back inside and compared with the original's way, feed, gate, tool and levels."""
    program = small(cell_name)
    last = max(np.flatnonzero((program.table["kind"] == LineKind.PROCESS) & (program.table["pass_"] >= 0)))
    for line in range(0, len(program.lines), 13):
        try:
            made = resumed(program, ResumePoint.at(line, 0.37))
        except ResumeError as error:
            assert line >= last - 1 and "nothing is left" in error.message
        else:
            assert made.lines[-1].endswith("M2")


def test_gate_by_modbus_is_an_entry_at_the_line_of_the_overlap() -> None:
    program = small("trunnion_rtu")
    table = program.table
    lit = program.schedule[(program.schedule["channel"] == Channel.EMISSION) & (program.schedule["value"] > 0.0)]["n"]
    line = int(lit[0])  # the line behind the first that is lit
    made = resumed(program, ResumePoint.at(line, 0.5), overlap_mm=1.0)
    entries = made.schedule[made.schedule["channel"] == Channel.EMISSION]
    row = made.table[int(entries["n"][0]) - 1]
    end = 0.5 * float(table["arc_start_mm"][line] + table["arc_end_mm"][line])
    assert entries["value"][0] == 1.0 and row["arc_start_mm"] == pytest.approx(end - 1.0, abs=0.03)
    assert not any("M62" in text or "M63" in text for text in made.lines)


def test_layer_and_operation_begin_with_the_link_to_their_first_pass_and_keep_the_wait() -> None:
    program = small()
    waits = np.flatnonzero(program.table["kind"] == LineKind.DWELL)
    layer = resumed(program, ResumePoint.of_layer(1))
    assert [words(text) for text in layer.lines if "G4 P" in text] == [words(program.lines[k]) for k in waits if program.table["layer"][k] >= 1]
    assert layer.table["layer"].max() == 1 and set(np.unique(layer.table["operation"][layer.table["pass_"] >= 0])) == {2, 3, 4, 5}
    last = resumed(program, ResumePoint.of_operation(5))
    assert set(np.unique(last.table["operation"][last.table["pass_"] >= 0])) == {5} and last.tools == (2,)


def test_stop_between_two_passes_goes_on_with_the_next_one() -> None:
    program = small()
    links = np.flatnonzero((program.table["kind"] == LineKind.LINK) & (program.table["pass_"] >= 0))
    line = int(links[len(links) // 2])
    made = resumed(program, ResumePoint.at(line, 0.5))
    ahead = np.flatnonzero((program.table["kind"] == LineKind.PROCESS) & (np.arange(len(program.lines)) >= line) & (program.table["pass_"] >= 0))
    first = program.table[ahead[0]]
    does = made.table[made.table["kind"] == LineKind.PROCESS][0]
    assert (does["operation"], does["pass_"]) == (first["operation"], first["pass_"])


def test_rest_of_a_rest_is_the_rest_of_the_whole() -> None:
    program = small()
    line, share = middle_of_a_bead(program)
    once = resumed(program, ResumePoint.at(line, share))
    later = cutting_lines(program)[5]
    there = later - once.continues.resumed_line + once.continues.head_lines  # type: ignore[union-attr]
    twice, direct = resumed(once, ResumePoint.at(there, 0.25)), resumed(program, ResumePoint.at(later, 0.25))
    assert [words(text) for text in twice.lines[5:]] == [words(text) for text in direct.lines[5:]]


def test_program_of_a_control_with_its_own_kinematics_is_resumed_there() -> None:
    program = replace(small(), dialect="siemens")
    with pytest.raises(ResumeError, match="resumed at its control"):
        resumed(program, ResumePoint.at(30, 0.5))


@pytest.mark.parametrize(
    ("point", "said"),
    [
        (ResumePoint.at(100_000), "the program has lines 0 to"),
        (ResumePoint.at(-1), "the program has lines 0 to"),
        (ResumePoint.at(20, 1.5), "0 to 1 is possible"),
        (ResumePoint.at(20, float("nan")), "0 to 1 is possible"),
        (ResumePoint.of_layer(7), "there is 0 to 1"),
        (ResumePoint.of_operation(9), "there is 0 to 5"),
    ],
)
def test_point_that_the_program_has_not_is_refused_in_one_line(point: ResumePoint, said: str) -> None:
    with pytest.raises(ResumeError, match=said) as caught:
        resumed(small(), point)
    assert "\n" not in caught.value.message and caught.value.hint


def test_other_cell_and_lost_tool_are_refused_in_one_line() -> None:
    program = small()
    with pytest.raises(ResumeError, match="another state of cell"):
        planner.resume(program, MODBUS_CELL, ResumePoint.of_layer(0), program_sha256=SHA)
    left = CELL.model_copy(update={"tools": tuple(tool for tool in CELL.tools if tool.number != 2)})
    with pytest.raises(PlannerError, match="needs tool T2"):
        planner.resume(replace(program, cell_sha256=left.sha256), left, ResumePoint.of_operation(5), program_sha256=SHA)
