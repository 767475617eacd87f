"""The reaction table of the cell file at the plant: hold without a latch, retract, powder; levels judged between ticks; rest without haste."""

from __future__ import annotations

from pathlib import Path

import pytest

from cellctl.domain.states import State
from config.base import find_facts
from config.reactions import complete
from tests.cell.harness import CellUnderTest, shipped_cell
from tests.cell.jobs import POWDER_G_MIN

TOLERANCE_MM = 0.01


def cell_with(store: Path, cell_file: str = "trunnion_tcp", **reactions: dict[str, object]) -> CellUnderTest:
    return CellUnderTest(store / "store.db", cell=shipped_cell(cell_file, reactions=complete(reactions)))


async def test_a_cause_that_may_pass_holds_the_job_without_a_latch_and_the_operator_resumes_when_it_is_gone(tmp_path: Path) -> None:
    async with cell_with(tmp_path, fume_extraction={"latch": False}) as cell:
        await cell.deposit(mill=False, layers=1)
        cell.sim.faults.add("fume_fail")
        await cell.forward(until=cell.is_state(State.HELD), seconds=3)
        assert cell.is_dark and cell.is_still and cell.latched == []
        assert cell.sim.feeder.values["rate_setpoint"] == 0.0
        assert "Fume extraction is off" in cell.snapshot.because
        refused = await cell.command("resume")
        assert not refused.ok and "Fume extraction" in refused.error
        cell.sim.faults.add("fume_ok")
        await cell.forward(ticks=10)
        assert (await cell.command("resume")).ok
        await cell.hurry(cell.is_state(State.IDLE), scale=4.0)
        assert cell.outcome == "completed"
        assert cell.max_standstill_emission_w == 0.0
        assert cell.has_event("held", "Fume extraction")


@pytest.mark.parametrize("cell_file", ["trunnion_tcp", "head_head"])
async def test_a_retract_lifts_the_head_along_the_tool_axis_after_standstill_with_the_laser_dark(tmp_path: Path, cell_file: str) -> None:
    async with cell_with(tmp_path, cell_file, chiller={"retract": True}) as cell:
        await cell.deposit(mill=False)
        cell.sim.faults.add("chiller_fail")
        await cell.forward(until=lambda: cell.is_still and cell.controller.retract.is_moving, seconds=3)
        low = cell.sim.tip_position
        refused = await cell.command("reset")
        assert not refused.ok
        await cell.forward(until=lambda: not cell.controller.retract.is_pending, seconds=5)
        lifted = cell.sim.tip_position - low
        assert lifted[2] == pytest.approx(cell.facts.limits.retract_mm, abs=0.5)
        assert abs(lifted[:2]).max() < TOLERANCE_MM
        assert cell.is_dark and cell.is_still
        assert cell.latched == ["chiller"] and cell.outcome == "interrupted"
        assert cell.max_standstill_emission_w == 0.0
        cell.sim.faults.add("chiller_ok")
        await cell.forward(ticks=10)
        assert (await cell.command("reset")).ok
        await cell.forward(until=cell.is_state(State.IDLE), seconds=5)
        assert cell.has_event("retract", "taken back along the tool axis")


async def test_a_door_opened_during_a_retract_ends_its_motion_at_once(tmp_path: Path) -> None:
    async with cell_with(tmp_path, chiller={"retract": True}) as cell:
        await cell.deposit(mill=False)
        cell.sim.faults.add("chiller_fail")
        await cell.forward(until=lambda: cell.controller.retract.is_moving and not cell.is_still, seconds=3)
        cell.sim.io.door_closed = False  # the coupler's contact alone: the CNC's own input does not see it
        cell.sim.io.show()
        await cell.forward(seconds=0.3)
        at = cell.sim.tip_position
        await cell.forward(seconds=1.0)
        assert abs(cell.sim.tip_position - at).max() < TOLERANCE_MM
        assert sorted(cell.latched) == ["chiller", "door"]
        assert cell.has_event("retract", "not taken back")


async def test_where_no_travel_is_left_nothing_moves_and_it_is_told(tmp_path: Path) -> None:
    facts = shipped_cell(reactions=complete({"chiller": {"retract": True}}))
    z = next(axis for axis in facts.axes if axis.letter == "Z")
    async with CellUnderTest(tmp_path / "store.db", cell=facts) as cell:
        await cell.deposit(mill=False)
        at = float(cell.sim.joints[2])
        axes = tuple(axis.model_copy(update={"max": at + 0.5}) if axis.letter == "Z" else axis for axis in facts.axes)
        cell.controller.cell = facts.model_copy(update={"axes": axes})
        assert z.max > at + 0.5
        cell.sim.faults.add("chiller_fail")
        await cell.forward(until=lambda: cell.has_event("retract", "no travel is left"), seconds=3)
        assert cell.sim.joints[2] == pytest.approx(at, abs=0.01)


async def test_a_level_is_judged_when_it_is_read_and_not_at_the_next_tick(tmp_path: Path) -> None:
    async with cell_with(tmp_path) as cell:
        await cell.deposit()
        cell.is_ticking = False  # for less time than makes the heartbeats end
        cell.sim.io.gas_pressure_ok = False
        cell.sim.io.show()
        await cell.forward(ticks=3)
        assert cell.sim.laser.values["emission_permit"] == 0.0 and cell.is_dark
        assert cell.latched == ["gas_pressure"]
        cell.is_ticking = True
        await cell.forward(seconds=1.0)
        assert cell.is_still and cell.max_standstill_emission_w == 0.0


@pytest.mark.parametrize("device", ["laser", "feeder", "io"])
async def test_a_device_at_rest_that_misses_a_few_requests_is_no_loss_and_one_that_is_gone_is_named(tmp_path: Path, device: str) -> None:
    async with cell_with(tmp_path) as cell:
        cell.sim.faults.add(f"modbus_silent {device}")
        await cell.forward(seconds=0.3)
        cell.sim.faults.add(f"modbus_ok {device}")
        await cell.forward(seconds=0.7)
        assert cell.state is State.IDLE and not cell.has_event("state", "OFFLINE")
        cell.sim.faults.add(f"modbus_silent {device}")
        await cell.forward(until=cell.is_state(State.OFFLINE), seconds=2.0)
        named = {"laser": "laser", "feeder": "feeder", "io": "I/O coupler"}[device]
        assert named in cell.snapshot.alarms[0].cause


async def test_offline_names_everything_that_is_missing(tmp_path: Path) -> None:
    async with cell_with(tmp_path) as cell:
        for device in ("laser", "feeder"):
            cell.sim.faults.add(f"modbus_silent {device}")
        await cell.forward(seconds=2.0)
        (alarm,) = cell.snapshot.alarms
        assert "laser" in alarm.cause and "feeder" in alarm.cause


async def test_a_host_that_dies_leaves_the_gate_of_the_stream_open_and_the_permits_dead_man_puts_the_light_out(cell: CellUnderTest) -> None:
    await cell.deposit(length_mm=60.0)
    await cell.kill()
    await cell.forward(ticks=20)
    assert cell.sim.laser.gate and not cell.is_dark, "the control executes what it holds"
    await cell.forward(seconds=cell.wires.links["laser"]._world.laser.device.dead_man_s - 0.2 + 0.03)
    assert cell.sim.laser.gate, "an output of the control holds its level"
    assert cell.is_dark and cell.sim.laser.is_safe
    await cell.forward(seconds=cell.wires.links["feeder"]._world.feeder.device.dead_man_s - cell.wires.links["laser"]._world.laser.device.dead_man_s)
    assert cell.is_dark and cell.sim.feeder.is_safe and cell.sim.io.is_safe


async def test_a_journal_that_cannot_be_written_turns_the_laser_off_and_holds_the_job(cell: CellUnderTest) -> None:
    await cell.deposit(mill=False)
    cell.controller.fault("store", "disk full")
    await cell._settle()
    await cell.forward(ticks=2)
    assert cell.is_dark
    await cell.forward(seconds=1.0)
    assert cell.is_still and cell.latched == ["store"] and cell.max_standstill_emission_w == 0.0
    assert cell.sim.feeder.values["rate_setpoint"] == 0.0


@pytest.mark.parametrize(("contact", "code"), [("estop_ok", "estop"), ("door_closed", "door"), ("gas_pressure_ok", "gas_pressure")])
async def test_a_contact_that_opens_and_closes_between_two_readings_is_counted_by_the_coupler_and_latches(
    cell: CellUnderTest, contact: str, code: str
) -> None:
    await cell.deposit()
    for level in (False, True):
        setattr(cell.sim.io, contact, level)
        cell.sim.io.show()
    await cell.forward(ticks=4)
    assert cell.latched == [code] and cell.is_dark
    await cell.forward(seconds=1.0)
    assert cell.is_still and cell.max_standstill_emission_w == 0.0
    assert (await cell.command("reset")).ok, "the contact is closed again"
    await cell.forward(until=cell.is_state(State.HELD, State.IDLE), seconds=5)
    assert cell.latched == []


DIVERTER = """
[registers.diverter]
table = "coil"
address = 1
type = "bit"
safe = 1.0
"""


async def test_a_diverter_leads_powder_away_while_the_job_is_held_and_back_when_it_goes_on(tmp_path: Path) -> None:
    device = tmp_path / "feeder.toml"
    device.write_text(find_facts("devices", "feeder_generic").read_text(encoding="utf-8") + DIVERTER, encoding="utf-8")
    facts = shipped_cell(reactions=complete({"chiller": {"powder": "divert"}}))
    links = {**facts.links, "feeder": facts.links["feeder"].model_copy(update={"device": str(device)})}
    async with CellUnderTest(tmp_path / "store.db", cell=facts.model_copy(update={"links": links})) as cell:
        await cell.deposit(mill=False, layers=1)
        assert not cell.sim.feeder.is_diverted
        cell.sim.faults.add("chiller_fail")
        await cell.forward(seconds=1.0)
        assert cell.sim.feeder.is_diverted and cell.sim.feeder.values["rate_setpoint"] == POWDER_G_MIN
        assert cell.is_dark and cell.latched == ["chiller"]
        cell.sim.faults.add("chiller_ok")
        await cell.forward(ticks=10)
        assert (await cell.command("reset")).ok
        await cell.forward(until=cell.is_state(State.HELD), seconds=5)
        assert (await cell.command("resume")).ok
        await cell.forward(until=cell.is_state(State.RUNNING), seconds=5)
        assert not cell.sim.feeder.is_diverted
        await cell.hurry(cell.is_state(State.IDLE), scale=4.0)
        assert cell.outcome == "completed"


async def test_powder_that_a_reaction_let_flow_on_is_shut_when_nobody_comes(tmp_path: Path) -> None:
    async with cell_with(tmp_path, chiller={"powder": "keep"}) as cell:
        await cell.deposit(mill=False)
        cell.sim.faults.add("chiller_fail")
        await cell.forward(seconds=1.0)
        assert cell.sim.feeder.values["rate_setpoint"] == POWDER_G_MIN
        await cell.forward(seconds=cell.facts.limits.powder_settle_timeout_s)
        assert cell.sim.feeder.values["rate_setpoint"] == 0.0
