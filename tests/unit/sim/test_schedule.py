"""Steps of time of a proof: each ends where the line of the next set-point begins, and none is shorter than it has to be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from config import load_material
from planner.program import Channel
from sim.cnc import lookahead as la
from sim.cnc.actions import FEED
from sim.cnc.motion import Motion
from sim.dryrun import FINE_STEP_S, DryRun
from tests.unit.sim.test_dryrun import CELL, CELL_MM, part, program


def with_levels() -> DryRun:
    """The block with a level for every fourth line of its first layer, arcs and dwells among them."""
    given = program()
    lines = np.flatnonzero(given.table["layer"] == 0)[8::4] + 1
    rows = np.zeros(len(lines), dtype=given.schedule.dtype)
    rows["n"], rows["channel"], rows["value"] = lines, Channel.LASER_W, 1000.0 + np.arange(len(lines))
    schedule = np.concatenate([given.schedule, rows])
    changed = replace(given, schedule=schedule[np.argsort(schedule["n"], kind="stable")])
    return DryRun(changed, CELL, part(), load_material("316L"), None, CELL_MM)


def test_level_is_set_within_the_least_step_of_its_line_s_begin_and_few_steps_are_that_short() -> None:
    run = with_levels()
    controller, motion = run.controller, run.world.cnc.machine.motion
    events = controller._event_lines
    late = [0.0]
    while not controller.is_done and controller._next_event < len(events):
        line, boundary = events[controller._next_event], controller.boundary
        run.advance()
        if boundary == 0 or line < boundary:
            pieces = motion.pieces
            late.append(float(pieces[pieces[:, la.PIECE_LINE] >= line, la.DURATION].sum()))
    assert not run.is_over
    assert max(late) <= FINE_STEP_S + 1e-9
    assert len(late) < 12.0 * run.world.time_s  # 200 a second, were all steps the least


def test_lines_begin_sooner_at_a_higher_feed_override() -> None:
    motion = Motion(CELL.axes, 10, [0.0] * 5)
    for line in (1, 2, 3):
        motion.append([-10.0 * line, 0.0, 0.0, 0.0, 0.0], FEED, 600.0, line)
    assert motion.planned_before_s(3) == pytest.approx(2.0)
    motion.override(2.0, 1.0)
    assert motion.planned_before_s(3) == pytest.approx(1.0)
