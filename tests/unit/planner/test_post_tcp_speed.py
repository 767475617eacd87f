"""Five-axis programs where the axes are slow: feed, levels and predicted time agree, in every dialect."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from config.cell import Cell, load_cell
from planner.post.tcp import WRITERS
from planner.program import Channel, LineKind
from tests.unit.planner.hand_plan import FEED_MM_S, LASER_W, circle
from tests.unit.planner.tip_posts import assert_noticed, bead_pass, posted

SLOW_MM_S = 5.0


def slow_cell() -> Cell:
    """A cell whose Y axis cannot go at the feed."""
    cell = load_cell("trunnion_tcp")
    axes = [axis.model_copy(update={"max_velocity": SLOW_MM_S}) if axis.letter == "Y" else axis for axis in cell.axes]
    return cell.model_copy(update={"axes": tuple(axes)})


@pytest.mark.parametrize("dialect", sorted(WRITERS))
def test_where_an_axis_is_slow_feed_and_power_fall_together_and_energy_per_length_stays(dialect: str) -> None:
    made = posted(bead_pass(circle(15.0, 0.8)), dialect, slow_cell())
    report = made.read()
    assert not report.faults and report.max_feed_ratio <= 1.0001
    program = made.program
    rows = program.table[program.table["kind"] == LineKind.PROCESS]
    power = program.schedule[program.schedule["channel"] == Channel.LASER_W]
    watts = np.append(0.0, power["value"])[np.searchsorted(power["n"], rows["n"], side="right")]
    third = rows["arc_end_mm"].max() / 3.0
    lit = (rows["arc_start_mm"] > third - 0.01) & (rows["arc_end_mm"] < 2.0 * third + 0.01)
    energy_j = float((watts * (rows["time_end_s"] - rows["time_start_s"]))[lit].sum())
    length = float((rows["arc_end_mm"] - rows["arc_start_mm"])[lit].sum())
    assert watts[lit].min() < 0.8 * LASER_W
    assert energy_j / length == pytest.approx(LASER_W / FEED_MM_S, rel=0.06)


def test_the_reader_notices_a_power_that_does_not_follow_and_a_feed_that_no_axis_asks_for() -> None:
    made = posted(bead_pass(circle(15.0, 0.8)), "siemens", slow_cell())
    schedule = made.program.schedule.copy()
    schedule["value"][schedule["channel"] == Channel.LASER_W] = LASER_W
    lines = tuple(re.sub(r" H1=\d\S*", f" H1={LASER_W:g}", line) for line in made.program.lines)
    planned = replace(made, program=replace(made.program, lines=lines, schedule=schedule))
    assert any("laser energy per length" in fault for fault in planned.read().faults)
    fast = posted(bead_pass(circle(15.0, 0.8)), "siemens", load_cell("trunnion_tcp"))
    assert_noticed("a feed", fast.with_line(lambda t: " F720" in t, lambda t: t.replace("F720", "F600")))
