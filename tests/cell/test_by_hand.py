"""Motion by hand: behind a laser that is read back locked out, as long as a hand says so, and never on a position that nobody vouches for."""

from __future__ import annotations

import pytest

from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall


async def continuous(cell: CellUnderTest, ticks: int) -> None:
    """Hold the button of a continuous jog for so many ticks."""
    assert (await cell.command("jog", axis="X", distance=1.0, feed=3000.0, continuous=True)).ok
    for _ in range(ticks // 10):
        await cell.forward(ticks=10)
        assert (await cell.command("jog_keep")).data["is_jogging"]


async def test_a_continuous_jog_moves_while_it_is_kept_up_and_stops_when_it_is_let_go(cell: CellUnderTest) -> None:
    await continuous(cell, 100)
    assert 20.0 < cell.sim.joints[0] < 60.0
    assert (await cell.command("jog_end")).ok
    await cell.forward(until=cell.is_state(State.IDLE), seconds=1)
    stood = float(cell.sim.joints[0])
    await cell.forward(ticks=50)
    assert cell.sim.joints[0] == stood < 65.0


async def test_a_button_that_is_not_told_held_ends_the_jog(cell: CellUnderTest) -> None:
    await continuous(cell, 60)
    at = float(cell.sim.joints[0])
    await cell.forward(until=cell.is_state(State.IDLE), seconds=2)
    assert cell.sim.joints[0] - at <= 50.0 * (cell.facts.by_hand.jog_repeat_s + 0.25)


async def test_a_continuous_jog_ends_at_the_machine_when_the_cell_process_is_killed(cell: CellUnderTest) -> None:
    await continuous(cell, 60)
    at = float(cell.sim.joints[0])
    await cell.kill()
    await cell.forward(seconds=2.0)
    assert cell.is_still and cell.sim.joints[0] - at <= 50.0 * 0.4


async def test_a_continuous_jog_ends_at_the_end_of_travel(cell: CellUnderTest) -> None:
    await cell.command("jog", axis="X", distance=cell.facts.axis("X").max - 5.0, feed=15000.0)
    await cell.forward(until=cell.is_state(State.IDLE), seconds=5)
    assert (await cell.command("jog", axis="X", distance=1.0, feed=3000.0, continuous=True)).ok
    for _ in range(8):
        await cell.forward(ticks=10)
        await cell.command("jog_keep")
    await cell.forward(until=cell.is_state(State.IDLE), seconds=2)
    assert cell.sim.joints[0] == pytest.approx(cell.facts.axis("X").max, abs=2e-3)


async def test_motion_by_hand_begins_when_the_head_is_parked_and_the_laser_told_that_it_is_off(cell: CellUnderTest) -> None:
    await cell.deposit()
    await cell.command("stop")
    await cell.forward(seconds=2.0)
    await cell.command("reset")
    await cell.forward(until=cell.is_state(State.IDLE, State.UNHOMED), seconds=5)
    assert cell.sim.io.is_deployed
    before = cell.sim.joints.copy()
    await cell.command("home")
    await cell.forward(until=lambda: abs(cell.sim.joints - before).max() > 0.01, seconds=5)
    assert cell.sim.io.is_parked and cell.sim.laser.values["enable"] == cell.sim.laser.values["emission_permit"] == 0.0


async def test_a_head_that_does_not_park_lets_the_machine_only_be_lifted(cell: CellUnderTest) -> None:
    cell.sim.io.slide = 0.5
    cell.jam_head()
    await cell.forward(ticks=10)
    assert (await cell.command("jog", axis="Z", distance=-20.0, feed=3000.0)).ok
    await cell.forward(until=cell.is_state(State.FAULT), seconds=15)
    assert cell.sim.joints[2] == pytest.approx(cell.facts.axis("Z").home, abs=1e-3)


async def test_after_an_unlock_no_job_starts_until_somebody_vouches_for_the_position(cell: CellUnderTest) -> None:
    cell.sim.faults.add("alarm 1")
    await cell.forward(until=cell.is_state(State.UNHOMED), seconds=2)
    await cell.command("reset")
    await cell.forward(until=cell.is_state(State.UNHOMED), seconds=5)
    assert (await cell.command("unlock")).ok
    assert "without homing" in cell.snapshot.position
    refused = await cell.start(one_wall(cell.facts, layers=1))
    assert not refused.ok and "position is not to be trusted" in refused.error
    assert not (await cell.command("confirm_position", because="")).ok
    assert (await cell.command("confirm_position", because="touched off at the datum ball")).ok
    assert (await cell.start(one_wall(cell.facts, layers=1))).ok
    await cell.forward(ticks=20)
    assert cell.has_event("position", "touched off at the datum ball")
