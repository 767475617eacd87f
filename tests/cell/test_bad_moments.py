"""Two things at once: commands, faults and wires that come between others; none may be lost, and none may leave light behind."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from cellctl.domain.messages import Command
from cellctl.domain.states import State
from config.cell import Cell
from planner.program import Channel, LineKind, Program
from tests.cell.harness import CellUnderTest, shipped_cell
from tests.cell.jobs import POWDER_G_MIN, POWER_W, Writer, one_wall


async def reset_to(cell: CellUnderTest, *states: State) -> None:
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(*states), seconds=10)


async def held_by_the_door(cell: CellUnderTest) -> None:
    await cell.deposit(mill=False)
    cell.sim.open_door()
    await cell.forward(seconds=1.0)
    cell.sim.close_door()
    await cell.forward(ticks=10)
    assert cell.state is State.FAULT and cell.controller.run is not None


async def test_two_starts_at_once_give_one_run_and_one_refusal(cell: CellUnderTest) -> None:
    program = one_wall(cell.facts, layers=1, mill=False)
    cell.programs.update({"job-1": program, "job-2": program})
    commands = [Command(f"c-{k}", "start", "tester", "test", {"job": job, "name": job, "program": job})
                for k, job in enumerate(["job-1", "job-2", "job-1"])]  # fmt: skip

    async def on_a_slow_disk() -> None:
        await cell.clock.sleep(0.05)
        cell.journal.commit()

    cell.journal.durable = on_a_slow_disk  # type: ignore[method-assign]
    tasks = [asyncio.get_running_loop().create_task(cell.commands.handle(command)) for command in commands]
    await cell.forward(until=lambda: all(task.done() for task in tasks), seconds=5)
    assert sorted(task.result().ok for task in tasks) == [False, False, True]
    await cell.hurry(cell.is_state(State.IDLE, State.FAULT))
    assert (cell.state, cell.outcome, cell.latched) == (State.IDLE, "completed", [])


async def test_a_start_that_a_stop_overtook_never_starts(cell: CellUnderTest) -> None:
    program = one_wall(cell.facts)
    may_read = asyncio.Event()

    async def slowly(directory: Path) -> tuple[Program, str]:
        await may_read.wait()
        return program, "d" * 64

    cell.commands._read_program = slowly
    command = Command("s-1", "start", "tester", "test", {"job": "j", "name": "n", "program": "p"})
    task = asyncio.get_running_loop().create_task(cell.commands.handle(command))
    await cell.forward(ticks=2)
    assert (await cell.command("stop")).ok
    await cell.forward(seconds=2.0)
    await reset_to(cell, State.IDLE)
    may_read.set()
    await cell.forward(seconds=1.0)
    assert task.done() and not task.result().ok and "stop" in task.result().error
    assert cell.state is State.IDLE and cell.controller.run is None


async def test_a_hold_right_behind_the_resume_stands_the_machine(cell: CellUnderTest) -> None:
    await cell.deposit(length_mm=80.0, mill=False)
    await cell.command("hold")
    await cell.forward(until=cell.is_state(State.HELD), seconds=2)
    await cell.command("resume")
    sent = len(cell.wires.port.sent)
    await cell.forward(until=lambda: b"~" in cell.wires.port.sent[sent:], seconds=20)
    assert (await cell.command("hold")).ok
    await cell.forward(until=cell.is_state(State.HELD), seconds=3)
    assert cell.is_still
    await cell.forward(seconds=1.0)
    assert cell.is_still and cell.is_dark


async def test_a_machine_that_is_let_go_at_its_own_panel_while_held_is_held_again(cell: CellUnderTest) -> None:
    await cell.deposit(length_mm=80.0, mill=False)
    await cell.command("hold")
    await cell.forward(until=cell.is_state(State.HELD), seconds=2)
    cell.sim.cnc.receive(b"~")
    await cell.forward(seconds=0.5)
    assert cell.is_still and cell.is_dark and cell.state is State.HELD


async def test_stop_pressed_again_and_again_still_drops_what_a_deaf_machine_holds(cell: CellUnderTest) -> None:
    await cell.deposit(length_mm=80.0)
    cell.sim.faults.add("serial_silent")
    for _ in range(12):
        await cell.command("stop")
        await cell.forward(seconds=0.3)
    assert b"\x18" in cell.wires.port.sent[-4000:]
    assert cell.controller.quiesce.is_reset


@pytest.mark.parametrize("event", ["firmware_reset", "alarm 1", "unplugged"])
async def test_a_job_held_by_a_fault_ends_when_the_machine_forgets_it(cell: CellUnderTest, event: str) -> None:
    await held_by_the_door(cell)
    if event == "unplugged":
        cell.wires.port.is_unplugged = True
    else:
        cell.sim.faults.add(event)
    await cell.forward(seconds=2.0)
    assert cell.controller.run is None
    assert cell.outcome == "interrupted"
    assert len(cell.latched) > 1
    await cell.forward(seconds=2.0)
    await reset_to(cell, State.IDLE, State.UNHOMED)


async def test_an_answer_to_nothing_ends_the_job_with_its_cause(cell: CellUnderTest) -> None:
    await cell.deposit(layers=1, pieces=20, mill=False)
    await cell.command("hold")
    await cell.forward(until=cell.is_state(State.HELD), seconds=2)
    driver = cell.controller.drivers.cnc if cell.controller.drivers else None
    assert driver is not None
    for event in driver.protocol.receive(b"ok\r\n" * (driver.protocol.unanswered + 1), cell.clock.now()):
        driver._take(event, cell.clock.now())
    await cell.forward(seconds=2.0)
    assert cell.state is State.FAULT
    assert "answered" in cell.snapshot.alarms[0].cause and cell.snapshot.alarms[0].remedy
    assert cell.outcome == "interrupted"


@pytest.mark.parametrize("lost", [["laser"], ["laser", "io", "feeder"]])
async def test_a_laser_that_nobody_can_reach_is_dark_before_the_tip_stands(
    cell: CellUnderTest, lost: list[str]
) -> None:
    await cell.deposit(length_mm=120.0, mill=False)
    for device in lost:
        cell.sim.faults.add(f"modbus_silent {device}")
    await cell.forward(until=cell.is_state(State.FAULT), seconds=1.0)
    await cell.forward(until=lambda: cell.is_still, seconds=3.0)
    assert cell.is_dark
    assert cell.max_standstill_emission_w == 0.0


async def test_a_purge_that_a_hold_broke_off_is_made_whole_before_the_tool_changes(cell: CellUnderTest) -> None:
    await cell.start(one_wall(cell.facts, layers=1))
    await cell.hurry(lambda: "purging" in cell.snapshot.waiting)
    await cell.command("hold")
    assert cell.state is State.HELD
    await cell.command("resume")
    await cell.forward(until=lambda: "purging" in cell.snapshot.waiting, seconds=3)
    began = cell.clock.now()
    await cell.forward(until=lambda: "purging" not in cell.snapshot.waiting, seconds=3)
    assert cell.clock.now() - began >= cell.facts.limits.purge_s - 0.02


async def test_an_abort_that_a_fault_overtakes_still_ends_the_job(cell: CellUnderTest) -> None:
    await cell.deposit(mill=False)
    await cell.command("abort")
    cell.controller.fault("store", "disk full")
    await cell.forward(seconds=3.0)
    assert cell.outcome == "aborted" and cell.controller.run is None
    await reset_to(cell, State.IDLE, State.UNHOMED)


async def test_a_machine_that_falls_silent_at_rest_takes_the_cell_offline_by_name(cell: CellUnderTest) -> None:
    cell.sim.faults.add("serial_silent")
    await cell.forward(until=cell.is_state(State.OFFLINE), seconds=4)
    assert "CNC" in cell.snapshot.waiting
    assert (await cell.command("stop")).ok


async def test_a_machine_that_falls_silent_in_a_jog_latches_it(cell: CellUnderTest) -> None:
    await cell.command("jog", axis="X", distance=200.0, feed=600.0)
    await cell.forward(ticks=20)
    cell.sim.faults.add("serial_silent")
    await cell.forward(until=cell.is_state(State.FAULT), seconds=2)
    assert cell.latched == ["cnc_silent"]


async def test_a_door_opened_in_a_jog_stops_it(cell: CellUnderTest) -> None:
    await cell.command("jog", axis="X", distance=200.0, feed=600.0)
    await cell.forward(ticks=20)
    cell.sim.open_door()
    await cell.forward(seconds=1.0)
    assert cell.latched == ["door"] and cell.is_still
    assert cell.sim.joints[0] < 100.0


async def test_work_that_fails_in_an_unforeseen_way_is_latched_and_answered(cell: CellUnderTest) -> None:
    async def broken(directory: object) -> tuple[Program, str]:
        raise RuntimeError("broken")

    cell.commands._read_program = broken
    reply = await cell.command("start", job="j", name="n", program="p")
    assert not reply.ok and "RuntimeError" in reply.error
    drivers = cell.controller.drivers
    assert drivers is not None
    reads = drivers.laser.client._read_all

    async def fails() -> None:
        raise ValueError("noise")

    drivers.laser.client._read_all = fails  # type: ignore[method-assign]
    await cell.forward(seconds=1.0)
    assert "internal" in cell.latched
    drivers.laser.client._read_all = reads  # type: ignore[method-assign]
    await cell.forward(seconds=1.0)
    assert not drivers.laser.is_stale, "the line is polled again"


async def test_a_stop_stays_latched_over_the_death_of_the_process(cell: CellUnderTest) -> None:
    await cell.command("stop")
    await cell.forward(ticks=20)
    await cell.kill()
    await cell.power_up(until_idle=False)
    await cell.forward(seconds=3.0)
    assert cell.state is State.STOPPED
    await reset_to(cell, State.IDLE, State.UNHOMED)
    await cell.kill()
    await cell.power_up()
    assert cell.state in (State.IDLE, State.UNHOMED)


async def test_a_start_that_could_not_be_written_down_is_no_run_afterwards(cell: CellUnderTest) -> None:
    cell.journal._db.execute("PRAGMA query_only = ON")
    reply = await cell.start(one_wall(cell.facts))
    assert not reply.ok and cell.controller.run is None
    cell.journal._db.execute("PRAGMA query_only = OFF")
    cell.journal.commit()
    assert cell.journal.find().unfinished == []


async def test_words_that_are_no_characters_do_not_stop_the_journal(cell: CellUnderTest) -> None:
    assert (await cell.command("stop", because="\ud800 smoke")).ok
    cell.journal.commit()
    assert cell.has_event("command", "smoke")


def dwell_before_the_pass(cell: Cell) -> Program:
    """One bead that begins right behind a dwell, gated by the schedule."""
    w = Writer(cell)
    w.line("G21 G90 G17 G49 G54 G93", LineKind.SETUP)
    w.line("M6 T1", LineKind.TOOL)
    w.layer = w.operation = 0
    n = w.move(-25.0, 0.0, 20.0, LineKind.LINK, 190.0)
    w.at(n, Channel.MODE, 1, barrier=True)
    w.at(n, Channel.CARRIER_GAS_L_MIN, 5.0, barrier=True)
    n = w.move(-25.0, 0.0, 0.0, LineKind.LINK, 40.0)
    w.at(n, Channel.POWDER_G_MIN, POWDER_G_MIN, barrier=True)
    w.at(w.move(-20.0, 0.0, 0.0, LineKind.LINK, 10.0), Channel.LASER_W, POWER_W)
    w.line("G4 P2", LineKind.DWELL, 2.0)
    for k in range(10):
        n = w.move(-16.0 + 4.0 * k, 0.0, 0.0, LineKind.PROCESS, 10.0)
        if k == 0:
            w.at(n, Channel.EMISSION, 1)
    w.at(w.move(25.0, 0.0, 0.0, LineKind.LINK, 10.0), Channel.EMISSION, 0)
    w.at(w.line("M2", LineKind.SETUP), Channel.MODE, 0, barrier=True)
    return w.program("dwell", [2])


async def test_a_cell_without_wired_gate_lights_nothing_at_the_end_of_a_dwell(tmp_path: Path) -> None:
    async with CellUnderTest(tmp_path / "store.db", cell=shipped_cell("trunnion_rtu")) as cell:
        assert (await cell.start(dwell_before_the_pass(cell.facts))).ok
        await cell.forward(until=lambda: cell.snapshot.lines.executed >= 5, seconds=60)
        await cell.forward(ticks=60)
        cell.time_scale = cell.sim.time_scale = 0.8  # a dwell that takes longer than it says
        await cell.forward(until=cell.is_state(State.IDLE, State.FAULT), seconds=60)
        assert cell.outcome == "completed"
        assert cell.burnt_lines
        assert cell.max_standstill_emission_w == 0.0
