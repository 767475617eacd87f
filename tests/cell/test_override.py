"""Feed override: the machine goes slower, the laser's power follows, and who has no control changes nothing."""

from __future__ import annotations

import pytest

from tests.cell.harness import CellUnderTest
from tests.cell.jobs import FEED_MM_S, POWER_W, one_wall


async def test_half_the_feed_is_half_the_power_and_the_prediction_knows_it_at_once(cell: CellUnderTest) -> None:
    await cell.deposit(layers=1, mill=False, pieces=20)
    reply = await cell.command("override", feed_percent=50)
    assert reply.ok, reply.error
    assert cell.controller.run is not None and cell.controller.run.follower.override == 0.5
    await cell.forward(seconds=0.7)
    assert cell.sim.tip_speed_mm_s == pytest.approx(0.5 * FEED_MM_S, rel=0.05)
    assert cell.sim.laser_emission_w == pytest.approx(0.5 * POWER_W, rel=0.1)
    assert cell.has_event("command", "override")


async def test_override_out_of_bounds_or_without_control_changes_nothing(cell: CellUnderTest) -> None:
    assert (await cell.command("take_control", client="bench")).ok
    assert not (await cell.command("override", client="other", feed_percent=50)).ok
    for percent in (9, 201, None, 50.5, True):
        assert not (await cell.command("override", client="bench", feed_percent=percent)).ok
    assert cell.sim.cnc.overrides[0] == 100


async def test_a_new_job_begins_with_the_feed_as_programmed(cell: CellUnderTest) -> None:
    assert (await cell.command("override", feed_percent=40)).ok
    await cell.forward(seconds=3)
    assert cell.sim.cnc.overrides[0] == 40 == cell.snapshot.cnc.feed_override
    assert (await cell.start(one_wall(cell.facts, layers=1, pieces=2, length_mm=8.0, mill=False))).ok
    await cell.forward(ticks=20)
    assert cell.sim.cnc.overrides[0] == 100
