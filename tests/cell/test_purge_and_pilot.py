"""Powder, gas and aiming beam by hand: the plant's own flow and light, and what ends them."""

from __future__ import annotations

import pytest

from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest, shipped_cell
from tests.cell.jobs import one_wall


async def purging(cell: CellUnderTest, **asked: float) -> None:
    reply = await cell.command("purge", **{"seconds": 20.0, "powder_g_min": 8.0, **asked})
    assert reply.ok, reply.error
    await cell.forward(until=lambda: cell.snapshot.hand.flow_left_s > 0.0, seconds=20)


async def test_a_purge_brings_powder_to_the_nozzle_in_the_dark_and_shuts_it_after_its_time(cell: CellUnderTest) -> None:
    await purging(cell, seconds=3.0)
    assert cell.state is State.PURGING
    assert cell.sim.feeder.rate_at_nozzle_g_min == pytest.approx(8.0, rel=0.06)
    assert cell.sim.laser.values["enable"] == 0.0 == cell.sim.laser.values["emission_permit"]
    await cell.forward(until=cell.is_state(State.IDLE), seconds=20)
    assert cell.sim.feeder.values["rate_setpoint"] == 0.0 == cell.sim.feeder.values["carrier_gas_setpoint"]
    assert cell.sim.laser.mean_power_w == 0.0 and cell.max_standstill_emission_w == 0.0
    assert cell.has_event("purge", "powder at 8 g/min for 3 s by tester")


async def test_a_gas_test_lets_gas_flow_and_no_powder(cell: CellUnderTest) -> None:
    await purging(cell, powder_g_min=0.0, shield_l_min=20.0)
    assert cell.sim.feeder.shield_l_min == pytest.approx(20.0, rel=0.15)
    assert cell.sim.feeder.values["rate_setpoint"] == 0.0
    assert (await cell.command("hold")).ok
    await cell.forward(until=cell.is_state(State.IDLE), seconds=10)
    assert cell.sim.feeder.shield_l_min < 0.5


@pytest.mark.parametrize(("happens", "state"), [("open_door", State.FAULT), ("press_estop", State.FAULT)])
async def test_what_a_purge_needs_and_loses_shuts_powder_and_gas(cell: CellUnderTest, happens: str, state: State) -> None:
    await purging(cell)
    getattr(cell.sim, happens)()
    await cell.forward(until=cell.is_state(state), seconds=1)
    await cell.forward(ticks=10)
    assert cell.sim.feeder.values["rate_setpoint"] == 0.0 == cell.sim.feeder.values["carrier_gas_setpoint"]


async def test_a_stop_shuts_a_purge_and_a_job_does_not_start_into_one(cell: CellUnderTest) -> None:
    await purging(cell)
    reply = await cell.start(one_wall(cell.facts, layers=1, mill=False))
    assert not reply.ok and "PURGING" in reply.error
    assert (await cell.command("stop")).ok
    await cell.forward(ticks=5)
    assert cell.state is State.STOPPED and cell.sim.feeder.values["rate_setpoint"] == 0.0


@pytest.mark.parametrize(
    ("asked", "words"),
    [({"seconds": 61.0}, "at most 60 s"), ({"powder_g_min": 1e4}, "at most"), ({"carrier_l_min": 0.0}, "carrier"), ({"seconds": -1.0}, "s")],
)
async def test_a_purge_beyond_its_bounds_is_refused_and_nothing_flows(cell: CellUnderTest, asked: dict[str, float], words: str) -> None:
    reply = await cell.command("purge", **{"seconds": 5.0, "powder_g_min": 8.0, **asked})
    assert not reply.ok and words in reply.error
    assert cell.state is State.IDLE and cell.sim.feeder.values["carrier_gas_setpoint"] == 0.0


async def test_a_purge_place_of_the_cell_file_has_to_be_reached_first(folder) -> None:  # type: ignore[no-untyped-def]
    facts = shipped_cell()
    places = {"purge": {"Z": 10.0, "X": 100.0}}
    facts = facts.model_copy(update={"by_hand": facts.by_hand.model_copy(update={"places": places, "purge_place": "purge"})})
    async with CellUnderTest(folder / "store.db", cell=facts) as cell:
        reply = await cell.command("purge", seconds=1.0, powder_g_min=5.0)
        assert not reply.ok and "X 100" in reply.error
        assert (await cell.command("go_to", place="purge", feed=6000.0)).ok
        await cell.forward(until=cell.is_state(State.IDLE), seconds=20)
        assert cell.sim.joints[[0, 2]] == pytest.approx([100.0, 10.0], abs=2e-3)
        assert (await cell.command("purge", seconds=1.0, powder_g_min=5.0)).ok


async def test_the_aiming_beam_is_no_emission_stays_while_jogging_and_goes_out_after_its_time(cell: CellUnderTest) -> None:
    assert (await cell.command("pilot", on=True, seconds=5.0)).ok
    await cell.forward(ticks=5)
    assert cell.sim.laser.is_pilot_lit and cell.sim.laser.emission_w == 0.0 and cell.snapshot.hand.pilot
    assert (await cell.command("jog", axis="X", distance=5.0, feed=1000.0)).ok
    await cell.forward(until=cell.is_state(State.IDLE), seconds=3)
    assert cell.sim.laser.is_pilot_lit
    await cell.forward(seconds=5.0)
    assert not cell.sim.laser.is_pilot_lit and cell.has_event("pilot", "its time is over")


@pytest.mark.parametrize("happens", ["open_door", "press_estop", "stop", "start"])
async def test_the_aiming_beam_goes_out_with_door_estop_stop_and_start(cell: CellUnderTest, happens: str) -> None:
    assert (await cell.command("pilot", on=True)).ok
    await cell.forward(ticks=5)
    if happens == "stop":
        assert (await cell.command("stop")).ok
    elif happens == "start":
        assert (await cell.start(one_wall(cell.facts, layers=1, mill=False))).ok
    else:
        getattr(cell.sim, happens)()
    await cell.forward(ticks=12)
    assert cell.sim.laser.values["pilot"] == 0.0 and not cell.sim.laser.is_pilot_lit


async def test_no_aiming_beam_while_a_job_runs(cell: CellUnderTest) -> None:
    await cell.deposit(layers=1, mill=False)
    reply = await cell.command("pilot", on=True)
    assert not reply.ok and "RUNNING" in reply.error
    await cell.forward(ticks=5)
    assert cell.is_depositing() and cell.sim.laser.values["pilot"] == 0.0
