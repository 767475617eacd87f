"""Invariant 4: nothing is guessed; what does not fit is refused with one line, and the machine has not moved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from cellctl.domain.states import State
from planner.errors import FileFormatError
from planner.program import Channel, Program
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import before_a_change, for_another_cell, one_wall


def shifted(program: Program) -> Program:
    return replace(program, work_offset=program.work_offset + np.array([0.0, 0.5, 0.0, 0.0, 0.0]))


def other_gate(program: Program) -> Program:
    return replace(program, gate="modbus")


def too_strong(program: Program) -> Program:
    schedule = program.schedule.copy()
    schedule["value"][schedule["channel"] == Channel.LASER_W] = 9000.0
    return replace(program, schedule=schedule)


@pytest.mark.parametrize(
    ("change", "words"),
    [(for_another_cell, "posted for cell another"), (before_a_change, "posted before the cell was changed or measured anew"),
     (shifted, "work offset is not the program's: Y is 0.000"), (other_gate, "gates the laser by modbus"),
     (too_strong, "laser.power_setpoint for 9000 W, its limit is 2000")],
)  # fmt: skip
async def test_a_program_that_does_not_fit_the_cell_as_it_stands_is_refused(
    cell: CellUnderTest, change: Callable[[Program], Program], words: str
) -> None:
    reply = await cell.start(change(one_wall(cell.facts)))
    assert not reply.ok
    assert words in reply.error and "\n" not in reply.error and reply.hint
    assert cell.state is State.IDLE
    assert b"M6" not in cell.wires.port.sent.replace(b"M65 P0", b"")  # that one shuts the gate


@pytest.mark.parametrize(
    ("fault", "words"),
    [("door_open", "The door is open"), ("gas_low", "Gas pressure"), ("fume_fail", "extraction"), ("chiller_fail", "chiller"),
     ("laser_fault", "the laser reports: power module"), ("feeder_fault", "the powder feeder reports: motor overload")],
)  # fmt: skip
async def test_a_job_does_not_start_in_a_cell_that_is_not_ready(cell: CellUnderTest, fault: str, words: str) -> None:
    cell.sim.faults.add(fault)
    await cell.forward(ticks=10)
    reply = await cell.start(one_wall(cell.facts))
    assert not reply.ok
    assert words.lower() in reply.error.lower() or cell.state.value in reply.error
    assert cell.sim.laser.values["enable"] == 0.0


async def test_reset_clears_a_fault_that_a_device_latched_at_rest(cell: CellUnderTest) -> None:
    cell.sim.faults.add("laser_fault")
    await cell.forward(ticks=10)
    assert not (await cell.start(one_wall(cell.facts))).ok
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.IDLE), seconds=5)
    assert cell.sim.laser.faults == 0
    assert (await cell.start(one_wall(cell.facts))).ok


async def test_a_program_file_that_cannot_be_read_is_refused_with_the_readers_line(cell: CellUnderTest) -> None:
    async def damaged(directory: object) -> tuple[Program, str]:
        raise FileFormatError("program.json: checksum differs", "post the plan again")

    cell.commands._read_program = damaged
    reply = await cell.command("start", job="j", name="n", program="p")
    assert (reply.ok, reply.error, reply.hint) == (False, "program.json: checksum differs", "post the plan again")


@pytest.mark.parametrize(
    ("verb", "args", "words"),
    [("dance", {}, "no such command"), ("start", {}, "job and program are needed"), ("jog", {"axis": "Q"}, "axis (X, Y, Z, A, C)"),
     ("jog", {"axis": "X", "distance": 1000.0, "feed": 100.0}, "outside -260 to 260"),
     ("jog", {"axis": "X", "distance": 1.0, "feed": 1e9}, "above 15000/min")],
)  # fmt: skip
async def test_a_command_that_makes_no_sense_is_refused(
    cell: CellUnderTest, verb: str, args: dict[str, object], words: str
) -> None:
    reply = await cell.command(verb, **args)
    assert not reply.ok and words in reply.error and reply.hint
    assert cell.state is State.IDLE


async def test_jog_and_home_lock_the_laser_out_and_need_the_door_closed(cell: CellUnderTest) -> None:
    assert (await cell.command("jog", axis="Y", distance=10.0, feed=3000.0)).ok
    assert cell.sim.laser.values["enable"] == 0.0
    await cell.forward(until=cell.is_state(State.IDLE), seconds=3)
    assert cell.sim.joints[1] == pytest.approx(10.0, abs=1e-3)
    assert (await cell.command("home")).ok
    await cell.forward(until=cell.is_state(State.IDLE), seconds=20)
    assert cell.sim.joints[1] == pytest.approx(0.0, abs=1e-3)
    cell.sim.open_door()
    await cell.forward(ticks=10)
    reply = await cell.command("jog", axis="Y", distance=10.0, feed=3000.0)
    assert not reply.ok and "door" in reply.error


async def test_the_tip_that_is_shown_at_rest_is_the_plants(cell: CellUnderTest) -> None:
    for axis, distance in (("X", 30.0), ("A", 25.0), ("C", -40.0)):
        assert (await cell.command("jog", axis=axis, distance=distance, feed=3000.0)).ok
        await cell.forward(until=cell.is_state(State.IDLE), seconds=5)
    await cell.forward(ticks=20)
    in_build_frame = cell.sim.tip_position - np.array(cell.facts.placement.part_origin_mm)
    assert cell.snapshot.tip == pytest.approx(tuple(in_build_frame), abs=0.01)


async def test_hold_ends_a_jog(cell: CellUnderTest) -> None:
    await cell.command("jog", axis="X", distance=200.0, feed=3000.0)
    await cell.forward(ticks=30)
    assert (await cell.command("hold")).ok
    await cell.forward(until=cell.is_state(State.IDLE), seconds=2)
    assert 0.0 < cell.sim.joints[0] < 100.0
