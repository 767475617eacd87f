"""One reset is enough when the cause is gone, whatever became of the devices' own faults and of the request that clears them."""

from __future__ import annotations

from pathlib import Path

import pytest

from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest


async def reset_once(cell: CellUnderTest) -> None:
    reply = await cell.command("reset")
    assert reply.ok, reply.error
    await cell.forward(until=lambda: cell.state is not State.RESETTING, seconds=8.0)


@pytest.mark.parametrize(("away_s", "waits_s"), [(0.3, 0.5), (2.0, 0.01)])
async def test_after_a_kill_the_first_reset_clears_what_the_dead_men_have_latched(cell: CellUnderTest, away_s: float, waits_s: float) -> None:
    await cell.deposit(length_mm=60.0)
    await cell.kill()
    await cell.forward(seconds=away_s)
    assert cell.sim.laser.faults or away_s < 0.25, "the laser's dead-man has latched"
    await cell.power_up(until_idle=False)
    await cell.forward(until=lambda: cell.controller.is_cnc_alive and not cell.controller.quiesce_pending, seconds=10.0)
    await cell.forward(seconds=waits_s)
    await reset_once(cell)
    assert cell.state in (State.IDLE, State.UNHOMED) and cell.sim.laser.faults == 0 and cell.sim.feeder.faults == 0


@pytest.mark.parametrize(
    ("device", "fault", "after_ticks"), [("laser", "modbus_gone", 1), ("feeder", "modbus_silent", 1), ("feeder", "modbus_silent", 2)]
)
async def test_a_reset_whose_request_is_lost_with_the_device_clears_it_when_it_is_back(
    tmp_path: Path, device: str, fault: str, after_ticks: int
) -> None:
    async with CellUnderTest(tmp_path / "s.db") as cell:
        cell.sim.faults.add(f"{device}_fault 8")
        cell.controller.fault(f"{device}_fault", "module")
        await cell.forward(seconds=0.5)
        reply = await cell.command("reset")
        assert reply.ok, reply.error
        await cell.forward(ticks=after_ticks)
        cell.sim.faults.add(f"{fault} {device}")
        await cell.forward(seconds=0.7)
        cell.sim.faults.add(f"modbus_ok {device}")
        await cell.forward(until=lambda: cell.state is not State.RESETTING, seconds=8.0)
        assert cell.state is State.IDLE, cell.controller.because
        assert getattr(cell.sim, device).faults == 0


@pytest.mark.parametrize("silent_s", [0.6])
async def test_after_a_kill_a_reset_that_comes_before_the_laser_is_heard_clears_it_as_well(cell: CellUnderTest, silent_s: float) -> None:
    await cell.deposit(length_mm=60.0)
    await cell.kill()
    await cell.forward(seconds=1.0)
    cell.sim.faults.add("modbus_silent laser")
    await cell.power_up(until_idle=False)
    await cell.forward(until=lambda: cell.controller.is_cnc_alive and not cell.controller.quiesce_pending, seconds=10.0)
    reply = await cell.command("reset")
    assert reply.ok, reply.error
    await cell.forward(seconds=silent_s)
    cell.sim.faults.add("modbus_ok laser")
    await cell.forward(until=lambda: cell.state is not State.RESETTING, seconds=8.0)
    assert cell.state in (State.IDLE, State.UNHOMED, State.OFFLINE) and cell.sim.laser.faults == 0
