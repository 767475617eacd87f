"""The laser's wired gate at the plant: open only while a run has it, whatever ended that run."""

from __future__ import annotations

import pytest

from cellctl.domain.states import State
from sim.cnc import system
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall


def is_open(cell: CellUnderTest) -> bool:
    """The level of the output that is the gate, at the machine."""
    port = cell.facts.cnc.laser_gate_output
    assert port is not None
    return bool(cell.sim.cnc.machine.motion.outputs >> port & 1)


@pytest.mark.parametrize("verb", ["abort", "stop"])
async def test_a_pass_that_a_command_breaks_off_leaves_the_gate_shut(cell: CellUnderTest, verb: str) -> None:
    await cell.deposit(layers=1, pieces=60, length_mm=60.0)
    assert is_open(cell)
    assert (await cell.command(verb)).ok
    await cell.forward(until=cell.is_state(State.IDLE, State.STOPPED), seconds=15)
    await cell.forward(until=lambda: not is_open(cell), seconds=2)
    if verb == "stop":
        await cell.command("reset")
    await cell.forward(until=cell.is_state(State.IDLE), seconds=15)
    assert cell.controller.gate.is_shut


async def test_a_process_killed_in_a_pass_finds_the_gate_open_and_shuts_it_before_anything_moves(cell: CellUnderTest) -> None:
    await cell.deposit(layers=1, pieces=60, length_mm=60.0)
    await cell.kill()
    await cell.forward(ticks=100)
    assert is_open(cell)
    await cell.power_up(until_idle=False)
    await cell.forward(until=lambda: cell.controller.gate.is_shut, seconds=10)
    assert not is_open(cell)
    assert cell.is_still


async def test_a_firmware_that_resets_in_a_pass_has_its_gate_shut_when_it_takes_words_again(cell: CellUnderTest) -> None:
    await cell.deposit(layers=1, pieces=60, length_mm=60.0)
    cell.sim.faults.add("firmware_reset")
    await cell.forward(until=cell.is_state(State.FAULT), seconds=2)
    await cell.forward(until=lambda: not cell.controller.quiesce_pending, seconds=5)
    await cell.command("reset")
    await cell.forward(until=cell.is_state(State.IDLE, State.UNHOMED), seconds=5)
    if cell.state is State.UNHOMED:
        assert (await cell.command("unlock")).ok
    await cell.forward(until=lambda: cell.controller.gate.is_shut, seconds=2)
    assert not is_open(cell)


async def test_a_control_that_refuses_the_word_starts_no_job_and_says_why(cell: CellUnderTest) -> None:
    cell.controller.gate.doubt()
    cell.controller.gate._port = 99  # more outputs than the control has
    await cell.forward(seconds=1)
    reply = await cell.start(one_wall(cell.facts, layers=1, mill=False))
    assert not reply.ok
    assert "gate" in reply.error and "M65" in reply.error
    assert cell.has_event("gate", "M65")


async def locked_with_an_open_gate(cell: CellUnderTest) -> None:
    """The control locks itself in the middle of a bead: it takes no words, and its outputs keep their level."""
    await cell.deposit(layers=1, pieces=60, length_mm=60.0)
    cell.sim.faults.add("alarm 3")
    await cell.forward(until=lambda: cell.state is State.FAULT and not cell.controller.quiesce_pending, seconds=5)
    await cell.command("reset")
    await cell.forward(until=cell.is_state(State.UNHOMED), seconds=8)
    assert is_open(cell) and not cell.controller.gate.is_shut


async def test_homing_of_a_locked_control_shuts_the_gate_before_anything_moves_and_no_light_is_possible(cell: CellUnderTest) -> None:
    await locked_with_an_open_gate(cell)
    assert (await cell.command("home")).ok
    while cell.state is State.HOMING:
        await cell.forward(ticks=1)
        assert cell.is_dark and not cell.sim.laser.values["emission_permit"] and not cell.sim.laser.values["enable"]
        assert cell.is_still or not is_open(cell)
    assert cell.state is State.IDLE and cell.controller.gate.is_shut and not cell.controller.position.why


async def test_a_locked_control_that_may_not_be_unlocked_is_homed_dark_and_its_gate_is_shut_behind(cell: CellUnderTest) -> None:
    await locked_with_an_open_gate(cell)
    table = system.COMMANDS
    unlock, table["$X"] = table["$X"], lambda firmware: 46  # homing is required: grblHAL refuses to unlock
    try:
        assert (await cell.command("home")).ok
        while cell.state is State.HOMING:
            await cell.forward(ticks=1)
            assert cell.is_dark and not cell.sim.laser.values["emission_permit"] and not cell.sim.laser.values["enable"]
    finally:
        table["$X"] = unlock
    assert cell.state is State.IDLE and cell.has_event("gate", "after homing only")
    await cell.forward(seconds=1.0)
    assert cell.controller.gate.is_shut and not is_open(cell)


async def test_a_stop_while_a_locked_control_is_unlocked_for_its_gate_lets_nothing_move(cell: CellUnderTest) -> None:
    await locked_with_an_open_gate(cell)
    assert (await cell.command("home")).ok
    await cell.forward(until=lambda: b"$X" in cell.wires.port.sent, seconds=10)
    at = cell.sim.cnc.machine.motion.position.copy()
    assert (await cell.command("stop")).ok
    await cell.forward(seconds=2.0)
    assert (cell.sim.cnc.machine.motion.position == at).all() and b"$H" not in cell.wires.port.sent
