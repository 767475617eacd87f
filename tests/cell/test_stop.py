"""Invariant 2: a stop is always possible; commands name the end state and are harmless twice."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall

REST_S = 2.0  # braking, and the reset behind it
Way = Callable[[CellUnderTest], Awaitable[None]]


async def to_idle(cell: CellUnderTest) -> None:
    assert cell.state is State.IDLE


async def to_offline(cell: CellUnderTest) -> None:
    cell.sim.faults.add("modbus_silent feeder")
    await cell.forward(until=cell.is_state(State.OFFLINE), seconds=3)


async def to_unhomed(cell: CellUnderTest) -> None:
    cell.sim.faults.add("alarm 1")
    await cell.forward(until=cell.is_state(State.UNHOMED), seconds=2)


async def to_homing(cell: CellUnderTest) -> None:
    await cell.command("jog", axis="Z", distance=-100.0, feed=6000.0)
    await cell.forward(until=cell.is_state(State.IDLE), seconds=5)
    task = asyncio.get_running_loop().create_task(cell.command("home"))
    await cell.forward(until=cell.is_state(State.HOMING), seconds=1)
    await task


async def to_jogging(cell: CellUnderTest) -> None:
    assert (await cell.command("jog", axis="X", distance=100.0, feed=3000.0)).ok
    await cell.forward(ticks=20)
    assert cell.state is State.JOGGING


async def to_preparing(cell: CellUnderTest) -> None:
    await cell.start(one_wall(cell.facts))
    await cell.forward(until=lambda: cell.state is State.PREPARING and "deploying" in cell.snapshot.waiting, seconds=5)


async def to_running(cell: CellUnderTest) -> None:
    await cell.deposit()


async def to_holding(cell: CellUnderTest) -> None:
    await cell.deposit()
    await cell.command("hold")
    assert cell.state is State.HOLDING


async def to_held(cell: CellUnderTest) -> None:
    await to_holding(cell)
    await cell.forward(until=cell.is_state(State.HELD), seconds=2)


async def to_resuming(cell: CellUnderTest) -> None:
    await to_held(cell)
    await cell.command("resume")
    assert cell.state is State.RESUMING


async def to_aborting(cell: CellUnderTest) -> None:
    await cell.deposit()
    await cell.command("abort")
    assert cell.state is State.ABORTING


async def to_fault(cell: CellUnderTest) -> None:
    await cell.deposit()
    cell.sim.faults.add("fume_fail")
    await cell.forward(until=cell.is_state(State.FAULT), seconds=1)


async def to_stopped(cell: CellUnderTest) -> None:
    await cell.deposit()
    await cell.command("stop")


async def to_purging(cell: CellUnderTest) -> None:
    assert (await cell.command("purge", seconds=30.0, powder_g_min=8.0)).ok
    await cell.forward(until=lambda: cell.snapshot.hand.flow_left_s > 0.0, seconds=20)
    assert cell.state is State.PURGING and cell.sim.feeder.values["rate_setpoint"] == 8.0


async def to_resetting(cell: CellUnderTest) -> None:
    await to_stopped(cell)
    await cell.forward(seconds=REST_S)
    await cell.command("reset")
    assert cell.state is State.RESETTING


WAYS: dict[State, Way] = {
    State.OFFLINE: to_offline,
    State.UNHOMED: to_unhomed,
    State.IDLE: to_idle,
    State.HOMING: to_homing,
    State.JOGGING: to_jogging,
    State.PURGING: to_purging,
    State.PREPARING: to_preparing,
    State.RUNNING: to_running,
    State.HOLDING: to_holding,
    State.HELD: to_held,
    State.RESUMING: to_resuming,
    State.ABORTING: to_aborting,
    State.FAULT: to_fault,
    State.STOPPED: to_stopped,
    State.RESETTING: to_resetting,
}


def test_there_is_a_way_into_every_state() -> None:
    assert set(WAYS) == set(State)


@pytest.mark.parametrize("state", WAYS)
async def test_stop_turns_everything_off_in_every_state_and_twice_is_harmless(
    cell: CellUnderTest, state: State
) -> None:
    await WAYS[state](cell)
    assert (await cell.command("stop", because="hand on the button")).ok
    assert cell.state is State.STOPPED
    await cell.forward(ticks=2)
    assert cell.is_dark
    assert cell.sim.laser.values["enable"] == cell.sim.laser.values["emission_permit"] == 0.0
    if state is not State.OFFLINE:
        assert cell.sim.feeder.values["rate_setpoint"] == 0.0
    assert (await cell.command("stop")).ok
    await cell.forward(seconds=REST_S)
    assert cell.is_still
    assert cell.sim.cnc.machine.spindle_command_rpm == 0.0
    assert cell.state is State.STOPPED
    line = cell.sim.cnc.machine.motion.line
    await cell.forward(seconds=1.0)
    assert (cell.is_still, cell.sim.cnc.machine.motion.line) == (True, line), "buffered lines must not run after a stop"


async def test_after_a_stop_the_job_is_over_and_reset_leads_to_idle_or_homing(cell: CellUnderTest) -> None:
    await cell.deposit()
    await cell.command("stop")
    await cell.forward(seconds=REST_S)
    assert cell.outcome == "aborted"
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.IDLE, State.UNHOMED), seconds=5)
    assert cell.latched == []
    again = one_wall(cell.facts, layers=1, mill=False)
    if cell.state is State.UNHOMED:
        await cell.command("home")
        await cell.forward(until=cell.is_state(State.IDLE), seconds=20)
    await cell.start(again, "job-2")
    await cell.hurry(cell.is_state(State.IDLE), scale=5.0)
    assert cell.outcome == "completed"


async def test_abort_stops_light_motion_and_powder_and_ends_idle(cell: CellUnderTest) -> None:
    await cell.deposit()
    assert (await cell.command("abort")).ok
    assert (await cell.command("abort")).ok
    await cell.forward(until=cell.is_state(State.IDLE), seconds=20)
    assert cell.outcome == "aborted"
    assert cell.controller.lines().executed < cell.controller.lines().acknowledged  # what the reset flushed was not executed
    assert cell.is_dark and cell.is_still
    assert cell.sim.feeder.rate_at_nozzle_g_min < 0.3
    assert cell.sim.io.is_parked
    assert cell.sim.cnc.state[0] == "Idle"
    assert cell.max_standstill_emission_w == 0.0


@pytest.mark.parametrize(
    ("state", "verb"),
    [(State.IDLE, "hold"), (State.IDLE, "resume"), (State.RUNNING, "home"), (State.RUNNING, "jog"), (State.HELD, "unlock"),
     (State.FAULT, "resume"), (State.STOPPED, "hold"), (State.UNHOMED, "start"), (State.OFFLINE, "home"), (State.JOGGING, "abort")],
)  # fmt: skip
async def test_a_command_in_the_wrong_state_is_refused_in_one_line_and_changes_nothing(
    cell: CellUnderTest, state: State, verb: str
) -> None:
    await WAYS[state](cell)
    before = cell.sim.cnc.machine.motion.position.copy() if state is State.IDLE else None
    reply = await cell.command(verb, job="x", program="x", axis="X", distance=1.0, feed=100.0)
    assert not reply.ok
    assert verb in reply.error and state.value in reply.error and "\n" not in reply.error
    assert reply.hint
    assert cell.state is state
    if before is not None:
        assert (before == cell.sim.cnc.machine.motion.position).all()


@pytest.mark.parametrize(
    ("state", "verb"),
    [(State.HELD, "hold"), (State.STOPPED, "stop"), (State.ABORTING, "abort"), (State.HOMING, "home")],
)
async def test_a_command_whose_end_state_is_reached_is_answered_and_changes_nothing(
    cell: CellUnderTest, state: State, verb: str
) -> None:
    await WAYS[state](cell)
    reply = await cell.command(verb)
    assert reply.ok
    assert cell.state in (state, State.IDLE)


async def test_stop_reaches_a_machine_that_is_set_going_by_hand_while_the_cell_process_comes_up(cell: CellUnderTest) -> None:
    await cell.deposit()
    await cell.kill()
    await cell.forward(seconds=0.6)
    await cell.power_up(until_idle=False)
    await cell.forward(until=lambda: cell.sim.cnc.state == ("Hold", 0), seconds=1)
    cell.sim.faults.add("cycle_start")  # the machine's own button
    await cell.forward(ticks=3)
    assert not cell.is_still
    assert (await cell.command("stop")).ok
    await cell.forward(seconds=0.5)
    assert cell.is_still and cell.is_dark
