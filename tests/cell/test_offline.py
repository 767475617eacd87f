"""Wires that are not there: one clear line, tried again every second, ready when all answer."""

from __future__ import annotations

from pathlib import Path

import pytest

from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest


@pytest.fixture
def bare(tmp_path: Path) -> CellUnderTest:
    return CellUnderTest(tmp_path / "store.db")


async def test_an_absent_port_is_told_in_one_line_and_the_cell_is_ready_when_it_comes(bare: CellUnderTest) -> None:
    bare.wires.is_port_absent = True
    await bare.power_up(until_idle=False)
    await bare.forward(seconds=2.0)
    assert bare.state is State.OFFLINE
    (alarm,) = bare.snapshot.alarms
    assert "serial port cnc is not there" in alarm.cause
    reply = await bare.command("home")
    assert not reply.ok
    bare.wires.is_port_absent = False
    await bare.forward(until=bare.is_state(State.IDLE), seconds=5)
    assert bare.snapshot.alarms == []
    await bare.end()


async def test_a_silent_port_is_told_and_tried_again(bare: CellUnderTest) -> None:
    bare.sim.faults.add("serial_silent")
    await bare.power_up(until_idle=False)
    await bare.forward(seconds=12.0)
    assert bare.state is State.OFFLINE
    assert "does not answer" in bare.snapshot.alarms[0].cause
    bare.sim.faults.add("serial_ok")
    await bare.forward(until=bare.is_state(State.IDLE), seconds=15)
    await bare.end()


@pytest.mark.parametrize("device", ["laser", "feeder", "io"])
async def test_a_silent_modbus_device_keeps_the_cell_offline_until_it_answers(bare: CellUnderTest, device: str) -> None:
    bare.sim.faults.add(f"modbus_silent {device}")
    await bare.power_up(until_idle=False)
    await bare.forward(seconds=2.0)
    assert bare.state is State.OFFLINE
    assert device in bare.snapshot.alarms[0].cause
    bare.sim.faults.add(f"modbus_ok {device}")
    await bare.forward(until=bare.is_state(State.IDLE), seconds=5)
    await bare.end()


@pytest.mark.parametrize("fault", ["modbus_exception laser", "modbus_wrong_count laser"])
async def test_a_device_that_answers_wrongly_is_not_taken_for_ready(bare: CellUnderTest, fault: str) -> None:
    bare.sim.faults.add(fault)
    await bare.power_up(until_idle=False)
    await bare.forward(seconds=2.0)
    assert bare.state is State.OFFLINE
    assert bare.snapshot.alarms[0].cause
    await bare.end()


async def test_a_port_that_is_unplugged_at_rest_and_plugged_in_again_brings_the_cell_back(bare: CellUnderTest) -> None:
    await bare.power_up()
    bare.wires.port.is_unplugged = True
    bare.wires.is_port_absent = True
    await bare.forward(until=bare.is_state(State.OFFLINE), seconds=2)
    bare.wires.is_port_absent = False
    await bare.forward(until=bare.is_state(State.IDLE), seconds=5)
    assert (await bare.command("jog", axis="X", distance=1.0, feed=600.0)).ok
    await bare.end()
