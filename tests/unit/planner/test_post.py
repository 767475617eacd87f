"""Posting of Plans made by hand: true tip path, feeds, schedule, order of commands, refusals."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from config.cell import Cell, load_cell
from planner.errors import PostError, ReachError, TravelLimitError
from planner.plan import Operation, Pass, Process
from planner.post import post, post_with_report
from planner.post.reread import check, read, verify
from planner.program import Channel, LineKind, Program
from tests.unit.planner.hand_plan import (
    LASER_W,
    LEAD_MM,
    POWDER,
    RADIUS_MM,
    WAYS,
    circle,
    cone_axis,
    cone_operation,
    contour_operation,
    fill_operation,
    hybrid_plan,
    link,
    plan_of,
)

CELLS = ("trunnion_tcp", "trunnion_rtu", "head_head", "head_table")


@pytest.fixture(scope="module")
def trunnion() -> Cell:
    return load_cell("trunnion_tcp")


@pytest.fixture(scope="module")
def hybrid(trunnion: Cell) -> Program:
    return post(hybrid_plan(), trunnion)


def entries(program: Program, channel: Channel) -> list[tuple[str, float, int]]:
    """Text of the line, value and barrier of each entry of a channel."""
    return [
        (program.lines[row["n"] - 1], float(row["value"]), int(row["barrier"]))
        for row in program.schedule
        if row["channel"] == channel
    ]


@pytest.mark.parametrize("name", CELLS)
def test_the_text_read_back_follows_tip_axis_feed_and_set_points_of_the_plan(name: str) -> None:
    cell = load_cell(name)
    program, report = post_with_report(hybrid_plan(), cell)
    assert report.reread.max_tip_mm <= cell.chord_tolerance_mm
    assert report.reread.max_axis_deg <= cell.axis_tolerance_deg
    assert report.reread.max_feed_ratio < 1.001
    assert report.reread.setpoints_ok
    assert max(map(len, program.lines)) < cell.cnc.line_length_max
    assert program.gate == ("modbus" if name == "trunnion_rtu" else "stream")


def test_the_deposited_circle_is_a_circle_of_its_radius_in_the_line_table(hybrid: Program) -> None:
    rows = hybrid.table[(hybrid.table["operation"] == 0) & (hybrid.table["kind"] == LineKind.PROCESS)]
    radius = np.linalg.norm(rows["tip_end"][:, :2], axis=1)
    assert np.abs(radius - RADIUS_MM).max() < 0.01  # the chord tolerance: ends of straight moves lie on both sides
    assert np.allclose(rows["axis_end"], [0.0, 0.0, 1.0], atol=1e-9)


def test_a_cone_round_the_rotary_axis_is_one_turn_of_the_table_at_inverse_time(hybrid: Program) -> None:
    moves = hybrid.table[(hybrid.table["operation"] == 4) & (hybrid.table["kind"] == LineKind.PROCESS)]
    assert len(moves) == 1  # tilt, x and y stay: the whole circle is one straight move of the joints
    text = hybrid.lines[int(moves["n"][0]) - 1]
    assert re.fullmatch(r"N\d+G93C-?\d+(\.\d+)?F[\d.]+", text)
    minutes = 2.0 * np.pi * 24.0 / 5.0 / 60.0
    assert float(text.split("F")[1]) == pytest.approx(1.0 / minutes, rel=1e-4)


def test_table_and_text_are_numbered_alike_and_arcs_and_times_run_on(hybrid: Program) -> None:
    assert [re.match(r"N\d+", line)[0] for line in hybrid.lines] == [f"N{n}" for n in hybrid.table["n"]]  # type: ignore[index]
    assert np.all(hybrid.table["time_start_s"][1:] == hybrid.table["time_end_s"][:-1])
    assert np.all(np.diff(hybrid.table["time_end_s"]) >= 0.0)
    assert hybrid.duration_s == pytest.approx(float(hybrid.table["time_end_s"][-1]))
    for number in range(5):
        process = hybrid.table[(hybrid.table["operation"] == number) & (hybrid.table["kind"] == LineKind.PROCESS)]
        moving = process[process["arc_end_mm"] > process["arc_start_mm"]]
        same = np.diff(moving["pass_"]) == 0
        assert np.abs(moving["arc_start_mm"][1:] - moving["arc_end_mm"][:-1])[same].max(initial=0.0) < 1e-9


def test_the_gate_opens_and_closes_where_the_plan_says(hybrid: Program) -> None:
    way = 2.0 * abs(WAYS[0][0])
    rows = hybrid.table[(hybrid.table["operation"] == 1) & (hybrid.table["pass_"] == 1)]
    texts = [hybrid.lines[n - 1].split(" ", 1)[-1] for n in rows["n"]]
    assert texts[1] == "M62 P0" and texts[3] == "M63 P0"
    assert rows["arc_end_mm"][[0, 2, 4]].tolist() == pytest.approx([LEAD_MM, way - LEAD_MM, way])


def test_a_cell_without_a_gate_output_gets_emission_in_the_schedule_and_no_m62() -> None:
    program = post(hybrid_plan(), load_cell("trunnion_rtu"))
    assert not any("M62" in line or "M63" in line for line in program.lines)
    values = [value for _, value, _ in entries(program, Channel.EMISSION)]
    beads = 2 * (1 + len(WAYS))
    assert values == [1.0, 0.0] * beads


def test_modes_change_behind_barriers_in_the_order_of_the_contract(hybrid: Program) -> None:
    modes = entries(hybrid, Channel.MODE)
    assert [(value, barrier) for _, value, barrier in modes] == [(1.0, 1), (2.0, 1), (0.0, 1)]
    assert modes[1][0].endswith("M6 T2") and modes[2][0].endswith("M2")
    change = next(k for k, line in enumerate(hybrid.lines) if line.endswith("M6 T2"))
    assert hybrid.lines[change + 1].endswith("M3 S3580")
    assert hybrid.lines[-2].endswith("M5")
    first = next(k for k, line in enumerate(hybrid.lines) if line.endswith("M6 T1"))
    assert int(hybrid.schedule["n"][0]) == first + 2  # the first motion behind the tool change


def test_after_milling_the_spindle_stops_before_the_head_comes_back(trunnion: Cell) -> None:
    program = post(plan_of([contour_operation(0), cone_operation(0)], [contour_operation(1)]), trunnion)
    change = [k for k, line in enumerate(program.lines) if line.endswith("M6 T1")][1]
    assert program.lines[change - 1].endswith("M5")
    assert [value for _, value, _ in entries(program, Channel.MODE)] == [1.0, 2.0, 1.0, 0.0]
    assert [value for _, value, _ in entries(program, Channel.POWDER_G_MIN)] == [POWDER, POWDER]


def test_powder_is_awaited_on_the_way_down_and_the_laser_level_is_set_beforehand(hybrid: Program) -> None:
    powder = [row for row in hybrid.schedule if row["channel"] == Channel.POWDER_G_MIN]
    assert len(powder) == 1 and powder[0]["barrier"] == 1 and powder[0]["value"] == POWDER
    down = hybrid.table[int(powder[0]["n"]) - 1]
    assert down["kind"] == LineKind.LINK and down["tip_end"][2] == pytest.approx(0.0, abs=1e-9)
    gate = next(k for k, line in enumerate(hybrid.lines) if line.endswith("M62 P0")) + 1
    level = [row for row in hybrid.schedule if row["channel"] == Channel.LASER_W]
    assert [float(row["value"]) for row in level] == [LASER_W] and int(level[0]["n"]) < gate


def test_powder_and_gas_are_steady_before_any_line_that_emits(hybrid: Program) -> None:
    reading = read(hybrid)
    first = int(np.argmax(reading.gate)) + 1
    early = {Channel(int(row["channel"])) for row in hybrid.schedule if row["n"] < first and row["barrier"]}
    assert {Channel.MODE, Channel.POWDER_G_MIN, Channel.SHIELD_GAS_L_MIN, Channel.CARRIER_GAS_L_MIN} <= early


def test_a_change_of_power_within_a_pass_stands_at_the_start_of_a_line(trunnion: Cell) -> None:
    operation = fill_operation(0)
    rows = np.array([[0.0, 12.0, 800.0, 12.0, 15.0], [7.3, 10.0, 1000.0, 14.0, 15.0]])
    passes = (operation.passes[0], replace(operation.passes[1], setpoints=rows), operation.passes[2])
    program = post(plan_of([replace(operation, passes=passes)]), trunnion)
    assert [value for _, value, _ in entries(program, Channel.LASER_W)] == [800.0, 1000.0]
    change = [row for row in program.schedule if row["channel"] == Channel.LASER_W][1]
    line = program.table[int(change["n"]) - 1]
    assert line["arc_start_mm"] == pytest.approx(7.3, abs=1e-9)
    assert program.lines[int(change["n"]) - 1].endswith("F600")
    assert entries(program, Channel.POWDER_G_MIN)[1][1:] == (14.0, 0)


def test_dwell_makes_up_what_a_layer_is_too_quick(trunnion: Cell) -> None:
    program = post(plan_of([contour_operation(0)], [contour_operation(1, interpass_s=60.0)]), trunnion)
    dwell = next(k for k, line in enumerate(program.lines) if " G4 P" in line)
    first_bead = next(k for k, line in enumerate(program.lines) if line.endswith("M62 P0")) + 1
    since = program.table["time_end_s"][dwell] - program.table["time_start_s"][first_bead]
    assert 60.0 <= since < 60.02
    assert program.table["kind"][dwell] == LineKind.DWELL


def test_no_dwell_where_the_layer_took_long_enough(trunnion: Cell) -> None:
    program = post(plan_of([contour_operation(0)], [contour_operation(1, interpass_s=5.0)]), trunnion)
    assert not any(" G4 P" in line for line in program.lines)
    assert program.layer_starts.tolist()[-1] == len(program.lines)


def test_layer_starts_divide_the_lines_by_layer(hybrid: Program) -> None:
    setup, second, end = hybrid.layer_starts.tolist()
    assert np.all(hybrid.table["layer"][:setup] == -1)
    assert np.all(hybrid.table["layer"][setup:second] == 0)
    assert np.all(hybrid.table["layer"][second:] == 1) and end == len(hybrid.lines)


def test_no_word_is_said_twice(hybrid: Program) -> None:
    stands: dict[str, str] = {}
    named = 0
    for line in hybrid.lines:
        for letter, value in re.findall(r"([XYZAC])([-\d.]+)", line.split("(")[0]):
            named += stands.get(letter) == value
            stands[letter] = value
    assert named <= 5  # the first full position names every axis
    feeds = [line for line in hybrid.lines if "F" in line and "G93" not in line]
    assert len(feeds) < 0.1 * len(hybrid.lines)


def test_same_plan_and_cell_give_the_same_program(trunnion: Cell, hybrid: Program) -> None:
    again = post(hybrid_plan(), trunnion)
    assert again.lines == hybrid.lines
    assert again.table.tobytes() == hybrid.table.tobytes() and again.schedule.tobytes() == hybrid.schedule.tobytes()


def test_placement_moves_joints_and_not_the_tip_in_the_part(trunnion: Cell, hybrid: Program) -> None:
    placement = trunnion.placement.model_copy(
        update={
            "part_origin_mm": (7.0, -4.0, -410.0),
            "rotation_deg": 30.0,
            "pivots_mm": {"A": (0.0, 0.1, -450.2)},
            "work_offset": {"Z": -400.0},
        }
    )
    program = post(hybrid_plan(), trunnion, placement)
    ours, theirs = (
        p.table[(p.table["kind"] == LineKind.PROCESS) & (p.table["operation"] == 0)]["tip_end"][-1]
        for p in (program, hybrid)
    )
    assert np.abs(ours - theirs).max() < 2e-3
    assert not np.allclose(program.table["joints_end"][-20], hybrid.table["joints_end"][-20])
    assert program.work_offset.tolist() == [0.0, 0.0, -400.0, 0.0, 0.0]


def test_many_turns_are_wound_back_beside_rapid_links_only(trunnion: Cell) -> None:
    axes = tuple(
        axis.model_copy(update={"min": -700.0, "max": 700.0}) if axis.letter == "C" else axis for axis in trunnion.axes
    )
    cell = trunnion.model_copy(update={"axes": axes})
    program, report = post_with_report(plan_of([cone_operation(0, turns=6)]), cell)
    turns = program.table["joints_end"][:, 4]
    assert np.abs(turns).max() <= 700.0
    assert report.counts.positionings >= 1
    process = program.table["kind"] == LineKind.PROCESS
    swept = np.abs(np.diff(turns, prepend=turns[0]))[process]
    assert np.allclose(swept, 360.0, atol=1e-3)


def test_an_axis_that_crosses_the_pole_beside_the_rotary_axis_stays_within_tolerance(trunnion: Cell) -> None:
    # The tool leans from +10 over a point 0.5 deg beside the pole to -10: the table turns by nearly half a turn near the pole.
    tip = link((-15.0, 3.0, 2.0), (15.0, 3.0, 2.0)).tip
    lean = np.deg2rad(np.linspace(-10.0, 10.0, 41))
    vectors = np.column_stack([np.sin(lean), np.full(41, np.sin(np.deg2rad(0.5))), np.cos(lean)])
    axis = type(tip)(1, np.concatenate([[0.0], np.linspace(0.0, 1.0, 41), [1.0]]), vectors)
    item = Pass(tip, axis, np.array([[0.0, 8.0, 0.0, 0.0, 0.0]]))
    operation = Operation(Process.MILL_SIDE, 0, (item,), cutter_diameter_mm=8.0, spindle_rpm=3000.0)
    for name in ("trunnion_tcp", "head_head", "head_table"):
        cell = load_cell(name)
        program, report = post_with_report(plan_of([operation]), cell)
        assert report.reread.max_tip_mm <= cell.chord_tolerance_mm
        assert report.reread.max_axis_deg <= cell.axis_tolerance_deg
        assert report.speed.limited_blocks > 0
        _assert_velocities(program, cell)


def _assert_velocities(program: Program, cell: Cell) -> None:
    reading = read(program)
    limits = np.array([axis.max_velocity for axis in cell.axes])
    feeds = reading.is_motion & ~reading.is_rapid
    steps = np.abs(np.diff(reading.joints, axis=0))[feeds]
    assert np.all(steps / reading.time_s[feeds, None] <= limits * 1.001 + 1e-3 / reading.time_s[feeds, None])


def test_no_move_is_shorter_than_the_controller_takes(trunnion: Cell) -> None:
    slow = trunnion.model_copy(update={"cnc": trunnion.cnc.model_copy(update={"max_blocks_per_s": 8.0, "takes_arcs": False})})
    program, report = post_with_report(plan_of([contour_operation(0)]), slow)
    reading = read(program)
    feeds = reading.is_motion & ~reading.is_rapid
    assert reading.time_s[feeds].min() >= 0.99 / 8.0
    assert report.speed.slowed_blocks > 0 and any("max_blocks_per_s" in line for line in report.findings)


def test_a_noisy_axis_at_the_pole_does_not_turn_the_table(trunnion: Cell) -> None:
    tip = circle(15.0, 0.0)
    wobble = cone_axis(tip, 0.005)  # less than a quarter of the axis tolerance
    item = Pass(tip, wobble, np.array([[0.0, 8.0, 0.0, 0.0, 0.0]]))
    operation = Operation(Process.MILL_SIDE, 0, (item,), cutter_diameter_mm=8.0, spindle_rpm=3000.0)
    program = post(plan_of([operation]), trunnion)
    assert np.ptp(program.table["joints_end"][:, 4]) < 1e-9


def test_a_tilt_that_cannot_change_sign_turns_the_table_at_the_pole_instead(trunnion: Cell) -> None:
    axes = tuple(axis.model_copy(update={"min": -0.01}) if axis.letter == "A" else axis for axis in trunnion.axes)
    cell = trunnion.model_copy(update={"axes": axes})
    tip = link((0.0, -15.0, 2.0), (0.0, 15.0, 2.0)).tip
    lean = np.deg2rad(np.linspace(-10.0, 10.0, 41))
    vectors = np.column_stack([np.zeros(41), np.sin(lean), np.cos(lean)])
    axis = type(tip)(1, np.concatenate([[0.0], np.linspace(0.0, 1.0, 41), [1.0]]), vectors)
    item = Pass(tip, axis, np.array([[0.0, 8.0, 0.0, 0.0, 0.0]]))
    operation = Operation(Process.MILL_SIDE, 0, (item,), cutter_diameter_mm=8.0, spindle_rpm=3000.0)
    program, report = post_with_report(plan_of([operation]), cell)
    process = program.table[program.table["kind"] == LineKind.PROCESS]
    assert report.reread.max_tip_mm <= cell.chord_tolerance_mm and report.reread.max_axis_deg <= cell.axis_tolerance_deg
    assert process["joints_end"][:, 3].min() >= -0.01 and np.ptp(process["joints_end"][:, 4]) == pytest.approx(
        180.0, abs=1.0
    )


def test_a_damaged_text_is_seen_by_the_reread(trunnion: Cell, hybrid: Program) -> None:
    lines = list(hybrid.lines)
    row = next(k for k, line in enumerate(lines) if k > 30 and re.search(r"X-?\d+\.\d+Y", line))
    lines[row] = re.sub(r"X(-?\d+)\.", lambda match: f"X{int(match[1]) + 1}.", lines[row])
    report = check(replace(hybrid, lines=tuple(lines)), hybrid_plan(), trunnion)
    assert report.max_tip_mm > 0.1
    with pytest.raises(PostError, match="off the plan"):
        verify(report, trunnion)


def test_an_open_gate_on_a_link_is_seen_by_the_reread(trunnion: Cell, hybrid: Program) -> None:
    lines = [line.replace("M63", "M62") for line in hybrid.lines]
    report = check(replace(hybrid, lines=tuple(lines)), hybrid_plan(), trunnion)
    assert not report.setpoints_ok
    with pytest.raises(PostError, match="set-points"):
        verify(report, trunnion)


def test_a_standing_spindle_and_a_wrong_tool_are_seen_by_the_reread(trunnion: Cell, hybrid: Program) -> None:
    standing = tuple(line.replace("M3 S3580", "M5") for line in hybrid.lines)
    assert "spindle" in check(replace(hybrid, lines=standing), hybrid_plan(), trunnion).faults[0]
    wrong = tuple(line.replace("M6 T2", "M6 T3") for line in hybrid.lines)
    assert "another tool" in check(replace(hybrid, lines=wrong), hybrid_plan(), trunnion).faults[0]


def test_inverse_time_without_its_feed_cannot_be_read_back(hybrid: Program) -> None:
    lines = tuple(line.split("F")[0] if "G93" in line else line for line in hybrid.lines)
    with pytest.raises(PostError, match="has no feed"):
        read(replace(hybrid, lines=lines))


def test_a_part_larger_than_the_build_volume_is_refused_with_dimension_and_excess(trunnion: Cell) -> None:
    with pytest.raises(
        PostError, match=r"the part is 400.0 mm in X on the table, the build volume 200.0 mm: 200.0 mm too large"
    ) as caught:
        post(plan_of([contour_operation(0)], half_mm=200.0), trunnion)
    assert caught.value.hint and "\n" not in caught.value.message


def test_a_part_beside_the_build_volume_is_refused_with_the_way_back(trunnion: Cell) -> None:
    placement = trunnion.placement.model_copy(update={"part_origin_mm": (90.0, 0.0, -420.0)})
    with pytest.raises(PostError, match=r"leaves the build volume by 10.0 mm in X") as caught:
        post(plan_of([contour_operation(0)]), trunnion, placement)
    assert "-10.0 mm in X" in caught.value.hint


def test_a_part_out_of_reach_of_a_linear_axis_is_refused_before_a_line_is_made(trunnion: Cell) -> None:
    tools = tuple(
        tool.model_copy(update={"tip_mm": (300.0, 0.0, -160.0)}) if tool.number == 1 else tool
        for tool in trunnion.tools
    )
    with pytest.raises(
        PostError,
        match=r"axis X: the part needs -320.0 ... -280.0 mm with tool 1, travel is -260 ... 260 mm: 60.0 mm too far",
    ):
        post(plan_of([contour_operation(0)]), trunnion.model_copy(update={"tools": tools}))


def test_a_lean_beyond_the_tilting_axis_is_refused_with_axis_limit_operation_and_place(trunnion: Cell) -> None:
    axes = tuple(
        axis.model_copy(update={"min": -5.0, "max": 15.0}) if axis.letter == "A" else axis for axis in trunnion.axes
    )
    with pytest.raises(
        TravelLimitError,
        match=r"axis A: .* deg asked, limit .* deg, pass 0 of operation 0 \(mill_side\), layer 0, at x",
    ):
        post(plan_of([cone_operation(0)]), trunnion.model_copy(update={"axes": axes}))


def test_an_axis_that_no_pose_reaches_is_refused() -> None:
    # A head whose second joint is tilted by 30 degrees brings the tool down to 60 degrees from upright at most.
    cell = load_cell("head_head")
    way = (0.0, float(np.sin(np.deg2rad(30.0))), float(np.cos(np.deg2rad(30.0))))
    head = tuple(
        joint.model_copy(update={"direction": way}) if joint.axis == "B" else joint for joint in cell.kinematics.head
    )
    kinematics = cell.kinematics.model_copy(update={"head": head})
    tilted = cell.model_copy(update={"kinematics": kinematics, "machine": None})  # whose bodies are drawn for another head
    assert post(plan_of([cone_operation(0, lean_deg=20.0)]), tilted).lines
    with pytest.raises(ReachError, match="C and B cannot bring the tool axis to"):
        post(plan_of([cone_operation(0, lean_deg=70.0)]), tilted)


def test_a_missing_cutter_is_refused_with_what_is_there(trunnion: Cell) -> None:
    with pytest.raises(
        PostError, match=r"no end_mill or bull_nose or ball_mill of 5 mm .* tool 2 end_mill 8 mm, tool 3 end_mill 4 mm, tool 4 ball_mill 6 mm"
    ):
        post(plan_of([cone_operation(0, diameter=5.0)]), trunnion)


def test_a_spindle_speed_above_the_tools_is_refused(trunnion: Cell) -> None:
    operation = replace(cone_operation(0), spindle_rpm=20000.0)
    with pytest.raises(PostError, match="20000 1/min asked, tool 2 allows 18000"):
        post(plan_of([operation]), trunnion)


def test_an_unknown_dialect_and_an_empty_plan_are_refused(trunnion: Cell) -> None:
    with pytest.raises(PostError, match="no dialect 'klartext'"):
        post(hybrid_plan(), trunnion, dialect="klartext")
    with pytest.raises(PostError, match="nothing to run"):
        post(plan_of([]), trunnion)


def test_a_feed_of_zero_is_refused(trunnion: Cell) -> None:
    operation = fill_operation(0)
    rows = operation.passes[1].setpoints.copy()
    rows[1, 1] = 0.0
    passes = (operation.passes[0], replace(operation.passes[1], setpoints=rows))
    with pytest.raises(PostError, match=r"pass 1 of operation 0 .*feed of 0 mm/s does not move"):
        post(plan_of([replace(operation, passes=passes)]), trunnion)
