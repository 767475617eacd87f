"""A head that leaves its place while nothing moves: told, and the job goes on only with a head that is where it has to be."""

from __future__ import annotations

from cellctl.domain.states import State
from tests.cell.harness import CellUnderTest


async def held_pass(cell: CellUnderTest) -> None:
    await cell.deposit(layers=1, mill=False)
    assert (await cell.command("hold")).ok
    await cell.forward(until=cell.is_state(State.HELD), seconds=5.0)
    await cell.forward(seconds=0.3)


def take_slide_away(cell: CellUnderTest) -> object:
    """The slide leaves its end stop and stays between its switches; returns what gives it back."""
    step = cell.sim.io.step
    cell.sim.io.slide = 0.5
    cell.jam_head()
    return step


async def test_a_head_that_leaves_its_place_in_a_hold_is_told_and_the_job_goes_on_once_it_is_back(cell: CellUnderTest) -> None:
    await held_pass(cell)
    step = take_slide_away(cell)
    await cell.forward(ticks=5)
    assert cell.state is State.FAULT and cell.latched == ["head_position"]
    cell.sim.io.step = step  # type: ignore[assignment]
    await cell.forward(seconds=3.0)
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.HELD), seconds=8.0)
    assert (await cell.command("resume")).ok
    await cell.hurry(cell.is_state(State.IDLE), scale=4.0)
    assert cell.outcome == "completed" and cell.max_standstill_emission_w == 0.0


async def test_with_a_head_that_stays_away_the_job_is_held_again_by_the_resume_and_can_be_aborted(cell: CellUnderTest) -> None:
    await held_pass(cell)
    take_slide_away(cell)
    await cell.forward(ticks=5)
    assert cell.latched == ["head_position"]
    await cell.forward(seconds=1.0)
    assert (await cell.command("reset")).ok
    await cell.forward(until=cell.is_state(State.HELD), seconds=8.0)
    assert (await cell.command("resume")).ok
    at = cell.sim.cnc.machine.motion.position.copy()
    await cell.forward(until=cell.is_state(State.FAULT), seconds=15.0)
    assert "deploying the deposition head failed" in cell.snapshot.alarms[0].cause
    assert (cell.sim.cnc.machine.motion.position == at).all() and cell.is_dark


async def test_a_head_that_leaves_its_place_while_powder_is_waited_for_lets_nothing_move(cell: CellUnderTest) -> None:
    await held_pass(cell)
    await cell.forward(seconds=3.0)
    assert (await cell.command("resume")).ok
    await cell.forward(until=lambda: "powder to flow" in cell.snapshot.waiting, seconds=10.0)
    at = cell.sim.cnc.machine.motion.position.copy()
    take_slide_away(cell)
    await cell.forward(ticks=5)
    assert cell.latched == ["head_position"]
    await cell.forward(seconds=1.0)
    assert (cell.sim.cnc.machine.motion.position == at).all() and cell.is_dark
