"""Laser power and powder follow the tip's actual speed: levels by numbers, and energy per length on the simulated plant."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from config.cell import Cell, load_cell
from config.device import load_device
from planner.nurbs.curve import Curve
from planner.plan import Operation, Pass, Process
from planner.post import post_with_report
from planner.post.per_length import OFF, is_off
from planner.post.posting import PostReport
from planner.post.tracking import POWDER_RISE, track
from planner.program import Channel, Program
from sim.schedule import IdealController
from sim.world import World
from tests.unit.planner.hand_plan import (
    FEED_MM_S,
    GAS,
    LASER_W,
    LEAD_MM,
    POWDER,
    bead,
    circle,
    cone_axis,
    link,
    plan_of,
)

WRITE_S = 0.02
SPOT_MM = 2.0
UP = np.array([0.0, 0.0, 6.0])
FLOOR_W = 600.0

Array = np.ndarray


# -- levels ------------------------------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=25)
@given(st.lists(st.tuples(st.floats(0.5, 1.0), st.floats(0.002, 0.3)), min_size=1, max_size=30))
def test_in_every_stretch_the_energy_is_that_of_the_plan_per_length_but_for_what_a_write_takes(
    moves: list[tuple[float, float]],
) -> None:
    share, time_s = np.array(moves).T
    planned, floor = np.full(len(share), LASER_W), np.full(len(share), FLOOR_W)
    levels = track(planned, share, time_s, floor, 0.5 * WRITE_S, WRITE_S, 0.0)
    assert not is_off(levels, planned, share, time_s, FLOOR_W, 1.5 * WRITE_S).any()
    change = np.flatnonzero(np.diff(levels)) + 1
    begins = np.concatenate([[0.0], np.cumsum(time_s)])[change]
    assert np.all(np.diff(np.append(0.0, begins)) >= WRITE_S - 1e-12)
    assert np.all((levels >= FLOOR_W) & (levels <= LASER_W * (1.0 + 0.025)))


def test_speed_within_the_tolerance_changes_no_level() -> None:
    share = 1.0 - 0.02 * np.random.default_rng(1).random(500)
    planned = np.full(500, LASER_W)
    assert np.all(track(planned, share, np.full(500, 0.1), np.full(500, FLOOR_W), 0.01, WRITE_S, 0.0) == LASER_W)


def test_power_stays_where_the_process_window_ends() -> None:
    share = np.repeat([1.0, 0.2, 1.0], 50)
    planned = np.full(150, LASER_W)
    levels = track(planned, share, np.full(150, 0.02), np.full(150, FLOOR_W), 0.01, WRITE_S, 0.0)
    assert levels[75] == pytest.approx(FLOOR_W, rel=0.03) and levels[0] == levels[-1] == LASER_W


def test_powder_rises_no_faster_than_it_comes_through_the_hose() -> None:
    share = np.repeat([1.0, 0.4, 1.0, 1.0], 400)
    planned = np.full(1600, POWDER)
    levels = track(planned, share, np.full(1600, 0.05), np.full(1600, 4.0), 1.2, 2.4, POWDER_RISE)
    steps = levels[1:] / levels[:-1]
    assert levels.min() == pytest.approx(0.4 * POWDER, rel=0.03) and levels[-1] == pytest.approx(POWDER, rel=0.03)
    assert steps.max() <= POWDER_RISE + 0.01
    assert np.all(np.diff(np.flatnonzero(steps != 1.0)) * 0.05 >= 2.4 - 1e-9)


def test_too_much_energy_over_a_slow_stretch_is_seen() -> None:
    share, time_s = np.repeat([1.0, 0.6, 1.0], 20), np.full(60, 0.05)
    planned = np.full(60, LASER_W)
    assert is_off(planned, planned, share, time_s, FLOOR_W, 1.5 * WRITE_S).any()
    assert not is_off(planned * share, planned, share, time_s, FLOOR_W, 0.0).any()
    assert is_off(planned * share * (1.0 + 2.0 * OFF), planned, share, time_s, FLOOR_W, 1.5 * WRITE_S).any()


# -- the plant ---------------------------------------------------------------------------------------------------------


def run(program: Program, cell: Cell) -> tuple[Array, Array, Array, Array]:
    """Line, way of the tip (mm), energy (J) and powder (g) of every piece of motion with light, in the simulated cell."""
    world = World(cell, {role: load_device(item.device) for role, item in cell.links.items()}, dead_man=False)
    controller = IdealController(program, world)
    world.cnc.supply = controller.supply
    seen: list[Array] = []
    while not controller.is_done:
        step_s = max(min(0.1 if controller.is_waiting else 0.5, controller.until_next_s), 0.005)
        controller.begin_step(step_s)
        world.step(step_s)
        trace = world.trace
        lit = trace.emission_w > 1.0
        way = np.linalg.norm(trace.tip1 - trace.tip0, axis=1)
        rows = np.column_stack([trace.line, way, trace.emission_w * trace.dt, trace.powder_g_min * trace.dt / 60.0])
        seen.append(rows[lit])
        for text in world.cnc.transmit().decode().splitlines():
            assert not text.startswith(("error", "ALARM")), text
            controller.hear(text)
        assert controller.step() == ""
    line, way, energy, powder = np.vstack(seen).T
    return line, way, energy, powder


def per_spot(way: Array, amount: Array) -> Array:
    """Amount per length over each stretch as long as the spot, along the way."""
    reached, total = np.append(0.0, np.cumsum(way)), np.append(0.0, np.cumsum(amount))
    begin = np.arange(0.0, reached[-1] - SPOT_MM, 0.25)
    return np.asarray((np.interp(begin + SPOT_MM, reached, total) - np.interp(begin, reached, total)) / SPOT_MM)


def posted(passes: list[Pass], cell: Cell) -> tuple[Program, PostReport]:
    return post_with_report(plan_of([Operation(Process.DEPOSIT_CONTOUR, 0, tuple(passes), bead_width_mm=2.0)]), cell)


def zigzag() -> Curve:
    """A contour of sharp corners: 60, 90, 135 and 170 degrees."""
    turns = np.cumsum(np.deg2rad([0.0, 60.0, 90.0, -135.0, 90.0, -170.0, 90.0, 90.0]))
    return Curve.from_polyline(
        np.vstack(
            [[0.0, 0.0, 0.0], np.cumsum(9.0 * np.column_stack([np.cos(turns), np.sin(turns), 0.0 * turns]), axis=0)]
        )
    )


def test_round_sharp_corners_energy_per_length_stays_as_planned_but_within_a_spot_of_the_sharpest() -> None:
    cell = load_cell("trunnion_tcp")
    tip = zigzag()
    start, end = tip.control_points[0], tip.control_points[-1]
    program, _ = posted(
        [link((start + UP).tolist(), start.tolist()), bead(tip), link(end.tolist(), (end + UP).tolist())], cell
    )
    _, way, energy, _ = run(program, cell)
    ratio = per_spot(way, energy) / (LASER_W / FEED_MM_S)
    inner = ratio[20:-20]  # the laser's own ramp at both ends
    assert np.abs(inner - 1.0).max() < 0.05


def slowed_pass(cell: Cell) -> list[Pass]:
    """A circle with the head leaning outward: the table turns once round at the speed of the tip."""
    tip = circle(12.0, 2.0)
    axis = cone_axis(tip, 10.0)
    first = axis.evaluate([axis.domain[0]])[0]
    first = first / np.linalg.norm(first)
    start = np.array([12.0, 0.0, 2.0])
    rows = bead(tip).setpoints
    lead = link((start + 6.0 * first).tolist(), start.tolist(), axis=first)
    return [lead, Pass(tip, axis, rows), link(start.tolist(), (start + 6.0 * first).tolist(), axis=first)]


def slow_cell(share: float) -> Cell:
    """A cell whose table turns, and whose linear axes move, at a share of what the circle asks: no way round helps."""
    cell = load_cell("trunnion_tcp")
    most = {"C": share * float(np.rad2deg(FEED_MM_S / 12.0)), "X": share * FEED_MM_S, "Y": share * FEED_MM_S}
    axes = tuple(
        axis.model_copy(update={"max_velocity": most.get(axis.letter, axis.max_velocity)}) for axis in cell.axes
    )
    return cell.model_copy(update={"axes": axes})


def test_a_five_axis_pass_that_the_axes_cannot_follow_gets_as_much_energy_per_length_and_says_so() -> None:
    cell = slow_cell(0.7)
    program, report = posted(slowed_pass(cell), cell)
    _, way, energy, _ = run(program, cell)
    assert np.abs(per_spot(way, energy)[20:-20] / (LASER_W / FEED_MM_S) - 1.0).max() < 0.05
    (slowed,) = report.speed.slowed
    assert slowed.why.startswith("velocity of axis") and slowed.share == pytest.approx(0.7, abs=0.02)
    assert slowed.length_mm > 20.0
    assert any("velocity of axis" in line for line in report.findings)


def test_a_long_slow_pass_gets_less_powder_too_once_it_has_come_through_the_hose() -> None:
    cell = slow_cell(0.7)
    tip = Curve.from_polyline(np.array([[-45.0, 0.0, 0.0], [45.0, 0.0, 0.0]]))
    start, end = tip.control_points
    program, _ = posted(
        [link((start + UP).tolist(), start.tolist()), bead(tip), link(end.tolist(), (end + UP).tolist())], cell
    )
    _, way, energy, powder = run(program, cell)
    assert np.abs(per_spot(way, energy)[20:-20] / (LASER_W / FEED_MM_S) - 1.0).max() < 0.05
    grams = per_spot(way, powder) / (POWDER / 60.0 / FEED_MM_S)
    settled = grams[len(grams) // 2 :]
    assert np.abs(settled - 1.0).max() < 0.05


def test_power_of_the_schedule_is_scaled_and_no_more_often_than_the_link_can_take() -> None:
    cell = slow_cell(0.7)
    program, _ = posted(slowed_pass(cell), cell)
    levels = program.schedule[program.schedule["channel"] == Channel.LASER_W]
    assert levels["value"].min() == pytest.approx(0.7 * LASER_W, rel=0.03)
    begins = program.table["time_start_s"][levels["n"] - 1]
    assert np.all(np.diff(begins) >= cell.response.laser_write_s - 1e-9)


@pytest.mark.parametrize("name", ["trunnion_tcp", "trunnion_rtu", "head_head", "head_table"])
def test_the_whole_time_of_a_job_with_its_waits_is_predicted_within_three_per_cent(name: str) -> None:
    cell = load_cell(name)
    tip = zigzag()
    start, end = tip.control_points[0], tip.control_points[-1]
    program, report = posted(
        [link((start + UP).tolist(), start.tolist()), bead(tip, LEAD_MM), link(end.tolist(), (end + UP).tolist())], cell
    )
    world = World(cell, {role: load_device(item.device) for role, item in cell.links.items()}, dead_man=False)
    controller = IdealController(program, world)
    world.cnc.supply = controller.supply
    while not controller.is_done:
        controller.begin_step(0.02)
        world.step(0.02)
        for text in world.cnc.transmit().decode().splitlines():
            controller.hear(text)
        controller.step()
    assert report.speed.total_s == pytest.approx(world.time_s, rel=0.03)
    assert GAS > 0.0 and report.speed.waits_s > cell.limits.purge_s
