"""What is known after a kill at any instant: the place within 0.5 mm of the plant's own, and where metal ended."""

from __future__ import annotations

import random

import numpy as np
import pytest

from cellctl.cell.black_box import BlackBox, Moment
from cellctl.cell.program_text import gate_of_lines
from cellctl.domain.messages import Event
from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest
from tests.cell.jobs import one_wall

EXECUTED_MM = 0.5
METAL_MM = 0.5


def plant_arc(cell: CellUnderTest) -> float:
    """Path length up to the plant's own line and joints."""
    run = cell.controller.run
    assert run is not None
    line = max(cell.sim.cnc.machine.motion.line - 1, 0)
    return run.timeline.arc_at(line, run.timeline.fraction(line, cell.sim.joints))


def left(cell: CellUnderTest) -> Moment:
    """What a process that starts now would find."""
    box = BlackBox(cell.journal.box.path)
    found = box.of_job("job-1")
    box.close()
    assert found is not None
    return found


async def test_at_every_instant_of_a_pass_the_box_knows_the_arc_within_half_a_millimetre(cell: CellUnderTest) -> None:
    await cell.deposit(layers=1, pieces=60, length_mm=60.0)
    await cell.forward(ticks=30)  # the follower gets used to the pace
    errors = []
    for _ in range(150):
        await cell.forward(ticks=1)
        errors.append(abs(left(cell).place.arc_mm - plant_arc(cell)))
    assert max(errors) <= EXECUTED_MM


def has_just_beaten(cell: CellUnderTest) -> bool:
    """Whether the laser got a heartbeat since the last tick, so that its dead-man trips that much later."""
    assert cell.controller.drivers is not None
    client = cell.controller.drivers.laser.client
    return client.trips_in_s > client.device.dead_man_s - 0.5 * cell.facts.limits.tick_s


@pytest.mark.parametrize("seed", range(4))
async def test_killed_at_random_the_next_process_tells_where_the_tip_was_and_where_metal_ended(
    cell: CellUnderTest, seed: int
) -> None:
    await cell.deposit(layers=1, pieces=60, length_mm=60.0)
    await cell.forward(ticks=random.Random(seed).randrange(1, 150))
    if seed % 2:
        await cell.forward(until=lambda: has_just_beaten(cell), seconds=1.0)
    run, known = cell.controller.run, plant_arc(cell)
    assert run is not None
    await cell.kill()
    lit_arc = known
    for _ in range(80):
        await cell.forward(ticks=1)
        trace = cell.sim.trace
        for k in range(len(trace.dt)):
            if trace.emission_w[k] > 400.0 and trace.line[k]:
                line = int(trace.line[k]) - 1
                lit_arc = max(lit_arc, run.timeline.arc_at(line, run.timeline.fraction(line, trace.joints1[k])))
    assert cell.is_dark
    await cell.power_up()
    cell.journal.commit()
    ended: Event = next(e for e in cell.events if e.kind == "job" and e.data.get("outcome") == "interrupted")
    assert ended.data["known_by"] == "tick"
    assert ended.data["place"]["arc_mm"] == pytest.approx(known, abs=EXECUTED_MM)
    assert ended.data["metal_end"]["arc_mm"] == pytest.approx(lit_arc, abs=METAL_MM)


async def test_a_gate_that_an_aborted_job_left_open_is_shut_before_the_next_job_moves(cell: CellUnderTest) -> None:
    await cell.deposit(layers=1, pieces=60, length_mm=60.0)
    assert (await cell.command("abort")).ok
    await cell.forward(until=cell.is_state(State.IDLE), seconds=15)
    cell.burnt_lines.clear()
    program = one_wall(cell.facts, layers=1, mill=False)
    reply = await cell.start(program, job="job-2")
    assert reply.ok, reply.error
    await cell.hurry(lambda: bool(cell.burnt_lines) or cell.state in (State.IDLE, State.FAULT), scale=4.0)
    assert min(cell.burnt_lines) >= int(np.flatnonzero(gate_of_lines(program))[0]) + 1
    assert cell.latched == []
