"""Feed override: the machine goes slower, the laser's power follows, and who has no control changes nothing."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cellctl.domain.states import State
from planner.program import ProcessWindow
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import FEED_MM_S, POWDER_G_MIN, POWER_W, one_wall


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


async def test_laser_at_110_percent_is_110_percent_at_the_plant_and_a_new_job_begins_at_100(cell: CellUnderTest) -> None:
    await cell.deposit(layers=1, mill=False, pieces=20)
    assert (cell.snapshot.overrides.laser_min, cell.snapshot.overrides.laser_max) == (75, 200)  # 600 to 2000 W at 800 W
    assert (await cell.command("override", laser_percent=110)).ok
    await cell.forward(seconds=0.4)
    assert cell.is_depositing()
    assert cell.sim.laser.values["power_readback"] == pytest.approx(1.1 * POWER_W, rel=0.03)
    assert cell.snapshot.overrides.laser_percent == 110
    assert cell.has_event("override", "laser 110 % by tester")
    await cell.hurry(lambda: cell.outcome == "completed")
    assert cell.max_standstill_emission_w < 1.0
    assert (await cell.start(one_wall(cell.facts, layers=1, mill=False, pieces=20), job="job-2")).ok
    assert cell.snapshot.overrides.laser_percent == 100
    await cell.hurry(cell.is_depositing)
    await cell.forward(seconds=0.4)
    assert cell.sim.laser_emission_w == pytest.approx(POWER_W, rel=0.03)


async def test_powder_override_reaches_the_nozzle_and_its_way_there_is_no_fault(cell: CellUnderTest) -> None:
    await cell.deposit(layers=1, mill=False, pieces=60, length_mm=120.0)
    assert (await cell.command("override", powder_percent=150)).ok
    await cell.forward(seconds=0.1)
    assert cell.sim.feeder.values["rate_setpoint"] == pytest.approx(1.5 * POWDER_G_MIN)
    await cell.forward(seconds=5.0)
    assert cell.is_depositing() and not cell.latched
    assert cell.sim.feeder.rate_at_nozzle_g_min == pytest.approx(1.5 * POWDER_G_MIN, rel=0.02)
    assert (await cell.command("override", powder_percent=40)).ok
    await cell.forward(seconds=2.5)
    assert not cell.latched, "from 15 to 4 g/min takes longer than powder that is off its set-point may"


async def test_powder_that_fails_while_an_override_settles_is_still_a_fault(cell: CellUnderTest) -> None:
    await cell.deposit(layers=1, mill=False, pieces=60, length_mm=120.0)
    assert (await cell.command("override", powder_percent=80)).ok
    cell.sim.faults.add("feeder_clog")
    cell.sim.faults.strike(cell.sim)
    await cell.forward(until=lambda: bool(cell.latched), seconds=3.0)
    await cell.forward(ticks=3)
    assert cell.is_dark


async def test_held_at_an_override_goes_on_with_it(cell: CellUnderTest) -> None:
    await cell.deposit(layers=1, mill=False, pieces=60, length_mm=120.0)
    assert (await cell.command("hold")).ok
    await cell.forward(until=cell.is_state(State.HELD), seconds=10)
    assert (await cell.command("override", powder_percent=120, laser_percent=90)).ok
    assert cell.is_dark
    assert (await cell.command("resume")).ok
    await cell.forward(until=cell.is_depositing, seconds=30)
    await cell.forward(seconds=0.5)
    assert cell.sim.laser_emission_w == pytest.approx(0.9 * POWER_W, rel=0.03)
    assert cell.sim.feeder.rate_at_nozzle_g_min == pytest.approx(1.2 * POWDER_G_MIN, rel=0.06)


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"laser_percent": 74}, "at least 75 % (800 W as programmed would be 592 W; 600 W is the least of the material's window)"),
        ({"powder_percent": 201}, "at most 200 %"),
        ({"laser_percent": 110, "powder_percent": 30}, "at least 40 % (10 g/min"),
    ],
)
async def test_outside_of_the_materials_window_is_refused_with_bound_and_unit(cell: CellUnderTest, asked: dict[str, int], words: str) -> None:
    await cell.deposit(layers=1, mill=False, pieces=20)
    reply = await cell.command("override", **asked)
    assert not reply.ok and words in reply.error, reply.error
    assert cell.snapshot.overrides.laser_percent == 100 == cell.snapshot.overrides.powder_percent


async def test_without_a_job_laser_and_powder_have_no_window(cell: CellUnderTest) -> None:
    reply = await cell.command("override", laser_percent=90)
    assert not reply.ok and "no job" in reply.error


async def test_a_job_posted_with_the_shops_own_version_of_a_material_keeps_to_its_window_at_the_plant(cell: CellUnderTest) -> None:
    own = ProcessWindow("a" * 64, (0.9 * POWER_W, 1.1 * POWER_W), (POWDER_G_MIN, 1.2 * POWDER_G_MIN))
    program = replace(one_wall(cell.facts, layers=1, mill=False, pieces=20), material="a powder of ours", window=own)
    assert (await cell.start(program)).ok
    await cell.hurry(cell.is_depositing)
    shown = cell.snapshot.overrides
    assert (shown.laser_min, shown.laser_max, shown.powder_min, shown.powder_max) == (90, 110, 100, 120)
    beyond = await cell.command("override", laser_percent=111)
    assert not beyond.ok and f"{1.1 * POWER_W:g} W is the greatest of the material's window" in beyond.error
    assert (await cell.command("override", laser_percent=110)).ok
    await cell.forward(seconds=0.4)
    assert cell.is_depositing() and cell.sim.laser.values["power_readback"] == pytest.approx(1.1 * POWER_W, rel=0.03)
