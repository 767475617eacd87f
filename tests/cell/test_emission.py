"""Invariant 1: emission needs, at every tick, motion on a depositing pass, safe and fresh levels, and a live dead-man."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cellctl.cell.stream import gate_of_lines
from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest, shipped_cell
from tests.cell.jobs import one_wall

POLL_TICKS = 3  # a level is read every 20 ms, judged by the next tick, written in the same turn
STATUS_TICKS = 12  # one status period and what the answer takes


async def test_a_job_is_completed_and_light_falls_on_its_passes_alone(cell: CellUnderTest) -> None:
    program = one_wall(cell.facts)
    await cell.start(program)
    await cell.hurry(cell.is_state(State.IDLE), scale=4.0)
    assert cell.outcome == "completed"
    passes = set((np.flatnonzero(gate_of_lines(program)) + 1).tolist())
    behind = {n + 2 for n in passes}  # the laser ramps down on the motion behind M63
    moving = {n for n in passes if "G1" in program.lines[n - 1]}
    assert moving <= cell.burnt_lines <= passes | behind
    assert cell.max_standstill_emission_w == 0.0
    assert cell.sim.feeder.values["rate_setpoint"] == 0.0
    assert cell.sim.io.is_parked
    assert cell.sim.cnc.machine.tool == 2


async def test_a_cell_without_wired_gate_lights_the_pass_by_modbus(tmp_path: Path) -> None:
    async with CellUnderTest(tmp_path / "store.db", cell=shipped_cell("trunnion_rtu")) as cell:
        program = one_wall(cell.facts, layers=1, mill=False)
        await cell.start(program)
        await cell.hurry(lambda: cell.snapshot.lines.executing >= 4, scale=5.0)
        lit: list[float] = []
        x: list[float] = []
        while cell.state is not State.IDLE:
            await cell.forward(ticks=1)
            tip = cell.sim.tip_position
            if cell.sim.laser.is_emitting:
                x.append(float(tip[0]))
            lit.append(cell.sim.laser_emission_w)
        assert cell.outcome == "completed"
        assert cell.max_standstill_emission_w == 0.0
        # the bead is 40 mm long about x = 0; a status report comes every 100 ms, 1 mm apart at this speed
        assert x[0] == pytest.approx(-20.0, abs=1.0)
        assert x[-1] == pytest.approx(20.0, abs=1.0)


async def test_door_opened_while_depositing_turns_the_laser_off_within_one_tick_and_latches(
    cell: CellUnderTest,
) -> None:
    await cell.deposit()
    cell.sim.open_door()
    await cell.forward(ticks=1)
    assert cell.sim.laser_emission_w == 0.0
    await cell.forward(ticks=POLL_TICKS)
    assert cell.state is State.FAULT
    assert cell.latched == ["door"]
    assert cell.snapshot.alarms[0].remedy.startswith("close the door")
    assert "door interlock open" in next(each.why for each in cell.snapshot.permissives if each.name == "laser")
    assert not (await cell.command("reset")).ok
    cell.sim.close_door()
    await cell.forward(seconds=1.0)
    assert cell.is_dark, "closing the door resets nothing"
    assert cell.state is State.FAULT


async def test_after_the_door_is_closed_and_reset_the_job_goes_on_to_its_end(cell: CellUnderTest) -> None:
    await cell.deposit(mill=False)
    cell.sim.open_door()
    await cell.forward(seconds=1.0)
    cell.sim.close_door()
    await cell.forward(ticks=10)
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.HELD), seconds=5)
    assert cell.is_dark
    assert (await cell.command("resume")).ok
    await cell.hurry(cell.is_state(State.IDLE), scale=4.0)
    assert cell.outcome == "completed"
    assert cell.max_standstill_emission_w == 0.0


@pytest.mark.parametrize(
    ("fault", "code"),
    [("fume_fail", "fume_extraction"), ("gas_low", "gas_pressure"), ("chiller_fail", "chiller"), ("estop", "estop"), ("laser_fault", "laser_fault"),
     ("feeder_clog", "feeder_fault"), ("feeder_fault", "feeder_fault"), ("fibre_open", "laser_interlock")],
)  # fmt: skip
async def test_a_lost_level_turns_the_laser_off_by_the_next_reading_and_latches_its_cause(
    cell: CellUnderTest, fault: str, code: str
) -> None:
    await cell.deposit()
    cell.sim.faults.add(fault)
    await cell.forward(ticks=POLL_TICKS)
    assert cell.is_dark
    assert cell.sim.laser.values["emission_permit"] == 0.0
    assert cell.state is State.FAULT
    assert code in cell.latched
    await cell.forward(seconds=2.0)
    assert cell.is_still
    assert cell.sim.feeder.values["rate_setpoint"] == 0.0
    assert cell.max_standstill_emission_w == 0.0


async def test_powder_that_does_not_arrive_although_nothing_reports_it_ends_the_deposit(cell: CellUnderTest) -> None:
    await cell.deposit(length_mm=120.0, pieces=20)
    cell.sim.feeder._feed = lambda: 0.0  # type: ignore[method-assign]  # a clog that the feeder itself does not see
    await cell.forward(until=cell.is_state(State.FAULT), seconds=6.0)
    await cell.forward(ticks=1)
    assert cell.latched == ["powder_flow"]
    assert cell.is_dark


@pytest.mark.parametrize("device", ["laser", "io", "feeder"])
async def test_a_modbus_device_that_falls_silent_leaves_no_light_and_a_latched_cause(
    cell: CellUnderTest, device: str
) -> None:
    await cell.deposit(length_mm=60.0)
    cell.sim.faults.add(f"modbus_silent {device}")
    stale = 0.5 if device == "laser" else 0.25  # the laser's own dead-man; else the shortest stale limit
    await cell.forward(seconds=(0.5 if device == "feeder" else stale) + 0.05)
    await cell.forward(ticks=POLL_TICKS)
    assert cell.is_dark
    assert cell.state is State.FAULT
    assert f"{device}_silent" in cell.latched


async def test_a_serial_line_that_falls_silent_turns_the_laser_off_when_the_status_is_stale(
    cell: CellUnderTest,
) -> None:
    await cell.deposit(length_mm=60.0)
    cell.sim.faults.add("serial_silent")
    await cell.forward(seconds=cell.facts.limits.status_stale_s)
    await cell.forward(ticks=POLL_TICKS)
    assert cell.is_dark
    assert cell.latched == ["cnc_silent"]


async def test_a_serial_line_that_is_unplugged_turns_the_laser_off_at_once(cell: CellUnderTest) -> None:
    await cell.deposit()
    cell.wires.port.is_unplugged = True
    cell.wires.is_port_absent = True
    await cell.forward(ticks=POLL_TICKS)
    assert cell.is_dark
    assert cell.latched == ["cnc_lost"]
    assert cell.outcome == "interrupted"


async def test_a_feed_hold_at_the_machine_turns_the_laser_off_within_a_status_period(cell: CellUnderTest) -> None:
    await cell.deposit()
    cell.sim.faults.add("feed_hold")
    await cell.forward(ticks=STATUS_TICKS)
    assert cell.is_dark
    assert cell.sim.laser.values["emission_permit"] == 0.0
    await cell.forward(until=cell.is_state(State.HELD), seconds=2)


async def test_hold_turns_the_laser_off_before_the_machine_slows_and_resume_goes_on(cell: CellUnderTest) -> None:
    await cell.deposit(mill=False)
    assert (await cell.command("hold")).ok
    await cell.forward(until=cell.is_state(State.HELD), seconds=2)
    assert cell.is_dark
    assert cell.is_still
    assert cell.max_standstill_emission_w == 0.0
    await cell.forward(seconds=1.0)
    assert (await cell.command("resume")).ok
    await cell.forward(until=cell.is_state(State.RUNNING), seconds=20)
    await cell.forward(until=lambda: cell.sim.laser.is_emitting, seconds=1)
    assert cell.sim.feeder.rate_at_nozzle_g_min == pytest.approx(10.0, rel=0.05), (
        "powder is steady before motion goes on"
    )
    await cell.hurry(cell.is_state(State.IDLE), scale=4.0)
    assert cell.outcome == "completed"
    assert cell.max_standstill_emission_w == 0.0


async def test_the_permit_is_off_during_a_dwell(cell: CellUnderTest) -> None:
    await cell.deposit(layers=1, dwell_s=3.0, mill=False, length_mm=20.0)
    dwell = next(k for k, line in enumerate(cell.programs["job-1"].lines) if "G4" in line)
    await cell.forward(until=lambda: cell.snapshot.lines.executed >= dwell and cell.is_still, seconds=10)
    await cell.forward(ticks=STATUS_TICKS)
    assert cell.sim.laser.values["emission_permit"] == 0.0
    await cell.forward(until=cell.is_state(State.IDLE), seconds=20)
    assert cell.outcome == "completed"


async def test_a_tick_that_has_died_lets_the_dead_man_turn_laser_and_powder_off(cell: CellUnderTest) -> None:
    await cell.deposit(length_mm=60.0)
    cell.is_ticking = False
    await cell.forward(seconds=0.2 + 0.5 + 0.05)  # heartbeats end with the tick; the devices wait dead_man_s
    assert cell.is_dark
    assert cell.sim.feeder.values["rate_setpoint"] == 0.0
