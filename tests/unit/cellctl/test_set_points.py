"""When a set-point has to be sent: before its place on the path by as much as its device takes, and only where the machine may come."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from cellctl.cell.set_points import HORIZON_S, LASER_CHANNELS, Leads, SetPoints
from cellctl.domain.sync import Follower
from config.cell import load_cell
from planner.program import SCHEDULE_DTYPE, Channel, Program
from tests.cell.jobs import one_wall
from tests.unit.cellctl.test_domain_sync import LENGTH, LINES, SPEED, at, line_of, straight

LEAD_S = 0.03
EMISSION_LINE, POWER_LINE = 3, 9  # N-words


class FixedLeads:
    """A laser that takes 30 ms for whatever it is told; all else is there at once."""

    def of(self, channel: Channel, value: float, rate: float) -> float:
        return LEAD_S if channel in LASER_CHANNELS else 0.0


def program() -> Program:
    """LINES lines; light at one, another level at a later one, and a barrier between them."""
    rows = [(EMISSION_LINE, Channel.EMISSION, 0, 1.0), (4, Channel.SHIELD_GAS_L_MIN, 1, 5.0), (POWER_LINE, Channel.LASER_W, 0, 900.0)]
    return replace(one_wall(load_cell("trunnion_rtu")), schedule=np.array(rows, dtype=SCHEDULE_DTYPE))


def running_at(x: float, *, is_run: bool = True) -> SetPoints:
    """A machine at SPEED that was reported at x mm at wire time 1."""
    follower = Follower(straight(), 0.1)
    for k in range(2):
        place = x - SPEED * 0.1 * (1 - k)
        follower.report(line_of(place), at(place), 0.9 + 0.1 * k, is_run=is_run, feed=600.0)
    return SetPoints(program(), straight(), follower, cast("Leads", FixedLeads()))


def begins_s(n: int, x: float) -> float:
    """Wire time at which the line of an N-word begins for a machine that is at x at time 1."""
    return 1.0 + ((n - 2) * LENGTH - x) / SPEED


def test_next_set_point_is_due_by_its_devices_time_before_its_line_begins() -> None:
    points = running_at(1.5)
    assert points.due_at(1.0, LINES) == pytest.approx(begins_s(EMISSION_LINE, 1.5) - LEAD_S, abs=1e-6)
    points = running_at(14.0)
    assert points.due_at(1.0, LINES, (Channel.LASER_W,)) == pytest.approx(begins_s(POWER_LINE, 14.0) - LEAD_S, abs=1e-6)


def test_due_time_stays_the_same_while_it_comes_near_and_lies_in_the_past_for_one_that_is_overdue() -> None:
    points = running_at(1.5)
    due = points.due_at(1.0, LINES)
    assert due is not None
    assert points.due_at(due - 0.001, LINES) == pytest.approx(due, abs=1e-9)
    assert points.due_at(due + 0.1, LINES) == pytest.approx(due, abs=1e-9)
    assert list(points.take(due - 0.005, 1, LINES)) == []
    assert list(points.take(due, 1, LINES)) == [(Channel.EMISSION, 1.0)]


def test_what_was_taken_is_due_no_more_and_the_next_one_is() -> None:
    points = running_at(14.0)
    assert list(points.take(1.0, 5, LINES)) == [(Channel.EMISSION, 1.0)]
    assert points.due_at(1.0, LINES) == pytest.approx(begins_s(POWER_LINE, 14.0) - LEAD_S, abs=1e-6)


@pytest.mark.parametrize(("released", "is_in_sight"), [(EMISSION_LINE, True), (EMISSION_LINE - 1, False)])
def test_nothing_is_due_of_a_line_that_was_not_released(released: int, is_in_sight: bool) -> None:
    points = running_at(1.5)
    assert (points.due_at(1.0, released) is not None) == is_in_sight


def test_nothing_is_due_of_a_machine_that_stands_or_far_ahead() -> None:
    points = running_at(1.5, is_run=False)
    assert points.due_at(1.0, LINES) is None
    points = running_at(1.5)
    assert begins_s(POWER_LINE, 1.5) - 1.0 > HORIZON_S
    assert points.due_at(1.0, LINES, (Channel.LASER_W,)) is None


def test_barrier_is_never_due_by_time() -> None:
    points = running_at(1.5)
    taken: list[Any] = list(points.take(60.0, LINES - 1, LINES))
    assert {channel for channel, _ in taken} == {Channel.EMISSION, Channel.LASER_W}
    assert points.due_at(60.0, LINES) is None
