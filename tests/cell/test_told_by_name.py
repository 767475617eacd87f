"""The operator reads which device or wire is at fault, not which one suffered from it."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from cellctl.domain.states import State
from tests.cell.faults.row import bound_s
from tests.cell.harness import CellUnderTest, shipped_cell
from tests.cell.jobs import one_wall


@pytest.fixture
async def on_one_line(folder: Path) -> AsyncIterator[CellUnderTest]:
    """A cell whose laser, feeder and I/O coupler share a serial line."""
    async with CellUnderTest(folder / "store.db", cell=shipped_cell("trunnion_rtu")) as under_test:
        yield under_test


@pytest.mark.parametrize(("slow", "name"), [("io", "I/O coupler"), ("feeder", "powder feeder")])
async def test_slow_device_is_told_by_name_though_the_others_on_its_line_go_stale(on_one_line: CellUnderTest, slow: str, name: str) -> None:
    cell = on_one_line
    await cell.deposit(mill=False)
    cell.sim.faults.add(f"modbus_slow {slow} 0.09")
    await cell.forward(until=cell.is_state(State.FAULT), seconds=5.0)
    (alarm,) = cell.snapshot.alarms
    assert alarm.code == f"{slow}_silent" and f"generic {name} takes 9" in alarm.cause, alarm


async def test_lost_line_is_one_alarm_that_names_all_its_devices(on_one_line: CellUnderTest) -> None:
    cell = on_one_line
    await cell.deposit(mill=False)
    cell.sim.faults.add("modbus_gone feeder")
    await cell.forward(until=cell.is_state(State.FAULT), seconds=2.0)
    await cell.forward(seconds=1.0)
    (alarm,) = cell.snapshot.alarms
    assert all(name in alarm.cause for name in ("fibre laser", "powder feeder", "I/O coupler")), alarm.cause


async def test_coupler_with_a_connection_of_its_own_is_told_alone_and_within_its_own_bound(cell: CellUnderTest) -> None:
    await cell.deposit(mill=False)
    since = cell.sim.wire_time_s
    cell.sim.faults.add("modbus_gone io")
    await cell.forward(until=cell.is_state(State.FAULT), seconds=2.0)
    await cell.forward(seconds=1.0)
    assert cell.latched == ["io_silent"] and cell.witness.last_lit_at - since <= bound_s("io", cell.facts)


async def test_coupler_that_follows_no_heartbeat_is_the_cause_when_its_head_falls_back(cell: CellUnderTest) -> None:
    await cell.deposit(mill=False)
    cell.sim.faults.add("modbus_stuck io heartbeat")
    await cell.forward(until=cell.is_state(State.FAULT), seconds=3.0)
    (alarm,) = cell.snapshot.alarms
    assert alarm.code == "io_fault" and "has not followed the heartbeat" in alarm.cause


async def test_coupler_that_takes_no_output_is_the_cause_and_not_the_head_that_never_came(cell: CellUnderTest) -> None:
    cell.sim.faults.add("modbus_stuck io head_deploy")
    await cell.forward(ticks=2)
    assert (await cell.start(one_wall(cell.facts, mill=False))).ok
    await cell.forward(until=cell.is_state(State.FAULT), seconds=5.0)
    (alarm,) = cell.snapshot.alarms
    assert alarm.code == "io_fault" and "head_deploy is 1" in alarm.cause


@pytest.mark.parametrize(
    ("fault", "code"),
    [("serial_unplug", "cnc_lost"), ("limit_hit", "cnc_alarm"), ("firmware_reset", "cnc_reset"), ("door_open", "door")],
)
async def test_homing_that_breaks_off_is_told_by_its_cause(cell: CellUnderTest, fault: str, code: str) -> None:
    await _begin_homing(cell)
    cell.sim.faults.add(fault)
    await cell.forward(until=cell.is_state(State.FAULT), seconds=3.0)
    assert cell.latched == [code]


@pytest.mark.parametrize(("fault", "words"), [("half_line", "has not begun to home"), ("feed_hold", "feed hold at the machine")])
async def test_homing_that_never_begins_is_told_within_seconds(cell: CellUnderTest, fault: str, words: str) -> None:
    await cell.forward(seconds=1.0)
    assert (await cell.command("home")).ok
    cell.sim.faults.add(fault)
    await cell.forward(until=cell.is_state(State.FAULT), seconds=5.0)
    assert words in cell.snapshot.alarms[0].cause


async def _begin_homing(cell: CellUnderTest) -> None:
    assert (await cell.command("jog", axis="X", distance=200.0, feed=12000.0)).ok
    await cell.forward(until=cell.is_state(State.IDLE), seconds=5.0)
    assert (await cell.command("home")).ok
    await cell.forward(until=lambda: cell.sim.cnc.machine.is_homing, seconds=2.0)
